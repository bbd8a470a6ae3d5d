"""Claims the valve's address, with a NAME above the valve's, then with one below; HOST PORT CHANNEL PHASE."""

import sys

import j1939

from tractor import AGRICULTURE, ALL, AVC, AVEF, CLAIM, MARINE, NULL, ON_HIGHWAY, VALVE, VALVE_NAME
from tractor import claimed, connected, equal, name_bytes

CANNOT_CLAIM = j1939.ControllerApplication.State.CANNOT_CLAIM
#: What the valve that lost its address is commanded to.
NEW = 0x85


def higher():
    """The valve defends its address, and goes on; the contender cannot claim."""
    with connected(address=VALVE, industry_group=MARINE) as (tractor, ear):
        own = name_bytes(tractor.name)
        ear.expect(claimed(VALVE), own)
        ear.expect(claimed(VALVE), VALVE_NAME)
        tractor.give_way(ear)
        ear.expect(claimed(NULL), own)
        tractor.wait_for_state(CANNOT_CLAIM)
        ear.expect_flow("blocked")
        ear.expect_flow("blocked")


def arbitrary():
    """A contender that can takes the next address, and both go on."""
    with connected(address=VALVE, industry_group=AGRICULTURE, arbitrary=True) as (tractor, ear):
        own = name_bytes(tractor.name)
        ear.expect(claimed(VALVE), own)
        ear.expect(claimed(VALVE), VALVE_NAME)
        tractor.give_way(ear)
        ear.expect(claimed(VALVE + 1), own)
        tractor.wait_until_claimed()
        equal("address", tractor.ca.device_address, VALVE + 1)
        # a bus has one AVC for a valve, from whatever source
        tractor.drive("extend", 50)
        tractor.start_commands()
        ear.expect_flow("extend", extend=50)


def lower():
    """The valve loses its address, is silent, and takes a commanded address."""
    with connected(address=VALVE, industry_group=ON_HIGHWAY) as (tractor, ear):
        own = name_bytes(tractor.name)
        claim = ear.expect(claimed(VALVE), own)
        lost = ear.expect(claimed(NULL), VALVE_NAME, without=[AVEF.frame_id])
        assert lost.timestamp - claim.timestamp <= 0.154, f"{lost.timestamp - claim.timestamp} s"
        tractor.wait_until_claimed()
        equal("address", tractor.ca.device_address, VALVE)

        # a second of the bus's time: not a frame of the valve, although it is told to move
        tractor.drive("extend", 50)
        tractor.start_commands()
        command = 0x0CFE3000 | (VALVE & 0xF) << 8 | VALVE
        start = ear.expect(command)
        quiet = [AVEF.frame_id, claimed(NULL)]
        while ear.expect(command, without=quiet).timestamp - start.timestamp < 1:
            pass

        # asked who is there, it says again that it has none
        tractor.request(CLAIM, ALL)
        ear.expect(claimed(NULL), VALVE_NAME, without=[AVEF.frame_id])

        # by its NAME it is given another one, in packets
        tractor.stop_commands()
        tractor.ca.send_pgn(0, 0xFE, 0xD8, 6, [*VALVE_NAME, NEW])
        claim = ear.expect(claimed(NEW), VALVE_NAME)
        flow = ear.expect(0x0CFE1500 | NEW)
        assert 0.250 <= flow.timestamp - claim.timestamp < 0.252, f"{flow.timestamp - claim.timestamp} s"
        equal("AVEF", AVEF.decode(flow.data)["State"], "blocked")


{"higher": higher, "arbitrary": arbitrary, "lower": lower}[sys.argv[4]]()
