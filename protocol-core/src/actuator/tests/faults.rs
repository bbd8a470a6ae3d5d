//! Activation, clearing and counting of faults (SPEC 2).

use super::*;
use crate::time::NEVER;

#[test]
fn faults_of_the_spool_are_gone_when_it_stands_in_neutral() {
    let mut rig = Rig::new(CANOPEN);
    rig.lever(0, 9000);
    rig.drive(0, to(0));
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 500);
    rig.drive(500, Drive::Off);
    rig.lever(1000, 820);
    assert!(rig.valve.is_active(Fault::SpoolNotAtSetPoint));
    rig.lever(2000, 819);
    assert_eq!(rig.valve.take_changes().cleared, FaultSet::of(Fault::SpoolNotAtSetPoint));
}

#[test]
fn springs_take_the_spool_to_the_end_of_its_fault() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::NoFloat);
    rig.drive(0, FLOAT);
    rig.expect_activation(Fault::FloatNotReached, 1000);
    rig.drive(1000, Drive::Off);
    // From 80 % to 5 %, at 150 ms for 100 %.
    assert_eq!(rig.valve.deadline(), Instant::from_micros(1_112_500));
    rig.valve.poll(Instant::from_micros(1_112_500));
    assert_eq!(rig.valve.take_changes().cleared, FaultSet::of(Fault::FloatNotReached));
    assert_eq!(rig.valve.deadline(), NEVER);
}

#[test]
fn a_spool_stuck_in_neutral_is_a_fault_that_is_gone_at_once() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Stuck);
    rig.drive(0, to(16384));
    rig.valve.poll(ms(500));
    let stuck = FaultSet::of(Fault::SpoolNotAtSetPoint);
    assert_eq!(rig.valve.take_changes(), Changes { activated: stuck, cleared: stuck });
    assert_eq!(rig.valve.faults(), FaultSet::EMPTY);
    // If regulation continues, the fault activates again after the same delay, and is counted.
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 1000);
    assert_eq!(rig.valve.counters().get(Fault::SpoolNotAtSetPoint), 2);
    rig.drive(1000, Drive::Off);
    assert_eq!(rig.valve.deadline(), NEVER);
}

#[test]
fn a_late_call_counts_a_spool_stuck_in_neutral_once() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Stuck);
    rig.drive(0, to(16384));
    rig.drive(3_600_000, Drive::Off);
    let stuck = FaultSet::of(Fault::SpoolNotAtSetPoint);
    assert_eq!(rig.valve.take_changes(), Changes { activated: stuck, cleared: stuck });
    assert_eq!(rig.valve.counters().get(Fault::SpoolNotAtSetPoint), 1);
}

#[test]
fn spool_faults_share_a_counter_where_they_do() {
    for (config, expected) in [(CANOPEN, (3, 3)), (ISOBUS, (2, 1))] {
        let mut rig = Rig::new(config);
        rig.spool(0, SpoolFault::Stuck);
        rig.drive(0, to(16384));
        rig.valve.poll(ms(500));
        rig.valve.take_changes();
        rig.valve.poll(ms(1000));
        rig.valve.take_changes();
        rig.drive(1000, FLOAT);
        rig.valve.poll(ms(2000));
        let counters = rig.valve.counters();
        let spool = (counters.get(Fault::SpoolNotAtSetPoint), counters.get(Fault::FloatNotReached));
        assert_eq!(spool, expected);
        assert_eq!(counters.to_bytes()[2..], [0; 6]);
    }
}

#[test]
fn counters_stop_at_127_and_are_stored_as_bytes() {
    let stored = Counters::from_bytes([0, 0, 0, 126, 0, 0, 0, 255]);
    assert_eq!(stored.to_bytes(), [0, 0, 0, 126, 0, 0, 0, 127]);
    let mut valve = Valve::new(CANOPEN, stored, ms(0));
    assert!(!valve.take_counters_changed());
    for (count, changed) in [(127, true), (127, false)] {
        valve.set_bus_off(true, ms(1));
        assert_eq!(valve.counters().get(Fault::CanBus), count);
        assert_eq!(valve.take_counters_changed(), changed);
        valve.set_bus_off(false, ms(2));
    }
    valve.clear_counters(FaultSet::of(Fault::TimeGuarding));
    assert_eq!(valve.counters().to_bytes(), [0, 0, 0, 127, 0, 0, 0, 0]);
    valve.clear_counters(FaultSet::ALL);
    assert_eq!(valve.counters(), Counters::default());
    assert!(!valve.take_counters_changed(), "as stored");
}

#[test]
fn the_internal_error_lasts_while_any_cause_does() {
    let mut valve = Valve::new(CANOPEN, Counters::default(), ms(0));
    let internal = FaultSet::of(Fault::Internal);
    valve.set_internal(InternalCause::Record(0), true, ms(0));
    assert_eq!(valve.take_changes().activated, internal);
    valve.set_internal(InternalCause::Injected, true, ms(1));
    valve.set_internal(InternalCause::Record(7), true, ms(1));
    valve.set_internal(InternalCause::Record(0), false, ms(2));
    valve.set_internal(InternalCause::Injected, false, ms(3));
    assert!(valve.take_changes().is_empty());
    assert!(valve.is_active(Fault::Internal));
    valve.set_internal(InternalCause::Record(7), false, ms(4));
    assert_eq!(valve.take_changes(), Changes { activated: FaultSet::EMPTY, cleared: internal });
    assert_eq!(valve.counters().get(Fault::Internal), 1);
}

#[test]
fn the_last_of_the_changes_is_what_is_active() {
    let mut valve = Valve::new(CANOPEN, Counters::default(), ms(0));
    valve.set_bus_off(true, ms(0));
    valve.take_changes();
    valve.set_bus_off(false, ms(1));
    valve.set_bus_off(true, ms(2));
    assert_eq!(valve.take_changes(), Changes { activated: FaultSet::of(Fault::CanBus), cleared: FaultSet::EMPTY });
}

#[test]
fn faults_do_not_switch_the_drive() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.valve.set_bus_off(true, ms(100));
    assert!(rig.valve.regulating() && rig.valve.solenoids());
}

#[test]
fn hand_operation_and_emergency_stop_look_for_all_but_the_spools_faults() {
    for drive in [Drive::Hand, Drive::EmergencyStop] {
        let mut rig = Rig::new(ISOBUS);
        rig.drive(0, to(16384));
        rig.drive(300, drive);
        assert!(!rig.valve.solenoids() && !rig.valve.regulating());
        rig.valve.start_guard(ms(300));
        rig.lever(300, 9000);
        rig.sense(300, |inputs| (inputs.supply_mv, inputs.temperature_c) = (8_000, 130));
        rig.valve.poll(ms(550));
        rig.valve.poll(ms(2300));
        let expected = [Fault::Temperature, Fault::SupplyLow, Fault::TimeGuarding].into_iter().collect();
        assert_eq!(rig.active(ms(9000)), expected);
    }
}

#[test]
fn faults_of_one_late_poll_come_by_priority() {
    let mut rig = Rig::new(CANOPEN);
    rig.lever(0, 9000);
    rig.drive(0, to(-9000));
    rig.valve.start_guard(ms(0));
    rig.sense(0, |inputs| (inputs.supply_mv, inputs.temperature_c) = (40_000, 130));
    rig.valve.poll(ms(60_000));
    let changes = rig.valve.take_changes();
    let expected = [Fault::SpoolNotAtSetPoint, Fault::Temperature, Fault::SupplyHigh, Fault::TimeGuarding];
    assert!(changes.activated.into_iter().eq(expected));
    assert_eq!(changes.cleared, FaultSet::EMPTY);
}
