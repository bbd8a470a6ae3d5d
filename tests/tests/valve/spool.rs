//! The spool: its way, the lever, float, and what can be wrong with it, as it is told.

use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::device::pve::Kind;

use super::valve::Command::{Float, Percent};
use super::valve::{AWAY, FULL, NEUTRAL, NO_FLOAT, Valve, each_valve};

const NOTHING: [&str; 0] = [];

fn breaks(valve: &mut Valve, fault: SpoolFault) {
    valve.sense(|inputs| inputs.spool.fault = fault);
}

/// 250 ms from neutral to full stroke by the solenoids, 150 ms back by the springs; and half of that half way.
#[test]
fn its_rates() {
    each_valve(|valve| {
        for (command, ms, expected) in [
            (Percent(100), 125, 50),
            (Percent(100), 250, 100),
            (Percent(-100), 125, -50),
            (Percent(-100), 250, -100),
            (Percent(50), 125, 50),
            (Percent(50), 200, 50),
            (Float, 125, 50),
        ] {
            let mut valve = valve.anew().commanded(command);
            valve.hold(command, ms);
            assert_eq!(valve.position(), expected, "{command:?} after {ms} ms");
            valve.stop();
            let back = expected.unsigned_abs() * 150 / 100;
            valve.rig.advance(back.into());
            assert_eq!(valve.position(), 0, "{command:?}, back after {back} ms");
        }
    });
}

/// A set-point moves it by the solenoids, neutral included: from one end to the other in twice the time.
#[test]
fn from_end_to_end() {
    each_valve(|valve| {
        let mut valve = valve.commanded(FULL);
        valve.hold(FULL, 250);
        for expected in [50, 0, -50, -100] {
            valve.drive(Percent(-100), 125);
            assert_eq!(valve.position(), expected);
        }
    });
}

/// A PVEO knows full stroke alone, for the spool and for monitor 1.
#[test]
fn the_on_off_kinds() {
    for kind in [Kind::PveoCanopen, Kind::PveoIsobus] {
        for (percent, full) in [(1, 100), (50, 100), (-1, -100), (-100, -100)] {
            let mut valve = Valve::new(kind).commanded(Percent(percent));
            valve.hold(Percent(percent), 125);
            assert_eq!(valve.position(), full / 2, "{kind:?}, {percent} %");
            assert_eq!(valve.hold(Percent(percent), 2000), NOTHING);
            assert_eq!(valve.position(), full, "{kind:?}, {percent} %");
            assert_eq!(valve.drive(NEUTRAL, 2000), NOTHING);
            assert_eq!(valve.position(), 0);
        }
        // half is too little
        let mut valve = Valve::new(kind).commanded(Percent(50));
        valve.lever(Some(8192));
        assert_eq!(valve.hold(Percent(50), 500), [valve.tells(AWAY, 1)]);
    }
}

/// It wins over the solenoids; what is told follows it in every state; let go, the valve takes over again.
#[test]
fn the_lever() {
    each_valve(|mut valve| {
        valve.lever(Some(-8192));
        assert_eq!(valve.position(), -50, "before any command");
        valve.lever(None);
        valve.rig.advance(150);
        assert_eq!(valve.position(), 0);

        let mut valve = valve.anew().commanded(NEUTRAL);
        valve.hand_operation();
        for (at, percent) in [(16384, 100), (-16384, -100), (0, 0), (3277, 20)] {
            valve.lever(Some(at));
            assert_eq!((valve.position(), valve.solenoids()), (percent, false), "hand operation");
        }

        let mut valve = valve.anew().commanded(FULL);
        valve.lever(Some(8192));
        valve.hold(FULL, 100);
        assert_eq!(valve.position(), 50, "it wins over the solenoids");
        valve.lever(None);
        assert_eq!(valve.hold(FULL, 125), NOTHING);
        assert_eq!(valve.position(), 100);
    });
}

/// What is wrong with a spool, at which command it shows, and what is told.
#[test]
fn what_can_be_wrong() {
    each_valve(|valve| {
        for (fault, command, told) in [
            (SpoolFault::None, FULL, None),
            (SpoolFault::None, Percent(-100), None),
            (SpoolFault::None, Float, None),
            (SpoolFault::Stuck, FULL, Some(AWAY)),
            (SpoolFault::Stuck, Float, Some(NO_FLOAT)),
            (SpoolFault::Stuck, Percent(15), None),
            (SpoolFault::Slow, FULL, Some(AWAY)),
            (SpoolFault::Slow, Float, Some(NO_FLOAT)),
            (SpoolFault::NoFloat, FULL, None),
            (SpoolFault::NoFloat, Float, Some(NO_FLOAT)),
            (SpoolFault::Drifting, Percent(50), Some(AWAY)),
        ] {
            let mut valve = valve.anew().commanded(NEUTRAL);
            breaks(&mut valve, fault);
            let heard = valve.drive(command, 10_000);
            let expected = told.map(|told| (valve.tells(told, 1), valve.cleared()));
            assert_eq!(heard.first().cloned().zip(heard.last().cloned()), expected, "{fault:?} at {command:?}");
        }
    });
}

/// 15 % of 16384 are 2457.6.
#[test]
fn more_than_15_percent_away_for_500_ms() {
    each_valve(|valve| {
        for (position, away) in [(2457, false), (2458, true), (-2457, false), (-2458, true)] {
            let mut valve = valve.anew().commanded(NEUTRAL);
            valve.lever(Some(position));
            assert_eq!(valve.hold(NEUTRAL, 499), NOTHING, "{position}");
            assert_eq!(valve.hold(NEUTRAL, 1).len(), usize::from(away), "{position}");
            assert_eq!(valve.hold(NEUTRAL, 9500), NOTHING, "{position}");
        }
    });
}

/// Its timer restarts only when the deviation falls to the limit: not with another set-point that is as far away.
#[test]
fn another_set_point_does_not_restart_the_delay() {
    each_valve(|valve| {
        let mut valve = valve.commanded(FULL);
        breaks(&mut valve, SpoolFault::Stuck);
        assert_eq!(valve.hold(FULL, 300), NOTHING);
        assert_eq!(valve.drive(Percent(-100), 199), NOTHING);
        assert_eq!(valve.hold(Percent(-100), 1)[0], valve.tells(AWAY, 1));

        let mut valve = valve.anew().commanded(FULL);
        breaks(&mut valve, SpoolFault::Stuck);
        assert_eq!(valve.hold(FULL, 300), NOTHING);
        valve.command(NEUTRAL);
        assert_eq!(valve.drive(FULL, 499), NOTHING);
        assert_eq!(valve.hold(FULL, 1)[0], valve.tells(AWAY, 1));
    });
}

/// Gone as soon as it is there, on purpose; the shutdown lasts.
#[test]
fn stuck_in_neutral() {
    each_valve(|valve| {
        let mut valve = valve.commanded(NEUTRAL);
        breaks(&mut valve, SpoolFault::Stuck);
        assert_eq!(valve.drive(FULL, 499), NOTHING);
        assert_eq!(valve.hold(FULL, 1), [valve.tells(AWAY, 1), valve.cleared()]);
        assert!(valve.is_shut_down());
        assert_eq!(valve.hold(FULL, 5000), NOTHING);
    });
}

/// Stuck elsewhere: it lasts until the springs have brought the spool to neutral, within 5 %.
#[test]
fn stuck_away_from_neutral() {
    each_valve(|valve| {
        let mut valve = valve.commanded(FULL);
        assert_eq!(valve.hold(FULL, 1000), NOTHING);
        breaks(&mut valve, SpoolFault::Stuck);
        assert_eq!(valve.drive(NEUTRAL, 499), NOTHING);
        assert_eq!(valve.hold(NEUTRAL, 1), [valve.tells(AWAY, 1)]);
        assert_eq!(valve.hold(NEUTRAL, 2000), NOTHING);
        assert_eq!((valve.position(), valve.solenoids()), (100, false));
        breaks(&mut valve, SpoolFault::None);
        // 95 % of the 150 ms from full stroke
        assert_eq!(valve.hold(NEUTRAL, 142), NOTHING);
        assert_eq!(valve.hold(NEUTRAL, 1), [valve.cleared()]);
    });
}

#[test]
fn float_not_reached_within_1000_ms() {
    each_valve(|valve| {
        let mut valve = valve.commanded(NEUTRAL);
        breaks(&mut valve, SpoolFault::NoFloat);
        assert_eq!(valve.drive(Float, 999), NOTHING);
        assert_eq!(valve.position(), 80);
        assert_eq!(valve.hold(Float, 1), [valve.tells(NO_FLOAT, 1)]);
        // shut down, the springs take it from there to 5 %, and it is gone
        assert_eq!(valve.hold(Float, 112), NOTHING);
        assert_eq!(valve.hold(Float, 1), [valve.cleared()]);
        assert_eq!(valve.hold(Float, 1500), NOTHING);
        assert!(valve.is_shut_down());
    });
}

/// Monitor 1 is off in float: a spool short of it is monitor 2's alone, which is content with 5 %.
#[test]
fn in_float_only_float_is_looked_at() {
    each_valve(|valve| {
        let mut valve = valve.commanded(Float);
        breaks(&mut valve, SpoolFault::Stuck);
        assert_eq!(valve.hold(Float, 999), NOTHING);
        assert_eq!(valve.hold(Float, 1), [valve.tells(NO_FLOAT, 1), valve.cleared()]);

        let mut valve = valve.anew().commanded(Float);
        assert_eq!(valve.hold(Float, 5000), NOTHING);
        valve.lever(Some(16384 - 819));
        assert_eq!(valve.hold(Float, 3000), NOTHING);
        valve.lever(Some(16384 - 821));
        assert_eq!(valve.hold(Float, 999), NOTHING);
        assert_eq!(valve.hold(Float, 1), [valve.tells(NO_FLOAT, 1)]);
        assert_eq!(valve.hold(Float, 300), NOTHING, "until the spool is in neutral");
        valve.lever(Some(819));
        assert_eq!(valve.told(), [valve.cleared()]);
    });
}

/// A position that a sensor reads takes the model's place.
#[test]
fn a_measured_position() {
    each_valve(|valve| {
        let mut valve = valve.commanded(FULL);
        let measure = |valve: &mut Valve, at| valve.sense(|inputs| inputs.spool.measured = Position::new(at));
        measure(&mut valve, 1234);
        assert_eq!(valve.hold(FULL, 499), NOTHING);
        assert_eq!(valve.position(), 8);
        // away for 500 ms; it is not in neutral (819), so the fault lasts until it is
        assert_eq!(valve.hold(FULL, 1), [valve.tells(AWAY, 1)]);
        measure(&mut valve, 820);
        assert_eq!(valve.told(), NOTHING);
        measure(&mut valve, 819);
        assert_eq!(valve.told(), [valve.cleared()]);
    });
}
