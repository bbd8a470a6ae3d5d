"""A python-canopen master in each of the eight communication errors of IEC 61784-3: what it notices, and what it takes for
true. Arguments: HOST PORT CHANNEL, and the URL of the control interface. The valve has the name boom; arm is at ARM.
"""

import sys

import canopen

from control import Control
from valve import ACTIVE, HOLD, NODE_ID, PATIENCE, connected, equal

ARM = 0x21
HEARTBEAT, SDO_ANSWER, EMCY = 0x700 + NODE_ID, 0x580 + NODE_ID, 0x080 + NODE_ID
#: The vendor of the identity, and the same with another bit.
VENDOR, ANOTHER = 0x01000019, 0x01000018
DEVICE_TYPE = 0x198
#: How long python-canopen waits for an answer unless it is told otherwise, seconds.
USUAL = 0.3
#: Longer than that even when virtual time passes as fast as the wall clock.
LATE_MS = 2000


def status(valve):
    """The status word in the last TPDO that python-canopen has."""
    return valve.node.tpdo[1][0x6041].raw


def unanswered(valve, index):
    """Reads an object with python-canopen's usual patience: there is no answer in time."""
    valve.node.sdo.RESPONSE_TIMEOUT = USUAL
    try:
        value = valve.node.sdo[index].raw
    except canopen.SdoCommunicationError as error:
        equal("error", str(error), "No SDO response received")
    else:
        raise AssertionError(f"{index:04X} was answered: {value}")
    finally:
        valve.node.sdo.RESPONSE_TIMEOUT = PATIENCE


def corruption(valve, control):
    with control.fault(corrupt="5A0", data={"toggle": "00 00 00 00 01"}, count=1):
        equal("vendor", valve.node.sdo[0x1018][1].raw, ANOTHER)
    with control.fault(corrupt="5A0", data={"toggle": "00 01"}, count=1):
        try:
            valve.node.sdo[0x1018][1].raw
        except canopen.SdoCommunicationError as error:
            assert str(error).startswith("Node returned a value for 0x1019"), error
        else:
            raise AssertionError("an answer for another object was taken")
    # the next TPDO would replace the position
    valve.node.rpdo[1].stop()
    valve.until_now()
    valve.heard.forget()
    with control.fault(corrupt="1A0", data={"toggle": "00 00 00 20"}, count=1):
        valve.command(0x0F)
        valve.expect_status(ACTIVE, 0x2000)
        equal("position", valve.node.tpdo[1][0x6301].raw, 0x2000)
    return "accepts a value with a changed bit, in an SDO answer and in a TPDO; raises an error for an answer about a different object"


def repetition(valve, control):
    valve.node.rpdo[1].stop()
    valve.until_now()
    valve.heard.forget()
    received = []
    valve.node.tpdo[1].add_callback(lambda pdo: received.append(bytes(pdo.data)))
    with control.fault(repeat="1A0", count=1):
        valve.command(0x0F)
        for _ in range(2):
            valve.expect_status(ACTIVE)
    valve.node.tpdo[1].callbacks.clear()
    equal("calls", len(received), 2)
    valve.heard.forget()
    with control.fault(repeat="5A0", count=1):
        equal("vendor", valve.node.sdo[0x1018][1].raw, VENDOR)
        for _ in range(2):
            valve.heard.expect(SDO_ANSWER, lambda data: True)
    # the copy waits where the next answer comes
    equal("device type", valve.node.sdo[0x1000].raw, DEVICE_TYPE)
    return "calls back for each copy of a TPDO; drops the copy of an SDO answer at the next request"


def sequence(valve, control):
    valve.node.rpdo[1].stop()
    valve.command(0x0F)
    valve.until_now()
    valve.heard.forget()
    with control.fault(swap="1A0", count=1):
        valve.command(0x0B)
        valve.command(0x0F)
        valve.expect_status(ACTIVE)
        valve.expect_status(HOLD)
    equal("status word of the TPDO", status(valve), HOLD)
    # the quickest way to ask: without set-points, the valve stays active for 250 ms
    equal("state", control.call("GET", "/devices/boom")["dsm"], "active")
    return "keeps the older TPDO, which came last: HOLD, from a valve in ACTIVE"


def loss(valve, control):
    with control.fault(lose="5A0", receivers=["the gateway"], count=1):
        unanswered(valve, 0x6041)
    equal("status word", valve.node.sdo[0x6041].raw, ACTIVE)
    with control.fault(lose="1A0"):
        # the TPDOs from before the fault are read first
        valve.until_now()
        equal("time of a TPDO", valve.node.tpdo[1].wait_for_reception(timeout=USUAL), None)
        equal("status word of the TPDO", status(valve), ACTIVE)
    return f"an SDO request fails after {USUAL} s without a retry; without TPDOs, the last TPDO remains as if it were new"


def delay(valve, control):
    with control.fault(delay="5A0", ms=LATE_MS, count=1):
        unanswered(valve, 0x6041)
        valve.node.rpdo[1].stop()
        valve.command(0x0B)
        valve.expect_status(HOLD)
        equal("status word of the first request", valve.node.sdo[0x6041].raw, ACTIVE)
    equal("status word", valve.node.sdo[0x6041].raw, HOLD)
    # the answer to one request may have been taken for the answer to the next
    valve.heard.until(SDO_ANSWER, times=3)
    return "the request fails; the late answer is taken for the answer to the next request: ACTIVE, from a valve in HOLD"


def insertion(valve, control):
    valve.node.sdo[0x1017].raw = 100
    valve.node.nmt.wait_for_heartbeat(PATIENCE)
    equal("NMT state", valve.node.nmt.state, "OPERATIONAL")
    with control.fault(insert="000#0220"):
        valve.heard.expect(HEARTBEAT, bytes([4]))
        valve.node.nmt.wait_for_heartbeat(PATIENCE)
    equal("NMT state", valve.node.nmt.state, "STOPPED")
    equal("EMCYs", valve.node.emcy.active, [])
    unanswered(valve, 0x6041)
    return "detects only by the heartbeat that a stranger has stopped the valve"


def masquerade(valve, control):
    valve.node.sdo[0x1017].raw = 100
    valve.heard.expect(HEARTBEAT, bytes([5]))
    with control.fault(masquerade="720#05", every_ms=100):
        control.power("boom", False)
        valve.until_now(ARM)
        valve.heard.forget()
        valve.heard.expect(HEARTBEAT, bytes([5]))
        valve.node.nmt.wait_for_heartbeat(PATIENCE)
        equal("NMT state", valve.node.nmt.state, "OPERATIONAL")
        unanswered(valve, 0x6041)
    valve.heard.forget()
    control.power("boom", True)
    valve.expect_boot(valve.node)
    return "takes a stranger's heartbeat for the heartbeat of a valve without power"


def addressing(valve, control):
    arm = valve.at(ARM)
    arm.tpdo.read()
    arm.nmt.state = "OPERATIONAL"
    valve.node.emcy.reset()
    valve.heard.forget()
    with control.fault(corrupt="220", identifier={"toggle": "001"}):
        valve.expect_status(ACTIVE, node=arm)
        # the fourth byte counts the time guardings: a client that is held up may have caused one before
        valve.heard.expect(EMCY, lambda data: data[:3] == bytes.fromhex("038091"))
        # the first set-point after the fault would end it
        equal("active EMCYs", [hex(emcy.code) for emcy in valve.node.emcy.active], ["0x8003"])
        equal("status word of arm", arm.tpdo[1][0x6041].raw, ACTIVE)
    valve.node.rpdo[1].stop()
    return "does not notice; its EMCY consumer gets the time guarding of one valve, and its TPDO the movement of the other valve"


ERRORS = {
    "corruption": corruption,
    "unintended repetition": repetition,
    "incorrect sequence": sequence,
    "loss": loss,
    "unacceptable delay": delay,
    "insertion": insertion,
    "masquerade": masquerade,
    "addressing": addressing,
}

with connected() as valve:
    control = Control(sys.argv[4])
    for name, error in ERRORS.items():
        valve.boot_to_active()
        print(f"{name}: {error(valve, control)}", flush=True)
        valve.node.rpdo[1].stop()
        if control.call("GET", "/devices/boom")["nmt"] == "operational":
            valve.node.sdo[0x1017].raw = 0
