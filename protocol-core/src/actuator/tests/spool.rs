//! The movement of the spool (SPEC 2).

use super::*;
use crate::time::NEVER;

#[test]
fn takes_250_ms_from_neutral_to_full_stroke_and_150_ms_back_by_springs() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    assert_eq!([0, 125, 250, 900].map(|at| rig.position(at)), [0, 8192, 16384, 16384]);
    assert!(rig.valve.position(ms(250) - MICROSECOND).raw() < 16384);
    rig.drive(1000, Drive::Off);
    assert_eq!([1000, 1075, 1150, 1900].map(|at| rig.position(at)), [16384, 8192, 0, 0]);
}

#[test]
fn turns_round_where_it_is() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.drive(100, to(-16384));
    let turned = rig.position(100);
    assert_eq!(turned, 6553); // 16384 × 100 / 250 = 6553.6
    assert_eq!([200, 350, 600].map(|at| rig.position(at)), [0, -9830, -16384]);
}

#[test]
fn an_on_off_valve_knows_full_stroke_only() {
    let mut rig = Rig::new(ValveConfig { actuator_type: ActuatorType::OnOff, ..CANOPEN });
    rig.drive(0, to(1));
    assert_eq!(rig.position(250), 16384);
    rig.drive(300, to(-1));
    assert_eq!(rig.position(800), -16384);
    assert_eq!(rig.active(ms(2000)), FaultSet::EMPTY);
    rig.drive(2000, BLOCKED);
    assert_eq!(rig.position(2250), 0);
}

#[test]
fn float_is_reached_within_5_percent_of_the_b_side() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, FLOAT);
    // 95 % of 250 ms
    assert!(!rig.valve.float_reached(Instant::from_micros(237_499)));
    assert!(rig.valve.float_reached(Instant::from_micros(237_500)));
    assert_eq!(rig.position(250), 16384);
    rig.drive(300, to(16384));
    assert!(!rig.valve.float_reached(ms(300)), "only while float acts");
}

#[test]
fn neutral_is_within_5_percent() {
    let mut rig = Rig::new(CANOPEN);
    for (raw, neutral) in [(819, true), (-819, true), (820, false), (-820, false)] {
        rig.lever(0, raw);
        assert_eq!(rig.valve.in_neutral(ms(0)), neutral, "{raw}");
    }
}

#[test]
fn the_lever_wins_over_solenoids_and_springs() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.lever(100, -4000);
    assert_eq!([100, 101, 400].map(|at| rig.position(at)), [-4000; 3]);
    rig.drive(400, Drive::Hand);
    assert!(!rig.valve.solenoids());
    assert_eq!(rig.position(450), -4000);
    rig.release_lever(500);
    // 4000 / 16384 × 150 ms = 36.6 ms
    assert!(rig.position(536) < 0 && rig.position(537) == 0);
}

#[test]
fn a_stuck_spool_stays_where_it_is_whoever_pushes() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.spool(125, SpoolFault::Stuck);
    assert_eq!([125, 200].map(|at| rig.position(at)), [8192; 2]);
    rig.lever(200, -16384);
    rig.drive(210, Drive::Off);
    assert_eq!([210, 1000].map(|at| rig.position(at)), [8192; 2]);
    rig.release_lever(1000);
    rig.spool(1000, SpoolFault::None);
    assert_eq!([1000, 1075].map(|at| rig.position(at)), [8192, 0]);
}

#[test]
fn a_slow_spool_takes_eight_times_as_long() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Slow);
    rig.drive(0, to(16384));
    assert_eq!([250, 1000, 2000].map(|at| rig.position(at)), [2048, 8192, 16384]);
    rig.drive(3000, Drive::Off);
    assert_eq!([3600, 4200].map(|at| rig.position(at)), [8192, 0]);
}

#[test]
fn a_drifting_spool_creeps_away_as_long_as_the_solenoids_act() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Drifting);
    rig.drive(0, to(8192));
    // The spool arrives at 125 ms, and creeps 20 % in another 1600 ms.
    assert_eq!([100, 125, 925, 1725, 9000].map(|at| rig.position(at)), [6553, 8192, 9830, 11468, 11468]);
    rig.drive(9000, Drive::Off);
    assert_eq!(rig.position(9150), 0);
    // Without room towards B it creeps towards A.
    rig.drive(10_000, to(16384));
    assert_eq!(rig.position(12_000), 13107);
}

#[test]
fn another_sense_does_not_disturb_the_drift() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Drifting);
    rig.drive(0, to(8192));
    rig.sense(500, |inputs| inputs.supply_mv = 23_000);
    assert_eq!(rig.position(925), 9830);
    // Neither do oil that grows cold, noise, or a dead-band.
    for at in 1000..1500 {
        rig.sense(at, |inputs| inputs.spool.times = SpoolTimes::new(at as u16, at as u16).unwrap());
        let offset = Position::new(if at % 2 == 0 { 300 } else { -300 }).unwrap();
        rig.sense(at, |inputs| inputs.spool.roughness = Roughness { offset, dead_band: 7 });
    }
    assert_eq!([1500, 1725, 9000].map(|at| rig.position(at)), [11_008, 11_468, 11_468]);
}

#[test]
fn without_float_the_spool_stops_short_of_it() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::NoFloat);
    rig.drive(0, FLOAT);
    assert_eq!(rig.position(900), 13107); // 80 %
    assert!(!rig.valve.float_reached(ms(900)));
    rig.drive(900, to(16384));
    assert_eq!(rig.position(1900), 16384, "full stroke is not float");
}

#[test]
fn a_measured_position_takes_the_models_place() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    let measured = |raw| move |inputs: &mut ValveInputs| inputs.spool.measured = Position::new(raw);
    rig.lever(0, 5000);
    rig.sense(100, measured(1234));
    assert_eq!([100, 250].map(|at| rig.position(at)), [1234; 2]);
    rig.spool(300, SpoolFault::Stuck);
    rig.sense(300, measured(-1234));
    assert_eq!(rig.position(300), -1234);
}

#[test]
fn a_restart_leaves_the_spool_where_it_is_and_lets_go_of_it() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.valve.restart(Counters::default(), ms(300));
    assert_eq!([300, 375, 450].map(|at| rig.position(at)), [16384, 8192, 0]);
    assert!(!rig.valve.regulating());
}

#[test]
fn a_spool_at_rest_is_due_for_nothing() {
    let mut rig = Rig::new(CANOPEN);
    assert_eq!(rig.valve.deadline(), NEVER);
    rig.drive(0, to(16384));
    // Within 15 % of the set-point: 85 % of 250 ms.
    assert_eq!(rig.valve.deadline(), Instant::from_micros(212_500));
    rig.valve.poll(Instant::from_micros(212_500));
    assert_eq!(rig.valve.deadline(), NEVER);
}

#[test]
fn takes_the_times_that_were_measured() {
    let timed = |stroke_ms, return_ms| {
        let mut rig = Rig::new(CANOPEN);
        let times = SpoolTimes::new(stroke_ms, return_ms).unwrap();
        rig.sense(0, |inputs| inputs.spool.times = times);
        rig
    };
    let mut rig = timed(400, 300);
    rig.drive(0, to(16384));
    assert_eq!([0, 200, 399, 400].map(|at| rig.position(at)), [0, 8192, 16343, 16384]);
    rig.drive(1000, Drive::Off);
    assert_eq!([1000, 1150, 1299, 1300].map(|at| rig.position(at)), [16384, 8192, 54, 0]);

    // Slow, by solenoids and springs alike.
    let mut rig = timed(100, 60);
    rig.sense(0, |inputs| inputs.spool.fault = SpoolFault::Slow);
    rig.drive(0, to(8192));
    assert_eq!([200, 400].map(|at| rig.position(at)), [4096, 8192]);

    // Every stroke time is accurate to 0.4 %.
    for millis in SpoolTimes::RANGE_MS {
        let mut rig = timed(millis, millis);
        rig.drive(0, to(16384));
        let allowed = u64::from(millis) * 4;
        let arrives = |micros: u64| rig.valve.position(Instant::from_micros(micros)).raw() == 16384;
        let whole = u64::from(millis) * 1000;
        assert!(!arrives(whole - allowed - 1) && arrives(whole + allowed + 1), "{millis} ms");
    }
    for impossible in [(9, 150), (250, 5001), (0, 150), (250, 0)] {
        assert_eq!(SpoolTimes::new(impossible.0, impossible.1), None);
    }
}

/// New times apply to the rest of a movement in progress.
#[test]
fn other_times_count_from_where_it_is() {
    let mut rig = Rig::new(CANOPEN);
    rig.drive(0, to(16384));
    rig.sense(125, |inputs| inputs.spool.times = SpoolTimes::new(500, 150).unwrap());
    assert_eq!([125, 250, 375].map(|at| rig.position(at)), [8192, 12288, 16384]);
}

/// The monitors apply to the spool as configured: a measured stroke that is too slow for the monitors is a fault, as
/// with a real valve.
#[test]
fn a_stroke_slower_than_the_monitors_is_a_fault() {
    // 85 % of the stroke within 500 ms.
    for (stroke_ms, is_fault) in [(588, false), (590, true)] {
        let mut rig = Rig::new(CANOPEN);
        rig.sense(0, |inputs| inputs.spool.times = SpoolTimes::new(stroke_ms, 150).unwrap());
        rig.drive(0, to(16384));
        assert_eq!(rig.active(ms(501)).contains(Fault::SpoolNotAtSetPoint), is_fault, "{stroke_ms} ms");
    }
    // 95 % of the stroke within 1000 ms.
    for (stroke_ms, is_fault) in [(1052, false), (1054, true)] {
        let mut rig = Rig::new(CANOPEN);
        rig.sense(0, |inputs| inputs.spool.times = SpoolTimes::new(stroke_ms, 150).unwrap());
        rig.drive(0, FLOAT);
        assert_eq!(rig.active(ms(1001)).contains(Fault::FloatNotReached), is_fault, "{stroke_ms} ms");
    }
}

#[test]
fn a_rough_spool_is_beside_its_set_point() {
    let mut rig = Rig::new(CANOPEN);
    let beside = |raw| move |inputs: &mut ValveInputs| inputs.spool.roughness.offset = Position::new(raw).unwrap();
    rig.drive(0, to(8192));
    rig.sense(200, beside(-655));
    // 655 / 16384 × 250 ms = 9.99 ms
    assert_eq!([200, 210, 400].map(|at| rig.position(at)), [8192, 7537, 7537]);
    rig.sense(400, beside(655));
    assert_eq!(rig.position(420), 8847);
    rig.drive(500, to(16384));
    assert_eq!(rig.position(800), 16384, "no further than the end stop");
    rig.drive(800, Drive::Off);
    assert_eq!(rig.position(950), 0, "the springs have no offset");
}

#[test]
fn a_rough_spool_follows_no_small_change() {
    let mut rig = Rig::new(CANOPEN);
    rig.sense(0, |inputs| inputs.spool.roughness.dead_band = 100);
    rig.drive(0, to(8192));
    for (at, set_point, position) in [(300, 8292, 8192), (400, 8293, 8293), (500, 8193, 8293), (600, 8192, 8192)] {
        rig.drive(at, to(set_point));
        assert_eq!(rig.position(at + 50), position, "{set_point}");
    }
    rig.sense(700, |inputs| inputs.spool.roughness.dead_band = 0);
    rig.drive(710, to(8193));
    assert_eq!(rig.position(750), 8193);
}
