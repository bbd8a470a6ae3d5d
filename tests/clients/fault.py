"""Starves the time guard, and brings the valve back with the frames of use case 2."""

import canopen

from valve import ACTIVE, CYCLE, FAULT_HOLD, HOLD, NO_ERROR, NODE_ID, connected, equal

TIME_GUARD = 0.250

with connected() as valve:
    valve.boot_to_active()
    sdo, emcy = valve.node.sdo, valve.node.emcy
    valve.node.rpdo[1][0x6300].raw = 16384
    valve.expect_status(ACTIVE, 16384)

    # no more set-points: the bus time from the answer to the last one to the EMCY is the time guard
    valve.node.rpdo[1].stop()
    alarm = valve.heard.expect(0x080 + NODE_ID, lambda data: data != NO_ERROR)
    equal("EMCY", bytes(alarm.data).hex(), "0380910100000000")
    equal("active EMCYs", [(hex(e.code), e.register, e.data[0]) for e in emcy.active], [("0x8003", 0x91, 1)])
    last = valve.node.tpdo[1].timestamp
    assert TIME_GUARD - 0.01 < alarm.timestamp - last < TIME_GUARD + 0.01, f"{alarm.timestamp - last} s"

    equal("6041", sdo[0x6041].raw, FAULT_HOLD)
    equal("1001", sdo[0x1001].raw, 0x91)
    equal("2023", sdo[0x2023].raw, 1)
    equal("1003:0", sdo[0x1003][0].raw, 1)
    equal("1003:1", sdo[0x1003][1].raw, 0x0001_8003)

    # the first reset message brings a valid set-point, so the cause is gone; the second leaves FAULT_HOLD
    valve.command(0x03)
    valve.heard.expect(0x080 + NODE_ID, NO_ERROR)
    valve.expect_status(FAULT_HOLD)
    equal("active EMCYs", emcy.active, [])
    valve.command(0x0B)
    valve.expect_status(HOLD)
    valve.command(0x0F)
    valve.expect_status(ACTIVE)
    valve.node.rpdo[1].start(CYCLE)
    valve.node.rpdo[1][0x6300].raw = -4096
    valve.expect_status(ACTIVE, -4096)

    # the history survives a reset of communication, which holds the valve, and goes when it is told to
    valve.node.rpdo[1].stop()
    valve.heard.forget()
    valve.node.nmt.state = "RESET COMMUNICATION"
    valve.expect_boot(valve.node)
    equal("6041", sdo[0x6041].raw, FAULT_HOLD)
    history = sdo[0x1003][0].raw
    assert history >= 1, "the error history did not survive"
    sdo[0x1003][0].raw = 0
    equal("1003:0", sdo[0x1003][0].raw, 0)
    try:
        sdo[0x1003][1].raw
    except canopen.SdoAbortedError as abort:
        equal("abort", abort.code, 0x08000024)
    else:
        raise AssertionError("an empty error history was read")
