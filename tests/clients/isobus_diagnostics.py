"""Makes the valve fault from outside, and follows that by DM1, DM2 and DM3 with can-j1939's own parsers."""

import queue

import j1939

from tractor import ACKNOWLEDGEMENT, AVC, CYCLE, DBC, DM1, DM2, DM3, TRACTOR, VALVE, connected, equal, take

OFF = j1939.DtcLamp.OFF
AMBER, RED = "awl", "rsl"
NO_CODE = dict(spn=0, fmi=0, oc=0)
TIME_GUARDING, SPOOL = dict(spn=298985, fmi=19, oc=1), dict(spn=298988, fmi=7, oc=1)


def dm2(data):
    """Lamp byte and trouble codes, the latter as can-j1939 takes them apart."""
    words = [int.from_bytes(data[at : at + 4], "little") for at in range(2, len(data) - 3, 4)]
    dtcs = [j1939.DTC(dtc=word) for word in words]
    return data[0], [dict(spn=dtc.spn, fmi=dtc.fmi, oc=dtc.oc) for dtc in dtcs]


with connected() as (tractor, ear):
    tractor.wait_until_claimed()
    # the valve says nothing but its claim before that
    ear.expect_flow("blocked")
    told = queue.SimpleQueue()
    parser = j1939.Dm1(tractor.ca)
    parser.subscribe(lambda *message: told.put(message))

    def expect_dm1(lamp, code):
        """The next DM1 of the valve has this lamp alone, and this code alone; its time. Others may tell of theirs."""
        (_, lamps, dtcs, timestamp), _ = take(told, lambda message: message[0] == VALVE)
        lit = [name for name, state in lamps.items() if state != OFF]
        equal("DM1", (lit, dtcs), ([lamp] if lamp else [], [code]))
        return timestamp

    def recover():
        """Two neutral set-points with the spool in neutral; then the valve does what it is told."""
        tractor.drive("blocked")
        ear.forget()
        ear.expect_flow("blocked")
        for _ in range(3):
            ear.expect(AVC.frame_id, lambda data: AVC.decode(data)["State"] == "blocked")
        tractor.drive("extend", 20)
        ear.expect_flow("extend", extend=20)

    # on request there is an answer although there is nothing to tell
    equal("DM2 of a new valve", dm2(tractor.ask(DM2)), (0, [NO_CODE]))
    tractor.request(DM1)
    expect_dm1(None, NO_CODE)

    # no more AVC: time guarding, 250 ms of the bus's time after the last one; then every second
    tractor.drive("extend", 20)
    tractor.start_commands()
    ear.expect_flow("extend", extend=20)
    command = ear.expect(AVC.frame_id)
    tractor.stop_commands()
    alarm, before = take(ear.frames, lambda frame: frame.arbitration_id == 0x18FECA00 | VALVE)
    last = [frame for frame in [command, *before] if frame.arbitration_id == AVC.frame_id][-1]
    assert 0.250 < alarm.timestamp - last.timestamp < 0.252, f"{alarm.timestamp - last.timestamp} s"
    first, second = (expect_dm1(AMBER, TIME_GUARDING) for _ in range(2))
    # either may wait for the end of another frame
    assert abs(second - first - 1) < 0.002, f"DM1 again after {second - first} s"
    tractor.drive("blocked")
    tractor.start_commands()
    expect_dm1(None, NO_CODE)
    recover()
    equal("DM2 of one fault", dm2(tractor.ask(DM2)), (0x04, [TIME_GUARDING]))

    # to and fro, faster than any spool: for 500 ms it is not where it should be
    def wave(_):
        tractor.drive("retract" if tractor.command["State"] == "extend" else "extend", 100)
        return tractor.send_command()

    tractor.stop_commands()
    tractor.ca.add_timer(CYCLE, wave)
    expect_dm1(RED, SPOOL)
    # the springs have it back in neutral before the next second: the cause is gone
    expect_dm1(None, NO_CODE)
    tractor.stop_timer(wave)
    tractor.start_commands()
    recover()

    # two faults take more than a frame; the more severe lamp, by priority
    ear.forget()
    equal("DM2 of two faults", dm2(tractor.ask(DM2)), (0x10, [SPOOL, TIME_GUARDING]))
    announcement = ear.expect(0x1CECFF00 | VALVE, bytes.fromhex("200a0002ffcbfe00"))
    equal(
        "BAM by its DBC",
        DBC.decode_message(announcement.arbitration_id, announcement.data),
        dict(Control="BAM", Size=10, Packets=2, Group="DM2"),
    )
    packets = [ear.expect(0x1CEBFF00 | VALVE) for _ in range(2)]
    times = [frame.timestamp for frame in [announcement, *packets]]
    gaps = [later - earlier for earlier, later in zip(times, times[1:])]
    assert all(0.050 <= gap <= 0.200 for gap in gaps), gaps

    # DM3 clears them
    tractor.request(DM3)
    equal("DM3", tractor.expect(ACKNOWLEDGEMENT), bytes([0, 0xFF, 0xFF, 0xFF, TRACTOR, 0xCC, 0xFE, 0x00]))
    equal("DM2 after DM3", dm2(tractor.ask(DM2)), (0, [NO_CODE]))
