//! Limits and delays of the faults, how each is told, counted and ended, and what it does (SPEC 2, 3).

use protocol_core::time::Duration;
use tests::Inputs;

use super::valve::{FULL, Fault, NEUTRAL, TIME_GUARDING, Valve, each_valve};

const ONE: Duration = Duration::from_micros(1);

/// A cause that is sensed: what brings the fault, what is just not enough, and what ends it.
struct Cause {
    fault: Fault,
    trips: fn(&mut Inputs),
    tolerated: fn(&mut Inputs),
    delay_ms: u64,
    /// Of CANopen: the error register, and the counters.
    register: u32,
    counters: &'static [u16],
    /// Within the limit, but not within the hysteresis.
    not_clear_yet: fn(&mut Inputs),
    clears: fn(&mut Inputs),
    only_canopen: bool,
}

const INTERNAL: Cause = Cause {
    fault: Fault { emcy: "00 10 01", dm1: "10 FF FA 8F 8B" },
    trips: |inputs| inputs.internal_fault = true,
    tolerated: |_| {},
    delay_ms: 0,
    register: 0x01,
    counters: &[0x2024, 0x2040],
    not_clear_yet: |_| {},
    clears: |inputs| inputs.internal_fault = false,
    only_canopen: false,
};
const HOT: Cause = Cause {
    fault: Fault { emcy: "01 83 09", dm1: "04 FF F1 8F 90" },
    trips: |inputs| inputs.temperature_c = 121,
    tolerated: |inputs| inputs.temperature_c = 120,
    delay_ms: 250,
    register: 0x09,
    counters: &[0x200F],
    not_clear_yet: |inputs| inputs.temperature_c = 116,
    clears: |inputs| inputs.temperature_c = 115,
    only_canopen: false,
};
const CAUSES: [Cause; 5] = [
    INTERNAL,
    HOT,
    Cause {
        trips: |inputs| inputs.temperature_c = -41,
        tolerated: |inputs| inputs.temperature_c = -40,
        not_clear_yet: |inputs| inputs.temperature_c = -36,
        clears: |inputs| inputs.temperature_c = -35,
        only_canopen: true,
        ..HOT
    },
    Cause {
        fault: Fault { emcy: "11 34 05", dm1: "04 FF 73 02 03" },
        trips: |inputs| inputs.supply_mv = 36_001,
        tolerated: |inputs| inputs.supply_mv = 36_000,
        delay_ms: 2000,
        register: 0x05,
        counters: &[0x2001],
        not_clear_yet: |inputs| inputs.supply_mv = 32_000,
        clears: |inputs| inputs.supply_mv = 31_999,
        only_canopen: false,
    },
    Cause {
        fault: Fault { emcy: "12 34 05", dm1: "04 FF 73 02 04" },
        trips: |inputs| inputs.supply_mv = 8_999,
        tolerated: |inputs| inputs.supply_mv = 9_000,
        delay_ms: 2000,
        register: 0x05,
        counters: &[0x2002],
        not_clear_yet: |inputs| inputs.supply_mv = 11_000,
        clears: |inputs| inputs.supply_mv = 11_001,
        only_canopen: false,
    },
];

/// Runs a test of a new valve of each kind with each cause that it knows.
fn each_cause(test: impl Fn(Valve, &Cause)) {
    each_valve(|valve| {
        for cause in CAUSES.iter().filter(|cause| !(valve.is_isobus && cause.only_canopen)) {
            println!("{:?}", cause.fault);
            test(valve.anew(), cause);
        }
    });
}

/// Nothing is told for so long less a microsecond.
#[track_caller]
fn silent_until(valve: &mut Valve, ms: u64) {
    if ms > 0 {
        valve.rig.advance_by(Duration::from_micros(ms * 1000 - 1));
        assert_eq!(valve.told(), [""; 0]);
        valve.rig.advance_by(ONE);
    }
}

#[test]
fn each_is_told_after_its_delay_and_ends_at_once() {
    each_cause(|mut valve, cause| {
        valve.sense(cause.tolerated);
        valve.rig.advance(10_000);
        valve.sense(cause.trips);
        silent_until(&mut valve, cause.delay_ms);
        assert_eq!(valve.told(), [valve.tells(cause.fault, 1)]);
        if !valve.is_isobus {
            assert_eq!(valve.rig.read(0x1001, 0), cause.register);
        }
        valve.sense(cause.not_clear_yet);
        valve.rig.advance(10_000);
        assert_eq!(valve.told(), [""; 0]);
        valve.sense(cause.clears);
        assert_eq!(valve.told(), [valve.cleared()]);
        assert!(valve.is_shut_down(), "it stays so");
        if !valve.is_isobus {
            let [low, high] = [0, 3].map(|at| u32::from_str_radix(&cause.fault.emcy[at..at + 2], 16).unwrap());
            let history = [valve.rig.read(0x1003, 0), valve.rig.read(0x1003, 1)];
            assert_eq!((valve.rig.read(0x1001, 0), history), (0, [1, 0x0001_0000 | high << 8 | low]));
            for index in [0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024, 0x2040] {
                assert_eq!(valve.rig.read(index, 0), u32::from(cause.counters.contains(&index)), "{index:04X}");
            }
        }
    });
}

/// Not in the counters, nor in the memory; and its delay begins anew.
#[test]
fn a_cause_that_ends_a_moment_before_its_delay_leaves_no_trace() {
    each_cause(|mut valve, cause| {
        if cause.delay_ms == 0 {
            return;
        }
        let writes = valve.rig.writes.len();
        for _ in 0..5 {
            valve.sense(cause.trips);
            valve.rig.advance_by(Duration::from_micros(cause.delay_ms * 1000 - 1));
            valve.sense(cause.tolerated);
        }
        valve.rig.advance(20_000);
        assert_eq!((valve.told(), valve.rig.writes.len()), (vec![], writes));
        valve.sense(cause.trips);
        silent_until(&mut valve, cause.delay_ms);
        assert_eq!(valve.told(), [valve.tells(cause.fault, 1)]);
    });
}

#[test]
fn a_cause_at_power_up_activates_after_its_normal_delay() {
    each_cause(|mut valve, cause| {
        valve.sense(cause.trips);
        valve.rig.advance(5_000);
        let waited = valve.power_cycle();
        silent_until(&mut valve, cause.delay_ms.saturating_sub(waited));
        assert_eq!(valve.told(), [valve.tells(cause.fault, 2)]);
        assert!(valve.is_shut_down());
    });
}

#[test]
fn each_shuts_the_regulation_down() {
    each_cause(|valve, cause| {
        let mut valve = valve.commanded(FULL);
        valve.hold(FULL, 1000);
        valve.sense(cause.trips);
        assert_eq!(valve.hold(FULL, cause.delay_ms), [valve.tells(cause.fault, 1)]);
        springs_back(&mut valve);
    });
}

/// From the instant of a shutdown at full stroke on.
#[track_caller]
fn springs_back(valve: &mut Valve) {
    assert!(!valve.solenoids());
    for expected in [100, 50, 0] {
        assert_eq!(valve.position(), expected);
        valve.rig.advance(75);
    }
    // a spool that is moved does not energise them
    valve.lever(Some(4000));
    assert!(!valve.solenoids() && valve.is_shut_down());
}

#[test]
fn so_does_a_master_that_falls_silent() {
    each_valve(|valve| {
        let mut valve = valve.commanded(FULL);
        valve.hold(FULL, 400);
        silent_until(&mut valve, 249);
        assert!(valve.solenoids());
        silent_until(&mut valve, 1);
        assert_eq!(valve.told(), [valve.tells(TIME_GUARDING, 1)]);
        springs_back(&mut valve);
    });
}

#[test]
fn counters_stop_at_127_and_go_on_being_told() {
    each_valve(|mut valve| {
        for count in 1..=130 {
            let count = count.min(127);
            valve.sense(INTERNAL.trips);
            assert_eq!(valve.told(), [valve.tells(INTERNAL.fault, count)]);
            if !valve.is_isobus {
                let read = [(0x2024, 0), (0x2040, 0), (0x1003, 1)].map(|(index, sub)| valve.rig.read(index, sub));
                assert_eq!(read, [count, count, count << 16 | 0x1000]);
            }
            valve.sense(INTERNAL.clears);
            assert_eq!(valve.told(), [valve.cleared()]);
        }
        // each counts for itself
        for count in [1, 2] {
            valve.sense(HOT.trips);
            assert_eq!(valve.hold(NEUTRAL, 250), [valve.tells(HOT.fault, count)]);
            valve.sense(HOT.clears);
            assert_eq!(valve.told(), [valve.cleared()]);
        }
    });
}
