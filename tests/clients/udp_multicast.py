"""Two simulators and python-can's `udp_multicast` in one group: SUBJECT.

Runs on a kernel of its own, as in tests/user-mode-linux/with-can, whose loopback is the only network. Nothing sleeps: every wait is
for a frame or a line, with a time limit.
"""

import contextlib
import faulthandler
import os
import socket
import sys
import time

import can
import canopen

from processes import process, run
from waiting import LIFE, PATIENCE, equal, take

PORT = 43113

@contextlib.contextmanager
def simulator(url, *options):
    """A `pve-sim` in the group: its trace, and what it says on stderr."""
    with process(os.environ["PVE_SIM"], "--bus", url, "--no-http", *options) as (_, trace, said):
        ready, _ = take(trace, lambda _: True)
        equal("ready", ready.split()[:3], ["pve-sim", "ready", f"bus={url}"])
        yield trace, said


def hear(bus, identifier):
    """The next frame with this identifier."""
    deadline = time.monotonic() + PATIENCE
    while (left := deadline - time.monotonic()) > 0:
        # of nonsense python-can complains
        with contextlib.suppress(can.CanOperationError):
            frame = bus.recv(left)
            if frame is not None and frame.arbitration_id == identifier:
                return frame
    raise AssertionError(f"no {identifier:03X}")


def read_identity(group, node_id):
    """python-canopen reads from a valve over the group."""
    network = canopen.Network()
    network.connect(interface="udp_multicast", channel=group, port=PORT)
    node = network.add_node(node_id, canopen.ObjectDictionary())
    node.sdo.RESPONSE_TIMEOUT = PATIENCE
    try:
        return node.sdo.upload(0x1018, 1).hex()
    finally:
        network.disconnect()


def group():
    """A valve in each simulator, both read by python-canopen; each frame passes once; what is no frame is told once."""
    address = "239.74.163.2"
    run("ip", "link", "set", "lo", "multicast", "on")
    run("ip", "route", "add", "239.0.0.0/8", "dev", "lo")
    url = f"udp-multicast://{address}:{PORT}"
    with (
        can.Bus(interface="udp_multicast", channel=address, port=PORT) as bus,
        simulator(url, "--device", "pvea-canopen@0x22") as (one, said),
    ):
        equal("boot-up", hear(bus, 0x722).data.hex(), "00")
        with simulator(url, "--device", "pvea-canopen@0x23") as (two, _):
            equal("boot-up", hear(bus, 0x723).data.hex(), "00")
            take(one, lambda line: " 723#00" in line)
            for node_id in (0x22, 0x23):
                equal("vendor", read_identity(address, node_id), "19000001")
            with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as stranger:
                stranger.sendto(b"GET / HTTP/1.1", (address, PORT))
                stranger.sendto(bytes([0x91]) * 4096, (address, PORT))
            bus.send(can.Message(arbitration_id=0x100, is_fd=True, data=bytes(64)))
            for sent, traced in (
                (can.Message(arbitration_id=0x18FF0AE0, data=[1]), "18FF0AE0#01"),
                (can.Message(arbitration_id=0x321, is_extended_id=False, is_remote_frame=True, dlc=2), "321#R2"),
                (can.Message(arbitration_id=0x7F0, is_extended_id=False), "7F0#"),
            ):
                bus.send(sent)
                for trace in (one, two):
                    _, before = take(trace, lambda line: line.split()[2] == traced)
                    frames = [line.split()[2] for line in before]
                    assert len(set(frames)) == len(frames), f"a frame came back: {frames}"
            # python-can hears its own frames; of the simulators none passes them on
            seen = [hear(bus, 0x7F0)]
            while (frame := bus.recv(0.5)) is not None:
                seen.append(frame)
            equal("frames", [hex(frame.arbitration_id) for frame in seen], ["0x7f0"])
            take(said, lambda line: line == f"pve-sim: {url}: ignored a datagram that is not a python-can message. Further datagrams are ignored without a warning")
    told = []
    while not said.empty():
        told.append(said.get())
    equal("told more than once", [line for line in told if "ignored" in line], [])


faulthandler.dump_traceback_later(LIFE, exit=True)
{subject.__name__: subject for subject in (group,)}[sys.argv[1]]()
