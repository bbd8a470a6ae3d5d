//! The spool as CANopen shows it: its way, the lever, float, and what can be wrong with it (SPEC 2, 4.1).

use protocol_core::actuator::{Position, SpoolFault};
use tests::Rig;

use super::CLEARED;

const AWAY: &str = "0A0: 05 83 21 01 00 00 00 00";

fn active() -> Rig {
    Rig::active()
}

fn set(valve: &mut Rig, set_point: i16) {
    drive(valve, set_point, 0);
}

/// Sends this set-point now and then cyclically; the EMCYs that come.
fn drive(valve: &mut Rig, set_point: i16, ms: u64) -> Vec<String> {
    let [low, high] = set_point.to_le_bytes();
    let rpdo = format!("220: 0F 00 {low:02X} {high:02X}");
    valve.send(&rpdo);
    valve.advance_cyclic(ms, &rpdo);
    valve.take_under("0A0")
}

fn position(valve: &mut Rig) -> i16 {
    valve.read(0x6301, 1) as u16 as i16
}

/// 250 ms from neutral to full stroke by the solenoids, 150 ms back by the springs; and half of that half way.
#[test]
fn its_rates() {
    let table: [(i16, u64, i16); 7] = [
        (16384, 125, 8192),
        (16384, 250, 16384),
        (-16384, 125, -8192),
        (-16384, 250, -16384),
        (8192, 125, 8192),
        (8192, 200, 8192),
        (32767, 125, 8192),
    ];
    for (set_point, ms, expected) in table {
        let mut valve = active();
        drive(&mut valve, set_point, ms);
        assert_eq!(position(&mut valve), expected, "{set_point} after {ms} ms");
        // with the device stopped the springs take it back from there
        let back = u64::from(expected.unsigned_abs()) * 150 / 16384;
        valve.silent_to(&["000: 02 00", "000: 80 00"]);
        valve.advance(back);
        assert_eq!(position(&mut valve), 0, "{set_point}, back after {back} ms");
    }
}

/// A set-point moves it by the solenoids, neutral included: from one end to the other in twice the time.
#[test]
fn from_end_to_end() {
    let mut valve = active();
    drive(&mut valve, 16384, 250);
    for expected in [8192, 0, -8192, -16384] {
        drive(&mut valve, -16384, 125);
        assert_eq!(position(&mut valve), expected);
    }
}

/// Float is reached within 5 % of the B side, after 95 % of 250 ms; all the actual values then say so.
#[test]
fn float_reached() {
    let actual = |valve: &mut Rig| [(0x6301, 1), (0x3301, 0), (0x3302, 0), (0x3304, 0)].map(|(i, s)| valve.read(i, s));
    let mut valve = active();
    set(&mut valve, 32767);
    valve.advance(237);
    assert!(position(&mut valve) < 15565);
    valve.advance(1);
    assert_eq!(actual(&mut valve), [32767, 127, 0x81, 1000]);
    // the same place without float is a position
    let mut valve = active();
    set(&mut valve, 16384);
    valve.advance(245);
    let [raw, ..] = actual(&mut valve);
    assert!((15565..16384).contains(&raw), "{raw}");
    set(&mut valve, 32767);
    assert_eq!(actual(&mut valve), [32767, 127, 0x81, 1000]);
    set(&mut valve, 0);
    assert_ne!(valve.read(0x6301, 1), 32767);
}

/// The hand lever wins over the solenoids; feedback follows it in every state; let go, the valve takes over again.
#[test]
fn the_lever() {
    let lever = |valve: &mut Rig, position: Option<i16>| {
        valve.sense(|inputs| inputs.spool.lever = position.and_then(Position::new));
    };
    let mut valve = Rig::booted();
    lever(&mut valve, Some(-5000));
    assert_eq!(position(&mut valve), -5000, "INIT");
    lever(&mut valve, None);
    valve.advance(150);
    assert_eq!(position(&mut valve), 0);

    let mut valve = active();
    valve.write(0x6042, 0, 1, 2).unwrap();
    for at in [16384, 1, -16384, 0] {
        lever(&mut valve, Some(at));
        assert_eq!(position(&mut valve), at, "hand operation");
        assert!(!valve.outputs().solenoids);
    }

    let mut valve = active();
    set(&mut valve, 16384);
    lever(&mut valve, Some(8192));
    drive(&mut valve, 16384, 100);
    assert_eq!(position(&mut valve), 8192, "it wins over the solenoids");
    lever(&mut valve, None);
    assert!(drive(&mut valve, 16384, 125).is_empty());
    assert_eq!(position(&mut valve), 16384);
}

/// What is wrong with a spool, at which set-point it shows, and what is told.
#[test]
fn what_can_be_wrong() {
    let cases: [(SpoolFault, i16, &[&str]); 9] = [
        (SpoolFault::None, 16384, &[]),
        (SpoolFault::None, 32767, &[]),
        (SpoolFault::Stuck, 16384, &[AWAY, CLEARED]),
        (SpoolFault::Stuck, 32767, &[AWAY, CLEARED]),
        (SpoolFault::Stuck, 2457, &[]),
        (SpoolFault::Slow, 16384, &[AWAY, CLEARED]),
        (SpoolFault::Slow, 32767, &[AWAY, CLEARED]),
        (SpoolFault::NoFloat, 16384, &[]),
        (SpoolFault::NoFloat, 32767, &[AWAY, CLEARED]),
    ];
    for (fault, set_point, told) in cases {
        let mut valve = active();
        valve.sense(|inputs| inputs.spool.fault = fault);
        assert_eq!(drive(&mut valve, set_point, 5000), told, "{fault:?} at {set_point}");
    }
    let mut valve = active();
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Drifting);
    assert_eq!(drive(&mut valve, 8192, 10_000), [AWAY, CLEARED], "drifting");
}

/// A position that a sensor reads takes the model's place.
#[test]
fn a_measured_position() {
    let mut valve = active();
    valve.sense(|inputs| inputs.spool.measured = Position::new(1234));
    assert!(drive(&mut valve, 16384, 499).is_empty());
    assert_eq!(position(&mut valve), 1234);
    // away for 500 ms; it is not in neutral (819), so the fault lasts until it is
    assert_eq!(drive(&mut valve, 16384, 1), [AWAY]);
    valve.sense_sends(|inputs| inputs.spool.measured = Position::new(820), &[]);
    valve.sense(|inputs| inputs.spool.measured = Position::new(819));
    valve.expect(CLEARED);
}
