"""slcand makes an interface of a simulator's terminal: SUBJECT.

Runs where there is the kernel's slcan and the user is root, as in tests/user-mode-linux/with-can. Nothing sleeps: every wait is
for a frame or a line, with a time limit.
"""

import contextlib
import faulthandler
import os
import socket
import subprocess
import sys
import tempfile
import time

from processes import process, run
from raw import hear, send
from waiting import LIFE, PATIENCE, equal, take

#: A name that the kernel does not give: once it is there, slcand has done with it.
INTERFACE = "pveslcan"
READ, ANSWER = (0x622, bytes.fromhex("4000100000000000")), (0x5A2, bytes.fromhex("4300100098010000"))

@contextlib.contextmanager
def attached(path, *options):
    """A raw socket on the interface that slcand makes of a terminal."""
    # it looks for any other path in /dev
    command = ("slcand", "-F", "-o", "-c", *options, os.readlink(path), INTERFACE)
    deadline = time.monotonic() + PATIENCE
    program = subprocess.Popen(command)
    try:
        while not os.path.exists(f"/sys/class/net/{INTERFACE}"):
            # It may end at once, as long as the interface before is going.
            if program.poll() is not None:
                program = subprocess.Popen(command)
            assert time.monotonic() < deadline, "slcand makes no interface"
        run("ip", "link", "set", INTERFACE, "up")
        with contextlib.closing(socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)) as link:
            link.bind((INTERFACE,))
            yield link
    finally:
        program.terminate()
        equal("slcand", program.wait(PATIENCE) in (0, -15), True)
    while os.path.exists(f"/sys/class/net/{INTERFACE}"):
        assert time.monotonic() < deadline + PATIENCE, "the interface stays"


def interface():
    """Frames of both formats in both directions; slcand comes again and again; at another bit rate it hears nothing."""
    path = os.path.join(tempfile.mkdtemp(), "pve0")
    with process(os.environ["PVE_SIM"], "--bus", f"slcan+pty:{path}", "--no-http", "--device", "pvea-canopen@0x22") as (
        _,
        trace,
        said,
    ):
        ready, _ = take(trace, lambda _: True)
        equal("ready", ready, f"pve-sim ready bus=slcan+pty:{path}")
        for options in ((), ("-s5",), ("-s5", "-f")):
            with attached(path, *options) as link:
                send(link, *READ)
                equal("answer", hear(link, ANSWER[0]), ANSWER[1])
                # 29-bit identifiers: the identifier server
                send(link, 0x1BC78822 | socket.CAN_EFF_FLAG, bytes.fromhex("0322F010"))
                equal("answer", hear(link, 0x1BC110F1 | socket.CAN_EFF_FLAG).hex(), "0462f010a5")
                send(link, 0x722 | socket.CAN_RTR_FLAG, b"")
                take(trace, lambda line: " 722#R" in line)
        with attached(path, "-s6"):
            take(said, lambda line: line.endswith("set 500000 bit/s, but the bus runs at 250000 bit/s: the channel stays closed"))
        with attached(path, "-s5") as link:
            send(link, *READ)
            equal("answer", hear(link, ANSWER[0]), ANSWER[1])
    equal("the link is there", os.path.lexists(path), False)


faulthandler.dump_traceback_later(LIFE, exit=True)
{subject.__name__: subject for subject in (interface,)}[sys.argv[1]]()
