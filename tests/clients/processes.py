"""Programs beside a script: started, heard line by line, and ended."""

import contextlib
import queue
import subprocess
import threading

from waiting import PATIENCE, equal


def run(*command):
    subprocess.run(command, check=True)


def collect(stream):
    """The lines of a pipe, as they come."""
    lines = queue.SimpleQueue()
    threading.Thread(target=lambda: [lines.put(line.rstrip("\n")) for line in stream], daemon=True).start()
    return lines


@contextlib.contextmanager
def process(*command):
    """A program with its stdin, the lines of its stdout and of its stderr."""
    pipe = subprocess.PIPE
    program = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1)
    try:
        yield program, collect(program.stdout), collect(program.stderr)
    finally:
        program.terminate()
        equal(command[0], program.wait(PATIENCE) in (0, -15), True)
