//! Tests for every row in the table of the monitors (SPEC 2): limit, delay, hysteresis, and the states in which a
//! monitor runs.

use super::*;
use crate::time::NEVER;

/// A monitored value: its setter and its fault.
struct Row {
    fault: Fault,
    set: fn(&mut ValveInputs, i32),
    delay: u64,
    allowed: i32,
    trips: i32,
    /// The last value at which an active fault persists.
    stays: i32,
    clears: i32,
}

fn supply(inputs: &mut ValveInputs, value: i32) {
    inputs.supply_mv = u32::try_from(value).unwrap();
}

fn temperature(inputs: &mut ValveInputs, value: i32) {
    inputs.temperature_c = i16::try_from(value).unwrap();
}

#[rustfmt::skip]
const SENSED: [Row; 4] = [
    Row { fault: Fault::SupplyHigh, set: supply, delay: 2000, allowed: 36_000, trips: 36_001, stays: 32_000, clears: 31_999 },
    Row { fault: Fault::SupplyLow, set: supply, delay: 2000, allowed: 9_000, trips: 8_999, stays: 11_000, clears: 11_001 },
    Row { fault: Fault::Temperature, set: temperature, delay: 250, allowed: 120, trips: 121, stays: 116, clears: 115 },
    Row { fault: Fault::Temperature, set: temperature, delay: 250, allowed: -40, trips: -41, stays: -36, clears: -35 },
];

#[test]
fn supply_and_temperature_have_limit_delay_and_hysteresis() {
    for Row { fault, set, delay, allowed, trips, stays, clears } in SENSED {
        let mut rig = Rig::new(CANOPEN);
        rig.sense(0, |inputs| set(inputs, allowed));
        assert_eq!(rig.active(ms(10_000)), FaultSet::EMPTY, "{fault:?} at {allowed}");
        assert_eq!(rig.valve.deadline(), NEVER);

        // Returning inside the limit restarts the delay, even without passing the hysteresis.
        rig.sense(10_000, |inputs| set(inputs, trips));
        rig.sense(10_000 + delay - 1, |inputs| set(inputs, allowed));
        assert_eq!(rig.valve.deadline(), NEVER);
        rig.sense(20_000, |inputs| set(inputs, trips));
        rig.expect_activation(fault, 20_000 + delay);

        rig.sense(30_000, |inputs| set(inputs, stays));
        assert_eq!(rig.active(ms(40_000)), FaultSet::of(fault), "at {stays}");
        rig.sense(40_000, |inputs| set(inputs, clears));
        assert_eq!(rig.valve.take_changes(), Changes { activated: FaultSet::EMPTY, cleared: FaultSet::of(fault) });
        assert_eq!(rig.valve.faults(), FaultSet::EMPTY);
        assert_eq!(rig.valve.counters().get(fault), 1);
        assert_eq!(rig.valve.deadline(), NEVER);
    }
}

#[test]
fn a_cause_at_power_up_takes_its_delay() {
    for Row { fault, set, delay, trips, .. } in SENSED {
        let mut rig = Rig::new(CANOPEN);
        rig.sense(0, |inputs| set(inputs, trips));
        rig.expect_activation(fault, delay);
    }
}

#[test]
fn after_a_restart_a_cause_that_lasts_is_found_anew() {
    let mut rig = Rig::new(CANOPEN);
    rig.sense(0, |inputs| inputs.supply_mv = 8_000);
    rig.expect_activation(Fault::SupplyLow, 2000);
    let counters = rig.valve.counters();
    rig.valve.restart(counters, ms(5000));
    rig.expect_activation(Fault::SupplyLow, 7000);
    assert_eq!(rig.valve.counters().get(Fault::SupplyLow), 2);
}

#[test]
fn cold_is_watched_only_where_it_is_asked_for() {
    let mut rig = Rig::new(ISOBUS);
    rig.sense(0, |inputs| inputs.temperature_c = -100);
    assert_eq!(rig.active(ms(10_000)), FaultSet::EMPTY);
    rig.sense(10_000, |inputs| inputs.temperature_c = 121);
    rig.expect_activation(Fault::Temperature, 10_250);
    rig.sense(20_000, |inputs| inputs.temperature_c = -100);
    assert_eq!(rig.valve.faults(), FaultSet::EMPTY);
}

#[test]
fn from_too_hot_to_too_cold_is_one_cause() {
    let mut rig = Rig::new(CANOPEN);
    rig.sense(0, |inputs| inputs.temperature_c = 130);
    rig.sense(100, |inputs| inputs.temperature_c = -50);
    rig.expect_activation(Fault::Temperature, 250);
}

#[test]
fn the_spool_may_be_15_percent_away() {
    // 15 % = 2457.6
    for (lever, fault) in [(10_000 - 2457, false), (10_000 + 2457, false), (10_000 - 2458, true), (10_000 + 2458, true)]
    {
        let mut rig = Rig::new(CANOPEN);
        rig.lever(0, lever);
        rig.drive(0, to(10_000));
        if fault {
            rig.expect_activation(Fault::SpoolNotAtSetPoint, 500);
            assert!(rig.active(ms(9000)).contains(Fault::SpoolNotAtSetPoint));
        } else {
            assert_eq!(rig.active(ms(10_000)), FaultSet::EMPTY, "{lever}");
            assert_eq!(rig.valve.deadline(), NEVER);
        }
    }
}

#[test]
fn steps_over_the_whole_stroke_are_no_fault() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.drive(1000, to(-16384));
    rig.drive(2000, FLOAT);
    rig.drive(3000, to(-16384));
    rig.drive(4000, BLOCKED);
    rig.valve.poll(ms(9000));
    assert!(rig.valve.take_changes().is_empty());
}

#[test]
fn a_slow_spool_is_found_by_either_monitor() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Slow);
    rig.drive(0, to(16384));
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 500);
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Slow);
    rig.drive(0, FLOAT);
    rig.expect_activation(Fault::FloatNotReached, 1000);
}

#[test]
fn a_drifting_spool_is_found_once_it_is_15_percent_away() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Drifting);
    rig.drive(0, to(8192));
    // The spool arrives after 125 ms, and drifts 15 % in another 1200 ms; a microsecond later it is outside.
    let beyond = ms(125 + 1200) + MICROSECOND;
    assert_eq!(rig.active(beyond + SET_POINT_DELAY - MICROSECOND), FaultSet::EMPTY);
    assert_eq!(rig.active(beyond + SET_POINT_DELAY), FaultSet::of(Fault::SpoolNotAtSetPoint));
}

#[test]
fn monitor_1_counts_anew_only_when_the_spool_comes_back() {
    let mut rig = Rig::new(CANOPEN);
    rig.lever(0, 5000);
    rig.drive(0, to(16000));
    rig.drive(200, to(12000));
    rig.drive(400, to(-12000));
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 500);

    let mut rig = Rig::new(CANOPEN);
    rig.lever(0, 5000);
    rig.drive(0, to(16000));
    rig.lever(499, 16000);
    rig.lever(600, 5000);
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 1100);
}

#[test]
fn monitors_of_the_spool_begin_anew_with_regulation() {
    let mut rig = Rig::new(CANOPEN);
    rig.lever(0, 5000);
    rig.drive(0, to(16000));
    rig.drive(400, Drive::Off);
    assert_eq!(rig.valve.deadline(), NEVER, "does not run while off");
    rig.drive(600, to(16000));
    rig.drive(700, to(16000));
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 1100);

    let mut rig = Rig::new(CANOPEN);
    rig.lever(0, 5000);
    rig.drive(0, FLOAT);
    rig.drive(900, Drive::Hand);
    rig.drive(950, FLOAT);
    rig.expect_activation(Fault::FloatNotReached, 1950);

    // If monitor 1 also runs while the drive is off, the start of regulation does not restart it; the end of hand
    // operation does.
    let mut rig = Rig::new(ISOBUS);
    rig.lever(0, 5000);
    rig.drive(300, to(16000));
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 500);
    let mut rig = Rig::new(ISOBUS);
    rig.lever(0, 5000);
    rig.drive(100, Drive::Hand);
    rig.drive(600, to(16000));
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 1100);
}

/// With the drive off, as in a shutdown, the spool must be within 5 % of neutral.
#[test]
fn monitor_1_wants_neutral_when_the_valve_is_off_if_it_runs_then() {
    for (config, drive, limit, fault) in [
        (CANOPEN, Drive::Off, 16383, false),
        (CANOPEN, Drive::Hand, 16383, false),
        (CANOPEN, Drive::EmergencyStop, 16383, false),
        (ISOBUS, Drive::Off, 819, true),
        (ISOBUS, Drive::Hand, 16383, false),
        (ISOBUS, Drive::EmergencyStop, 16383, false),
        (ISOBUS, BLOCKED, 2457, true),
    ] {
        let mut rig = Rig::new(config);
        rig.drive(0, drive);
        rig.lever(0, limit);
        assert_eq!(rig.active(ms(5000)), FaultSet::EMPTY);
        rig.lever(5000, limit + 1);
        if fault {
            rig.expect_activation(Fault::SpoolNotAtSetPoint, 5500);
        } else {
            assert_eq!(rig.active(ms(9000)), FaultSet::EMPTY, "{drive:?}");
        }
    }
}

#[test]
fn monitor_1_goes_on_from_regulation_to_off_where_it_runs_in_both() {
    let mut rig = Rig::new(ISOBUS);
    rig.spool(0, SpoolFault::Slow);
    rig.lever(0, -8000);
    rig.drive(0, to(8000));
    rig.drive(300, Drive::Off);
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 500);
}

#[test]
fn monitor_1_is_off_in_float() {
    let mut rig = Rig::new(ISOBUS);
    rig.lever(0, -5000);
    rig.drive(0, to(16384));
    rig.drive(400, FLOAT);
    rig.expect_activation(Fault::FloatNotReached, 1400);
    assert_eq!(rig.valve.faults(), FaultSet::of(Fault::FloatNotReached));
}

#[test]
fn float_must_be_reached_within_5_percent() {
    // 95 % = 15564.8
    for (lever, fault) in [(15565, false), (15564, true)] {
        let mut rig = Rig::new(CANOPEN);
        rig.lever(0, lever);
        rig.drive(0, FLOAT);
        if fault {
            rig.expect_activation(Fault::FloatNotReached, 1000);
        } else {
            assert_eq!(rig.active(ms(10_000)), FaultSet::EMPTY);
        }
    }
}

#[test]
fn float_that_is_lost_again_is_a_fault_too() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, FLOAT);
    rig.lever(2000, 15564);
    rig.expect_activation(Fault::FloatNotReached, 3000);
}

#[test]
fn the_guard_wants_a_set_point_every_250_ms() {
    let mut rig = Rig::new(CANOPEN);
    rig.valve.feed_guard(ms(0));
    assert_eq!(rig.valve.deadline(), NEVER, "runs only once started");
    rig.valve.start_guard(ms(100));
    rig.valve.feed_guard(ms(300));
    rig.valve.feed_guard(ms(549));
    rig.expect_activation(Fault::TimeGuarding, 799);
    assert_eq!(rig.valve.deadline(), NEVER);

    // The guard continues to require set-points.
    rig.valve.feed_guard(ms(2000));
    assert_eq!(rig.valve.take_changes().cleared, FaultSet::of(Fault::TimeGuarding));
    rig.expect_activation(Fault::TimeGuarding, 2250);

    // Stopping the guard leaves the fault active until the next set-point.
    rig.valve.stop_guard(ms(3000));
    assert!(rig.active(ms(9000)).contains(Fault::TimeGuarding));
    rig.valve.feed_guard(ms(9000));
    assert_eq!(rig.active(ms(20_000)), FaultSet::EMPTY);
    assert_eq!(rig.valve.counters().get(Fault::TimeGuarding), 2);
}

#[test]
fn what_is_due_at_an_instant_comes_before_what_is_done_at_it() {
    let mut rig = Rig::new(CANOPEN);
    rig.valve.start_guard(ms(0));
    rig.valve.feed_guard(ms(250));
    let guarding = FaultSet::of(Fault::TimeGuarding);
    assert_eq!(rig.valve.take_changes(), Changes { activated: guarding, cleared: guarding });
    rig.valve.stop_guard(ms(500));
    assert_eq!(rig.valve.take_changes().activated, guarding);
}
