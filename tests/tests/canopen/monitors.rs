//! Time guarding, as a controller sees it (SPEC 2, 3).

use tests::Rig;

use super::CLEARED;

const TIMED_OUT: &str = "0A0: 03 80 91 01 00 00 00 00";

#[test]
fn after_250_ms_without_a_set_point() {
    let mut valve = Rig::active();
    valve.silent_for(249);
    valve.send("220: 0F 00 00 00");
    valve.take();
    valve.silent_until(250, &[TIMED_OUT]);
    assert_eq!((valve.status(), valve.read(0x1001, 0), valve.read(0x2023, 0)), (0x03, 0x91, 1));
    assert_eq!(valve.read(0x1003, 1), 0x0001_8003);
    // once: it waits for the next set-point
    valve.silent_for(10_000);
}

#[test]
fn a_set_point_by_any_object_feeds_it_and_nothing_else_does() {
    let feeds = [
        (0x6300, 1, 2, 0, true),
        (0x3300, 0, 1, 0, true),
        (0x3303, 0, 2, 0, true),
        (0x6040, 0, 2, 0x0F, false),
        (0x6042, 0, 1, 1, false),
        (0x6300, 1, 2, 16385, false),
        (0x3300, 0, 1, 0x80, false),
        (0x3303, 0, 2, 1001, false),
    ];
    for (index, sub, size, value, feeds) in feeds {
        let mut valve = Rig::active();
        valve.advance(200);
        let _ = valve.write(index, sub, size, value);
        valve.advance(50);
        assert_eq!(valve.take().is_empty(), feeds, "{index:04X} = {value}");
    }
}

/// With the next valid set-point in any state, acting or not.
#[test]
fn the_next_valid_set_point_ends_it() {
    let fault_hold: fn(&mut Rig) = |_| {};
    let pre_operational: fn(&mut Rig) = |valve| valve.send("000: 80 00");
    let hand: fn(&mut Rig) = |valve| valve.write(0x6042, 0, 1, 2).unwrap();
    for prepare in [fault_hold, pre_operational, hand] {
        let mut valve = Rig::active();
        valve.advance(250);
        valve.expect(TIMED_OUT);
        prepare(&mut valve);
        assert_eq!(valve.write(0x6300, 1, 2, 20_000), Err(0x0609_0031), "an invalid one does not count");
        valve.expect_nothing();
        valve.exchange("620: 2B 00 63 01 00 10 00 00", &[CLEARED, "5A0: 60 00 63 01 00 00 00 00"]);
        assert_eq!(valve.read(0x1001, 0), 0);
        valve.silent_for(10_000);
    }
}

/// A set-point of an RPDO ends it too, and then the way out of FAULT_HOLD is open.
#[test]
fn use_case_2_with_the_time_guard() {
    let mut valve = Rig::active();
    valve.advance(250);
    valve.expect(TIMED_OUT);
    valve.exchange("220: 03 00 00 00", &[CLEARED, "1A0: 03 00 00 00"]);
    valve.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
    valve.exchange("220: 0F 00 00 00", &["1A0: 0F 00 00 00"]);
}

/// Outside ACTIVE full operational nothing is guarded.
#[test]
fn it_ends_with_leaving_active_by_whatever_way() {
    let ways: [fn(&mut Rig); 5] = [
        |valve| valve.send("220: 03 00 00 00"),
        |valve| valve.send("0A1: 00 10 01 00 00 00 00 00"),
        |valve| valve.send("000: 02 00"),
        |valve| valve.send("000: 82 00"),
        |valve| valve.write(0x6042, 0, 1, 2).unwrap(),
    ];
    for way in ways {
        let mut valve = Rig::booted();
        valve.write(0x1028, 1, 4, 0xA1).unwrap();
        valve.activate();
        valve.advance(200);
        way(&mut valve);
        valve.take();
        valve.silent_for(10_000);
    }
}

/// Reset communication tells it again until a set-point ends it; reset application forgets it.
#[test]
fn over_the_resets() {
    let mut valve = Rig::active();
    valve.advance(250);
    valve.expect(TIMED_OUT);
    valve.exchange("000: 82 00", &["720: 00", CLEARED, TIMED_OUT]);
    valve.exchange("000: 81 00", &["720: 00", CLEARED]);
    valve.silent_for(10_000);
}

/// NMT start and pre-operational change nothing: without RPDOs the guard acts by itself.
#[test]
fn pre_operational_lets_it_act() {
    let mut valve = Rig::active();
    valve.silent_to(&["000: 80 00", "220: 0F 00 00 00"]);
    valve.advance(250);
    valve.expect(TIMED_OUT);
}
