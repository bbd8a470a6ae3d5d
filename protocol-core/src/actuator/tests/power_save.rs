//! The beginning and the end of power save (SPEC 2).

use super::*;
use crate::time::NEVER;

/// Returns a valve that entered power save at 200 ms.
fn saving() -> Rig {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, BLOCKED);
    rig.valve.poll(ms(200));
    assert!(rig.valve.power_save());
    rig
}

#[test]
fn begins_after_200_ms_in_blocked() {
    let mut rig = Rig::new(CANOPEN);
    assert!(!rig.valve.solenoids());
    rig.drive(0, BLOCKED);
    assert!(rig.valve.solenoids());
    assert_eq!(rig.valve.deadline(), ms(200));
    rig.drive(100, BLOCKED);
    rig.valve.poll(ms(200) - MICROSECOND);
    assert!(rig.valve.solenoids() && !rig.valve.power_save());
    rig.valve.poll(ms(200));
    assert!(!rig.valve.solenoids() && rig.valve.power_save() && rig.valve.regulating());
    assert_eq!(rig.valve.deadline(), NEVER);
}

/// The valve is blocked when set-point and spool are neutral: from full stroke the spool takes 237.5 ms to within 5 %.
#[test]
fn the_200_ms_count_from_the_instant_when_set_point_and_spool_are_neutral() {
    for full in [16384, -16384] {
        let mut rig = Rig::new(CANOPEN);
        rig.drive(0, to(full));
        rig.drive(1000, BLOCKED);
        let begins = ms(1000) + Duration::from_micros(237_500 + 200_000);
        rig.valve.poll(begins - MICROSECOND);
        assert!(rig.valve.solenoids() && !rig.valve.power_save());
        assert_eq!(rig.valve.deadline(), begins);
        rig.valve.poll(begins);
        assert!(rig.valve.power_save() && !rig.valve.solenoids());
    }
}

#[test]
fn a_late_poll_finds_it_begun() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.drive(1000, BLOCKED);
    rig.valve.poll(ms(5000));
    assert!(rig.valve.power_save());
    assert_eq!(rig.valve.deadline(), NEVER);
}

#[test]
fn a_set_point_that_is_not_neutral_ends_it_at_once() {
    for drive in [to(1), to(-16384), FLOAT] {
        let mut rig = saving();
        rig.drive(1000, drive);
        assert!(rig.valve.solenoids() && !rig.valve.power_save());
        rig.drive(1001, BLOCKED);
        rig.valve.poll(ms(1201) - MICROSECOND);
        assert!(rig.valve.solenoids(), "200 ms count anew");
        rig.valve.poll(ms(1201));
        assert!(rig.valve.power_save());
    }
}

#[test]
fn a_spool_that_is_pushed_out_of_neutral_ends_it() {
    let mut rig = saving();
    rig.lever(1000, 819);
    assert!(rig.valve.power_save(), "still in neutral");
    rig.lever(2000, 820);
    assert!(rig.valve.solenoids() && !rig.valve.power_save());
    rig.valve.poll(ms(3000));
    assert!(rig.valve.solenoids(), "no rest out of neutral");
    assert_eq!(rig.valve.deadline(), NEVER);
    rig.lever(3000, 0);
    assert!(rig.valve.solenoids(), "200 ms count from now");
    rig.valve.poll(ms(3200));
    assert!(rig.valve.power_save());
}

#[test]
fn a_short_push_counts_200_ms_anew() {
    let mut rig = saving();
    rig.lever(1000, 820);
    rig.lever(1010, 0);
    assert!(rig.valve.solenoids());
    assert_eq!(rig.valve.deadline(), ms(1210));
    rig.valve.poll(ms(1210));
    assert!(rig.valve.power_save());
}

#[test]
fn a_drifting_spool_is_not_left_alone() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Drifting);
    rig.drive(0, BLOCKED);
    rig.valve.poll(ms(1000));
    assert!(rig.valve.solenoids());
}

/// Solenoids that are off hold no position from which the spool could drift.
#[test]
fn a_spool_does_not_drift_while_the_solenoids_are_off() {
    let mut rig = saving();
    rig.spool(1000, SpoolFault::Drifting);
    rig.valve.poll(ms(5000));
    assert_eq!(rig.position(5000), 0);
    assert!(rig.valve.power_save());
}

#[test]
fn is_not_for_a_valve_that_does_not_regulate() {
    for drive in [Drive::Off, Drive::Hand, Drive::EmergencyStop] {
        let mut rig = saving();
        rig.drive(1000, drive);
        assert!(!rig.valve.power_save() && !rig.valve.solenoids());
        rig.valve.poll(ms(5000));
        assert!(!rig.valve.power_save());
    }
}

#[test]
fn monitors_go_on_meanwhile() {
    let mut rig = saving();
    rig.spool(1000, SpoolFault::Stuck);
    rig.valve.start_guard(ms(1000));
    rig.expect_activation(Fault::TimeGuarding, 1250);
    rig.spool(2000, SpoolFault::None);
    rig.lever(2000, 5000);
    rig.expect_activation(Fault::SpoolNotAtSetPoint, 2500);
}
