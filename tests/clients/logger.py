"""python-can's own programs: can_logger writes down what others say, and the search for interfaces comes to an end."""

import contextlib
import re
import signal
import subprocess
import sys

import can

from valve import BOOT_UP, NODE_ID, connected, equal

READS = 100
REQUEST, ANSWER, BOOT = f"{0x600 + NODE_ID:03x}", f"{0x580 + NODE_ID:03x}", f"{0x700 + NODE_ID:03x}"
#: The identifier of the last frame that it is to log.
END = 0x7F0
FRAME = re.compile(r"Timestamp: +([\d.]+) +ID: +([0-9a-f]+) .* DL: +(\d+)(.*)")


def logged(logger):
    """What can_logger prints, up to the end, as (identifier, data)."""
    frames = []
    while not frames or frames[-1][0] != f"{END:03x}":
        line = logger.stdout.readline()
        assert line, "can_logger ended"
        if frame := FRAME.match(line):
            _, cob_id, length, rest = frame.groups()
            frames.append((cob_id, bytes.fromhex("".join(rest.split()[: int(length)]))))
    return frames


@contextlib.contextmanager
def ended(process):
    """Nobody waits for a process that has no reason to end."""
    try:
        yield
    except BaseException:
        process.kill()
        raise


def only_listens(valve):
    host, port = valve.address["host"], valve.address["port"]
    command = [sys.executable, "-u", "-m", "can.logger", "-i", "socketcand", "-c", valve.address["channel"]]
    command += ["--bus-kwargs", f"host={host}", f"port={port}"]
    # a shell that runs this in the background has it ignored, and can_logger would inherit that
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as logger, ended(logger):
        # it says so when it is connected
        line = logger.stdout.readline()
        assert line.startswith("Connected to SocketCanDaemonBus"), line
        valve.reset()
        for _ in range(READS):
            valve.node.sdo[0x1000].raw
        # whatever can_logger says, nobody else hears of it
        equal("frames at the client", {frame.arbitration_id for frame in valve.heard.all()}, {int(ANSWER, 16)})
        valve.network.send_message(END, b"\x01")
        frames = logged(logger)
        logger.send_signal(signal.SIGINT)
    equal("exit code of can_logger", logger.returncode, 0)
    equal("frames of the boot", frames[:3], [("000", bytes([0x81, NODE_ID])), (BOOT, BOOT_UP), ("0a0", bytes(8))])
    pairs = [(cob_id, data[1:4]) for cob_id, data in frames[3:-1]]
    equal("requests and answers", pairs, READS * [(REQUEST, b"\x00\x10\x00"), (ANSWER, b"\x00\x10\x00")])
    equal("the last frame", frames[-1][1], b"\x01")


def is_not_found_by_itself(address):
    """The simulator sends no beacon: that would leave the machine. The search gives up and says so."""
    found = can.detect_available_configs("socketcand")
    assert address not in found, found


with connected() as valve:
    only_listens(valve)
# apart: another search on this machine keeps the beacons' port, and python-can complains
is_not_found_by_itself(valve.address)
