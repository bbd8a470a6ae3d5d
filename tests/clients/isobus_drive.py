"""Drives the valve with AVCs that cantools writes and can-j1939 sends; reads AVEF with the same DBC."""

from tractor import AVEF, DM1, connected, equal

#: A state that no valve has.
UNKNOWN = 4
#: DM1: time guarding, for the first time.
TIME_GUARDING = bytes.fromhex("04ffe98f9301ffff")

with connected() as (tractor, ear):
    tractor.wait_until_claimed()
    ear.expect_flow("blocked")
    tractor.start_commands()

    tractor.drive("extend", 50)
    ear.expect_flow("extend", extend=50)
    tractor.drive("retract", 100)
    ear.expect_flow("retract", retract=100)
    tractor.drive("retract", 33.2)
    ear.expect_flow("retract", retract=33)
    tractor.drive("float")
    ear.expect_flow("float", extend=100)
    tractor.drive("hand operation")
    ear.expect_flow("hand operation")
    tractor.drive("emergency stop")
    ear.expect_flow("emergency stop")
    tractor.drive("extend", 100)
    ear.expect_flow("extend", extend=100)

    # what an AVEF has nothing to say in says that it is not available
    frame = ear.expect(AVEF.frame_id)
    equal("bytes 3 to 8", bytes(frame.data[2:]).hex(), "31" + 5 * "ff")

    # an AVC of an unknown state is ignored as a whole: it does not feed the time guard either
    tractor.drive(UNKNOWN)
    equal("DM1", tractor.expect(DM1), TIME_GUARDING)
    ear.expect_flow("blocked")
