//! The spool as it is told (SPEC 2): its way, the lever, float, and what can be wrong with it. The limits and delays of
//! its monitors are the actuator's.

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
            assert_eq!(valve.is_shut_down(), told.is_some(), "{fault:?} at {command:?}");
        }
    });
}

/// A position that a sensor reads takes the model's place.
#[test]
fn a_measured_position() {
    each_valve(|valve| {
        let mut valve = valve.commanded(FULL);
        valve.sense(|inputs| inputs.spool.measured = Position::new(1234));
        assert_eq!(valve.hold(FULL, 499), NOTHING);
        assert_eq!(valve.position(), 8);
    });
}
