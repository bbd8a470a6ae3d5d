"""Boots the valve through use case 1, moves its spool to every kind of set-point, and reads a string in segments."""

import sys

from valve import ACTIVE, FLOAT, connected, equal

PART_NUMBER = sys.argv[4]

with connected() as valve:
    valve.boot_to_active()
    sdo = valve.node.sdo
    set_point = valve.node.rpdo[1][0x6300]

    # to half the stroke, seen by every view of the actual value; conversions round half away from zero
    set_point.raw = 8192
    valve.expect_status(ACTIVE, 8192)
    equal("6301:1", sdo[0x6301][1].raw, 8192)
    equal("3301", sdo[0x3301].raw, 64)
    equal("3302", sdo[0x3302].raw, -64)
    equal("3304", sdo[0x3304].raw, 500)
    equal("3303", sdo[0x3303].raw, 500)

    # fully to the A-port, to float, home
    set_point.raw = -16384
    valve.expect_status(ACTIVE, -16384)
    set_point.raw = FLOAT
    valve.expect_status(ACTIVE, FLOAT)
    equal("3302 in float", sdo[0x3302].raw, -127)
    set_point.raw = 0
    valve.expect_status(ACTIVE, 0)

    equal("100A", sdo[0x100A].raw, f"APP-_S6m1_M_R132_CANOPEN-_{PART_NUMBER}_-000_ 180701")
    equal("1001", sdo[0x1001].raw, 0)
    equal("EMCYs", [hex(emcy.code) for emcy in valve.node.emcy.log if emcy.code], [])
