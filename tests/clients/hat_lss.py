"""LSS with several sensors and a blank valve on one bus: inquire, identify remote slave, fast scan, a new node ID."""

import struct

from canopen import lss as service
from encoder import PRODUCT, REVISION, VENDOR, at
from valve import BOOT_UP, connected, equal

#: Serial numbers of the sensor at node 1, the one at node 2, and the blank one.
SERIALS = 1, 2, 7
NEW_ID = 0x30
REQUEST, ANSWER = 0x7E5, 0x7E4


def let_answer(valve):
    """What was sent before is answered by the second of these reads: the answer to the first may go before LSS."""
    for _ in range(2):
        valve.network.nodes[1].sdo[0x1000].raw


def identified(valve, revisions, serials):
    """How many sensors answer to identify remote slave with these limits, which are inclusive."""
    valve.heard.forget()
    for command, number in zip(range(0x46, 0x4C), (VENDOR, PRODUCT, *revisions, *serials)):
        valve.network.send_message(REQUEST, struct.pack("<BI3x", command, number))
    let_answer(valve)
    heard = [bytes(frame.data) for frame in valve.heard.all() if frame.arbitration_id == ANSWER]
    equal("answers", set(heard) - {bytes([0x4F]) + bytes(7)}, set())
    return len(heard)


with connected() as valve:
    lss = valve.network.lss
    sensor, second = at(valve, 1), at(valve, 2)
    equal("serials", (sensor.sdo[0x1018][4].raw, second.sdo[0x650B].raw), SERIALS[:2])

    # frames that say the same at the same instant are one on the bus: one answer at least, and none for limits that miss
    assert identified(valve, (REVISION, REVISION), (0, 0xFFFFFFFF)) >= 1
    assert identified(valve, (REVISION, REVISION), (2, 2)) == 1
    assert identified(valve, (REVISION, REVISION), (3, 6)) == 0
    assert identified(valve, (REVISION + 1, 0xFFFFFFFF), (0, 0xFFFFFFFF)) == 0

    assert lss.send_switch_state_selective(VENDOR, PRODUCT, REVISION, SERIALS[1]), "not selected"
    wanted = (VENDOR, PRODUCT, REVISION, SERIALS[1])
    commands = (
        service.CS_INQUIRE_VENDOR_ID,
        service.CS_INQUIRE_PRODUCT_CODE,
        service.CS_INQUIRE_REVISION_NUMBER,
        service.CS_INQUIRE_SERIAL_NUMBER,
    )
    equal("inquired", tuple(lss.inquire_lss_address(command) for command in commands), wanted)
    equal("inquired node ID", lss.inquire_node_id(), 2)
    lss.send_switch_state_global(lss.WAITING_STATE)

    # in waiting the blank sensor alone takes part: the blank valve does in configuration only
    found, identity = valve.fast_scan(lambda: let_answer(valve))
    assert found, "no blank sensor found"
    equal("identity", identity, [VENDOR, PRODUCT, REVISION, SERIALS[2]])
    lss.configure_node_id(NEW_ID)
    lss.store_configuration()
    valve.heard.forget()
    lss.send_switch_state_global(lss.WAITING_STATE)
    valve.heard.expect(0x700 + NEW_ID, BOOT_UP)
    equal("1018:4", at(valve, NEW_ID).sdo[0x1018][4].raw, SERIALS[2])
