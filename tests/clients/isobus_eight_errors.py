"""A tractor by can-j1939 in each of the eight communication errors of IEC 61784-3: what it notices, and what it takes for true.
Arguments: HOST PORT CHANNEL, and the URL of the control interface. The valve has the name boom; arm is at the next address.
"""

import contextlib
import sys

import j1939

from control import Control
from tractor import AVC, AVEF, DM1, DM2, TRACTOR, VALVE, claimed, connected, equal, take

AVEF_GROUP = AVEF.frame_id >> 8 & 0xFFFF
ANNOUNCEMENT, PACKET = 0x1CECFF00 | VALVE, 0x1CEBFF00 | VALVE
ARM_AVEF = AVEF.frame_id + 0x101
#: How long can-j1939 waits for the next packet unless it is told otherwise, seconds.
USUAL_T1 = 0.750
#: Longer than that even when virtual time passes as fast as the wall clock.
LATE_MS = 2000


def messages(tractor, group):
    """What can-j1939 has told its subscriber of this group so far."""
    told = []
    while not tractor.received.empty():
        told.append(tractor.received.get())
    return [data for pgn, source, data in told if (pgn, source) == (group, VALVE)]


def packets(ear):
    """The seven bytes of each packet of the next transfer, in the order of their numbers."""
    ear.expect(ANNOUNCEMENT)
    frames = [bytes(ear.expect(PACKET).data) for _ in range(2)]
    return [frame[1:] for frame in sorted(frames)]


def whole(tractor, ear):
    """Requests DM2 of two faults, which takes two packets: they come, and can-j1939 has the message."""
    ear.forget()
    tractor.request(DM2)
    data = tractor.expect(DM2)
    equal("DM2", data, b"".join(packets(ear))[:10])
    return data


def two_faults(tractor, ear, control):
    for supply_mv, failure in ((8_000, 4), (40_000, 3)):
        control.plant("boom", supply_mv=supply_mv)
        ear.expect(0x18FECA00 | VALVE, lambda data: data[4] & 0x1F == failure)
    control.plant("boom", supply_mv=24_000)
    ear.expect(0x18FECA00 | VALVE, lambda data: data[2:6] == bytes(4))
    # DM2 has a fault once the shutdown is over: after two neutral set-points
    for _ in range(3):
        ear.expect(AVC.frame_id)
    whole(tractor, ear)


def corruption(tractor, ear, control):
    tractor.drive("extend", 50)
    ear.expect_flow("extend", extend=50)
    with control.fault(corrupt=f"{AVEF.frame_id:08X}", data={"toggle": "00 00 03"}, count=1):
        data = ear.expect(AVEF.frame_id, lambda data: AVEF.decode(data)["State"] == "retract").data
        take(tractor.received, lambda message: message == (AVEF_GROUP, VALVE, bytes(data)))
    equal("command", control.call("GET", "/devices/boom")["command"], "extend")
    return "passes the AVEF with changed bits to its subscriber: retract, from a valve that extends"


def repetition(tractor, ear, control):
    with control.fault(repeat=f"{PACKET:08X}", count=1):
        ear.forget()
        tractor.request(DM2)
        told = tractor.expect(DM2)
        ear.expect(ANNOUNCEMENT)
        first, copy, _ = (bytes(ear.expect(PACKET).data) for _ in range(3))
    equal("copy", copy, first)
    equal("DM2", told, (first[1:] + copy[1:])[:10])
    return "takes the copy of a packet for the next packet, and passes a DM2 to its subscriber that the valve has not sent"


def sequence(tractor, ear, control):
    # an AVEF may be the next frame of the valve: a swap could leave the packets in their order
    with control.fault(delay=f"{PACKET:08X}", ms=150, overtake=True, count=1):
        ear.forget()
        tractor.request(DM2)
        told = tractor.expect(DM2)
        first, second = packets(ear)
    equal("DM2", told, (second + first)[:10])
    return "ignores the number of a packet, and passes a DM2 with exchanged parts to its subscriber"


def loss(tractor, ear, control):
    with control.fault(lose=f"{PACKET:08X}", receivers=["the gateway"], count=1):
        ear.forget()
        tractor.request(DM2)
        ear.expect(ANNOUNCEMENT)
        equal("number of the packet that came", ear.expect(PACKET).data[0], 2)
    equal("messages", messages(tractor, DM2), [])
    whole(tractor, ear)
    return "never reports a message with a lost packet; the next request is answered"


def delay(tractor, ear, control):
    with usual_timeout(), control.fault(delay=f"{PACKET:08X}", ms=LATE_MS, count=1):
        ear.forget()
        tractor.request(DM2)
        packets(ear)
    equal("messages", messages(tractor, DM2), [])
    whole(tractor, ear)
    return f"abandons the transfer after {USUAL_T1} s without an error; ignores late packets"


@contextlib.contextmanager
def usual_timeout():
    timeout = j1939.j1939_21.J1939_21.Timeout
    patient, timeout.T1 = timeout.T1, USUAL_T1
    try:
        yield
    finally:
        timeout.T1 = patient


def masquerade(tractor, ear, control):
    stranger = bytes.fromhex("7d7d30ffffffffff")
    tractor.drive("extend", 50)
    ear.expect_flow("extend", extend=50)
    with control.fault(masquerade=f"{AVEF.frame_id:08X}#7D7D 30FF FFFF FFFF", every_ms=100, count=3):
        take(tractor.received, lambda message: message == (AVEF_GROUP, VALVE, stranger))
        # the claim is for the controllers on the bus alone
        ear.expect(claimed(VALVE))
        ear.expect_flow("extend", extend=50)
        for _ in range(2):
            ear.expect(AVEF.frame_id, stranger)
    return "passes the AVEFs of both senders to its subscriber, but reports the address claim of the valve to nobody"


def addressing(tractor, ear, control):
    tractor.drive("extend", 50)
    ear.expect_flow("extend", extend=50)
    with control.fault(corrupt="0CFE3327", identifier={"toggle": "00000700"}):
        ear.expect(ARM_AVEF, lambda data: data[2] & 0x0F == 1)
        # a DM1 without a fault may come before, from a tractor that was held up
        take(tractor.received, lambda message: message[:2] == (DM1, VALVE) and message[2].hex().startswith("04ffe98f"))
    return "does not notice; its subscriber gets the DM1 of one valve and the AVEF of the other valve"


def insertion(tractor, ear, control):
    tractor.stop_commands()
    with control.fault(insert="18EEFF27#0000 0000 0000 0000"):
        tractor.wait_for_state(j1939.ControllerApplication.State.CANNOT_CLAIM)
        ear.expect(claimed(0xFE))
    try:
        tractor.send_command()
    except RuntimeError as error:
        equal("error", str(error), "Could not send message unless address claiming has finished")
    else:
        raise AssertionError("an AVC was sent without an address")
    return "gives up its address after a stranger's claim with a lower NAME; raises an error for each later transmission"


#: Insertion is the last one, because the tractor loses its address.
ERRORS = {
    "corruption": corruption,
    "unintended repetition": repetition,
    "incorrect sequence": sequence,
    "loss": loss,
    "unacceptable delay": delay,
    "masquerade": masquerade,
    "addressing": addressing,
    "insertion": insertion,
}

with connected() as (tractor, ear):
    control = Control(sys.argv[4])
    tractor.wait_until_claimed()
    equal("address", tractor.ca.device_address, TRACTOR)
    tractor.start_commands()
    two_faults(tractor, ear, control)
    for name, error in ERRORS.items():
        ear.forget()
        messages(tractor, DM2)
        print(f"{name}: {error(tractor, ear, control)}", flush=True)
        tractor.drive("blocked")
