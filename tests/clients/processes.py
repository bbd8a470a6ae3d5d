"""Programs beside a script: started, heard line by line, and ended."""

import contextlib
import queue
import subprocess
import threading

from waiting import PATIENCE, equal


def run(*command):
    subprocess.run(command, check=True)


def collect(stream):
    """The lines of a pipe, as they come, and the thread that ends with the pipe."""
    lines = queue.SimpleQueue()
    thread = threading.Thread(target=lambda: [lines.put(line.rstrip("\n")) for line in stream], daemon=True)
    thread.start()
    return lines, thread


@contextlib.contextmanager
def process(*command):
    """A program with its stdin, the lines of its stdout and of its stderr, which are complete after the context."""
    pipe = subprocess.PIPE
    program = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1)
    (told, reader), (said, other) = collect(program.stdout), collect(program.stderr)
    try:
        yield program, told, said
    finally:
        program.terminate()
        equal(command[0], program.wait(PATIENCE) in (0, -15), True)
        for thread in (reader, other):
            thread.join(PATIENCE)
