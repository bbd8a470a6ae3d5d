"""Many clients at once: twenty in one process, and five processes more. All read from the valve over one SDO channel;
each gets every frame of every other, in its order, and none of its own.

HOST PORT CHANNEL [NUMBER]: with a number it is one of the five.
"""

import contextlib
import subprocess
import sys
from collections import Counter

import can

from valve import NODE_ID, PATIENCE, connected, equal

BUSES, PROCESSES = 20, 5
CLIENTS = BUSES + PROCESSES
#: What each of them sends.
FRAMES, READS = 20, 10
#: Identifiers of nobody else: of each client one.
FIRST_ID = 0x400
REQUEST, ANSWER = 0x600 + NODE_ID, 0x580 + NODE_ID
READ = bytes.fromhex("40 18 10 02 00 00 00 00")
PRODUCT_CODE = 0x53360000
END = 0x7F0


def tags(number):
    return [can.Message(arbitration_id=FIRST_ID + number, is_extended_id=False, data=[tag]) for tag in range(FRAMES)]


def check(number, heard):
    """What the client of this number has heard, as (identifier, data), up to the end."""
    counts = Counter(cob_id for cob_id, _ in heard)
    equal(f"client {number}: frames of its own", counts[FIRST_ID + number], 0)
    for other in set(range(CLIENTS)) - {number}:
        seen = [data[0] for cob_id, data in heard if cob_id == FIRST_ID + other]
        equal(f"client {number}: frames of client {other}", seen, list(range(FRAMES)))
    equal(f"client {number}: requests of others", counts[REQUEST], (CLIENTS - 1) * READS)
    equal(f"client {number}: answers", counts[ANSWER], CLIENTS * READS)
    # an answer to the read, or to the read of somebody who asks for the same
    answers = {data for cob_id, data in heard if cob_id == ANSWER}
    equal(f"client {number}: answers", answers, {bytes.fromhex("43 18 10 02") + PRODUCT_CODE.to_bytes(4, "little")})


def until_the_end(receive):
    """What a client hears, as (identifier, data); `receive` waits for the next frame."""
    heard = []
    while not heard or heard[-1][0] != END:
        frame = receive()
        assert frame, f"no end after {heard[-8:]}"
        heard.append((frame.arbitration_id, bytes(frame.data)))
    return heard


def process(number):
    """One of the five, told by its parent when: python-canopen's network with its thread, and its SDO client."""
    with connected() as valve:
        print("there", flush=True)
        equal("told", sys.stdin.readline(), "go\n")
        for frame in tags(number):
            valve.network.bus.send(frame)
        for _ in range(READS):
            equal("1018:2", valve.node.sdo[0x1018][2].raw, PRODUCT_CODE)
        check(number, until_the_end(valve.heard.next))


@contextlib.contextmanager
def started(number):
    """One of the five, which is there, and ends well."""
    command = [sys.executable, __file__, *sys.argv[1:4], str(number)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        equal("a process", process.stdout.readline(), "there\n")
        yield process
    equal(f"exit code of process {number}", process.returncode, 0)


def everybody():
    with contextlib.ExitStack() as stack:
        valve = stack.enter_context(connected())
        processes = [stack.enter_context(started(number)) for number in range(PROCESSES)]
        buses = {number: stack.enter_context(can.Bus(**valve.address)) for number in range(PROCESSES, CLIENTS)}
        for process in processes:
            process.stdin.write("go\n")
            process.stdin.flush()
        # one frame of each bus in turn
        for frames in zip(*(tags(number) for number in buses)):
            for bus, frame in zip(buses.values(), frames):
                bus.send(frame)
        for _ in range(READS):
            for bus in buses.values():
                bus.send(can.Message(arbitration_id=REQUEST, is_extended_id=False, data=READ))

        # this client has only listened so far; it tells the others when all is said
        counts = Counter()
        while counts.total() < CLIENTS * (FRAMES + 2 * READS):
            frame = valve.heard.next()
            counts[frame.arbitration_id] += 1
        equal("requests and answers", (counts[REQUEST], counts[ANSWER]), 2 * (CLIENTS * READS,))
        valve.network.send_message(END, b"")
        for number, bus in buses.items():
            check(number, until_the_end(lambda: bus.recv(PATIENCE)))


if len(sys.argv) > 4:
    process(int(sys.argv[4]))
else:
    everybody()
