"""Maps other objects into the PDOs: in CiA 301's order, which is that of python-canopen's mapping API, and in the manual's."""

import struct

from canopen.objectdictionary import ODVariable, datatypes

from valve import (
    DISABLED,
    HOLD,
    INIT,
    INVALID,
    MAPPING_TOO_LONG,
    NODE_ID,
    NOT_MAPPABLE,
    PATIENCE,
    WRONG_STATE,
    aborted,
    connected,
    equal,
)

OFF = 1 << 31
#: What stands for a gap in a mapping: a data type, of one bit and of eight.
BIT, DUMMY = 0x0001, 0x0005

RPDO, TPDO = 0x200 + NODE_ID, 0x180 + NODE_ID


def entries(mapping):
    return [f"{mapping[sub].raw:08X}" for sub in range(1, mapping[0].raw + 1)]


def answered(valve, request, wanted):
    """An RPDO is answered with a TPDO of these bytes, in hex."""
    valve.heard.forget()
    valve.network.send_message(valve.node.rpdo[1].cob_id, bytes.fromhex(request))
    answer = valve.heard.expect(valve.node.tpdo[1].cob_id, lambda data: True)
    equal(f"answer to {request}", answer.data.hex(" "), wanted)


def by_the_api(valve):
    """CiA 301's order: PDO off, number of entries 0, entries, number, PDO on."""
    node = valve.node
    tpdo, rpdo = node.tpdo[1], node.rpdo[1]
    tpdo.clear()
    for place in ((0x6041,), (0x3304,), (0x6301, 1), (0x3302,), (0x3301,)):
        tpdo.add_variable(*place)
    tpdo.save()
    equal("1A00", entries(node.sdo[0x1A00]), ["60410010", "33040010", "63010110", "33020008", "33010008"])

    rpdo.clear()
    for place in ((0x6300, 1), (DUMMY, 0), (0x6042,), (0x6040,)):
        rpdo.add_variable(*place)
    rpdo.rtr_allowed = False
    rpdo.save()
    equal("1600", entries(node.sdo[0x1600]), ["63000110", "00050008", "60420008", "60400010"])
    equal("1400:1", node.sdo[0x1400][1].raw, 0x4000_0000 | RPDO)

    # what python-canopen reads back is what it has written
    written = [variable.name for variable in (*tpdo, *rpdo)]
    node.tpdo.read()
    node.rpdo.read()
    equal("read back", [variable.name for variable in (*tpdo, *rpdo)], written)

    # the device mode and the set-point are at other places of the frame now, and so is the status word
    rpdo[0x6300].raw = -2000
    rpdo[0x6042].raw = 2
    rpdo[0x6040].raw = 0x0001
    equal("frame", rpdo.data.hex(" "), "30 f8 00 02 01 00")
    with tpdo.receive_condition:
        rpdo.transmit()
        assert tpdo.wait_for_reception(PATIENCE), "no TPDO"
    equal("6041, of the TPDO", tpdo[0x6041].raw, DISABLED)
    equal("length of the TPDO", len(tpdo.data), 8)
    equal("6042", node.sdo[0x6042].raw, 2)
    equal("6300:1", node.sdo[0x6300][1].raw, -2000)
    # one that is too short is not looked at: the next TPDO is the answer to the next RPDO
    valve.heard.forget()
    valve.network.send_message(rpdo.cob_id, bytes.fromhex("00 00 00 01 03"))
    valve.network.send_message(rpdo.cob_id, bytes.fromhex("00 00 00 01 03 00"))
    first = valve.heard.expect(tpdo.cob_id, lambda data: True)
    equal("status", first.data[0], HOLD)


def by_hand(valve):
    """The manual's order: PDO off, number of entries 0, number, entries, PDO on."""
    sdo = valve.node.sdo
    for parameter, mapping, cob_id, objects in (
        (0x1400, 0x1600, RPDO, (0x60400010, 0x33000008, 0x60420008, 0x33030010)),
        (0x1800, 0x1A00, TPDO, (0x33010008, 0x60410010, 0x00010001, 0x00010001)),
    ):
        sdo[parameter][1].raw = OFF | cob_id
        sdo[mapping][0].raw = 0
        sdo[mapping][0].raw = len(objects)
        for sub, entry in enumerate(objects, 1):
            sdo[mapping][sub].raw = entry
        sdo[parameter][1].raw = cob_id
        equal(f"{mapping:04X}", entries(sdo[mapping]), [f"{entry:08X}" for entry in objects])
    valve.node.rpdo.read()
    valve.node.tpdo.read()
    # of two set-points the last wins; the two bits of gap take a byte of their own
    answered(valve, "01 00 40 01 0c fe", "00 09 00 00")
    equal("3303", sdo[0x3303].raw, -500)
    # an invalid set-point is dropped, and the one before it stands; an invalid mode is dropped, and the rest acts
    answered(valve, "03 00 40 05 e9 03", "00 0b 00 00")
    equal("3300", sdo[0x3300].raw, 64)
    equal("6042", sdo[0x6042].raw, 1)
    # a longer one is cut
    answered(valve, "01 00 00 01 00 00 ff ff", "00 09 00 00")


def what_does_not_fit(valve):
    node = valve.node
    tpdo, rpdo = node.tpdo[1], node.rpdo[1]
    before = entries(node.sdo[0x1A00])
    # while it is on, nothing but its transmission type and the switch
    for sub, value in ((0, 0), (1, 0x63010110)):
        with aborted(WRONG_STATE):
            node.sdo[0x1A00][sub].raw = value
    with aborted(WRONG_STATE):
        node.sdo[0x1800][1].raw = 0x280 + NODE_ID
    equal("1A00", entries(node.sdo[0x1A00]), before)

    # not there, not mappable, of the other direction, of another length
    tpdo.cob_id = TPDO
    for place in ((0x1017,), (0x6040,), (0x6300, 1), (0x6041, 0, 8), (0x6301, 1, 32)):
        tpdo.clear()
        tpdo.add_variable(*place)
        with aborted(NOT_MAPPABLE):
            tpdo.save()
        assert node.sdo[0x1800][1].raw & OFF, "on, although its mapping was refused"
    for place in ((0x6041,), (0x6301, 1), (0x6042, 0, 16)):
        rpdo.clear()
        rpdo.add_variable(*place)
        with aborted(NOT_MAPPABLE):
            rpdo.save()

    # 64 bits are as many as there are
    tpdo.clear()
    for _ in range(4):
        tpdo.add_variable(0x6301, 1)
    tpdo.save()
    tpdo.add_variable(0x3301)
    with aborted(MAPPING_TOO_LONG):
        tpdo.save()
    with aborted(MAPPING_TOO_LONG):
        node.sdo[0x1A00][0].raw = 9


def another_identifier(valve):
    """The identifier changes while the PDO is off, so it takes two steps."""
    node = valve.node
    tpdo = node.tpdo[1]
    node.tpdo.read()
    tpdo.clear()
    tpdo.add_variable(0x6041)
    tpdo.enabled = False
    tpdo.save()
    equal("1800:1", node.sdo[0x1800][1].raw, OFF | TPDO)
    tpdo.cob_id, tpdo.enabled = 0x1FF, True
    tpdo.save()
    equal("1800:1", node.sdo[0x1800][1].raw, 0x1FF)
    answered(valve, "00 00 00 00", "08 00")
    # one of those that are for other services is refused
    tpdo.enabled = False
    tpdo.save()
    tpdo.cob_id, tpdo.enabled = 0x580 + NODE_ID, True
    with aborted(INVALID):
        tpdo.save()


def defaults_return(valve):
    """What was not stored is lost at the next reset."""
    valve.heard.forget()
    valve.node.nmt.state = "RESET COMMUNICATION"
    valve.expect_boot(valve.node)
    valve.node.rpdo.read()
    valve.node.tpdo.read()
    equal("1600", entries(valve.node.sdo[0x1600]), ["60400010", "63000110"])
    equal("1A00", entries(valve.node.sdo[0x1A00]), ["60410010", "63010110"])
    equal("COB-IDs", (valve.node.rpdo[1].cob_id, valve.node.tpdo[1].cob_id), (RPDO, TPDO))


def operational(valve):
    """Resets the application, so that a walk begins in INIT; the parameters are the defaults then."""
    valve.reset()
    valve.node.rpdo.read()
    valve.node.tpdo.read()
    valve.node.nmt.state = "OPERATIONAL"


with connected() as valve:
    for index, data_type in ((BIT, datatypes.BOOLEAN), (DUMMY, datatypes.UNSIGNED8)):
        dummy = ODVariable(f"dummy {index}", index, 0)
        dummy.data_type = data_type
        valve.node.object_dictionary.add_object(dummy)

    operational(valve)
    answered(valve, "00 00 d2 04", struct.pack("<Hh", INIT, 0).hex(" "))
    by_the_api(valve)
    operational(valve)
    by_hand(valve)
    operational(valve)
    what_does_not_fit(valve)
    operational(valve)
    another_identifier(valve)
    defaults_return(valve)
