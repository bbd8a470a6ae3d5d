"""python-can's `slcan` asks the adapter what it is, and two of its buses and one of socketcand hear each other."""

import sys

import can

import joining
from waiting import PATIENCE, equal

HOST, PORT, CHANNEL = sys.argv[1:4]


def message(identifier, data=(), **flags):
    return can.Message(arbitration_id=identifier, is_extended_id=identifier > 0x7FF, data=data, **flags)


def hear(bus):
    frame = bus.recv(PATIENCE)
    assert frame is not None, "nothing is heard"
    return frame.arbitration_id, frame.is_extended_id, frame.is_remote_frame, frame.dlc, bytes(frame.data)


def nothing(what, bus):
    """Nothing has come: the answer to a question follows all that came before, which python-can keeps."""
    bus.get_version(PATIENCE)
    while not bus._queue.empty():
        equal(what, bus.recv(0), None)


address = joining.address(HOST, PORT, CHANNEL)
# the address of the environment, and that of the command line beside it
with (
    can.Bus(**address) as one,
    can.Bus(**address) as two,
    can.Bus(interface="socketcand", host=HOST, port=int(PORT), channel=CHANNEL) as three,
):
    major, minor = one.get_version(PATIENCE)
    assert major == 10 and minor is not None, (major, minor)
    equal("serial number", one.get_serial_number(PATIENCE), "PVE0")
    # whoever has got an answer has an open channel
    two.get_version(PATIENCE)
    for sent in (message(0x123, [1, 2]), message(0x18FF0AE0), message(0x7FF, bytes(8))):
        one.send(sent)
        wanted = (sent.arbitration_id, sent.is_extended_id, False, sent.dlc, bytes(sent.data))
        equal("heard over slcan", hear(two), wanted)
        equal("heard over socketcand", hear(three), wanted)
    one.send(message(0x321, is_remote_frame=True, dlc=3))
    equal("remote frame", hear(two), (0x321, False, True, 3, b""))
    three.send(message(0x18FF0AE0, [7]))
    for bus in (one, two):
        equal("from socketcand", hear(bus), (0x18FF0AE0, True, False, 1, b"\x07"))
    nothing("an echo", one)

    # who only listens sends nothing
    with can.Bus(**address, listen_only=True) as listener:
        listener.get_version(PATIENCE)
        listener.send(message(0x100))
        two.send(message(0x101))
        equal("heard by who listens", hear(listener)[0], 0x101)
        equal("heard of who listens", hear(one)[0], 0x101)

    # at another bit rate the channel stays closed
    with can.Bus(**{**address, "bitrate": 500000}) as stranger:
        stranger.get_version(PATIENCE)
        stranger.send(message(0x100))
        two.send(message(0x102))
        equal("heard of a stranger", hear(one)[0], 0x102)
        nothing("heard by a stranger", stranger)
