//! The faults (SPEC 2 and 3): limits, delays, what each is told by, and how it ends.

use protocol_core::controller::BusErrorMode;
use tests::{Inputs, Rig};

use super::{CLEARED, SAVE, SAVED};

/// A cause that is sensed: what brings the fault, what is just not enough, and what ends it.
struct Row {
    name: &'static str,
    trips: fn(&mut Inputs),
    tolerated: fn(&mut Inputs),
    delay_ms: u64,
    code: u16,
    register: u8,
    counters: &'static [u16],
    /// Within the limit, but not within the hysteresis.
    not_clear_yet: fn(&mut Inputs),
    clears: fn(&mut Inputs),
}

const ROWS: [Row; 6] = [
    Row {
        name: "internal error",
        trips: |inputs| inputs.internal_fault = true,
        tolerated: |_| {},
        delay_ms: 0,
        code: 0x1000,
        register: 0x01,
        counters: &[0x2024, 0x2040],
        not_clear_yet: |_| {},
        clears: |inputs| inputs.internal_fault = false,
    },
    Row {
        name: "CAN bus error",
        trips: |inputs| inputs.bus = BusErrorMode::BusOff,
        tolerated: |inputs| inputs.bus = BusErrorMode::ErrorPassive,
        delay_ms: 0,
        code: 0x8140,
        register: 0x11,
        counters: &[0x2019],
        not_clear_yet: |_| {},
        clears: |inputs| inputs.bus = BusErrorMode::ErrorActive,
    },
    Row {
        name: "temperature, hot",
        trips: |inputs| inputs.temperature_c = 121,
        tolerated: |inputs| inputs.temperature_c = 120,
        delay_ms: 250,
        code: 0x8301,
        register: 0x09,
        counters: &[0x200F],
        not_clear_yet: |inputs| inputs.temperature_c = 116,
        clears: |inputs| inputs.temperature_c = 115,
    },
    Row {
        name: "temperature, cold",
        trips: |inputs| inputs.temperature_c = -41,
        tolerated: |inputs| inputs.temperature_c = -40,
        delay_ms: 250,
        code: 0x8301,
        register: 0x09,
        counters: &[0x200F],
        not_clear_yet: |inputs| inputs.temperature_c = -36,
        clears: |inputs| inputs.temperature_c = -35,
    },
    Row {
        name: "supply too high",
        trips: |inputs| inputs.supply_mv = 36_001,
        tolerated: |inputs| inputs.supply_mv = 36_000,
        delay_ms: 2000,
        code: 0x3411,
        register: 0x05,
        counters: &[0x2001],
        not_clear_yet: |inputs| inputs.supply_mv = 32_000,
        clears: |inputs| inputs.supply_mv = 31_999,
    },
    Row {
        name: "supply too low",
        trips: |inputs| inputs.supply_mv = 8_999,
        tolerated: |inputs| inputs.supply_mv = 9_000,
        delay_ms: 2000,
        code: 0x3412,
        register: 0x05,
        counters: &[0x2002],
        not_clear_yet: |inputs| inputs.supply_mv = 11_000,
        clears: |inputs| inputs.supply_mv = 11_001,
    },
];

fn emcy(code: u16, register: u8, count: u32) -> String {
    format!("0A0: {:02X} {:02X} {register:02X} {count:02X} 00 00 00 00", code & 0xFF, code >> 8)
}

impl Row {
    fn emcy(&self, count: u32) -> String {
        emcy(self.code, self.register, count)
    }

    fn is_bus_off(&self) -> bool {
        self.code == 0x8140
    }
}

#[test]
fn each_is_told_after_its_delay_and_ends_at_once() {
    for row in ROWS {
        let name = row.name;
        let mut valve = Rig::booted();
        valve.sense(row.tolerated);
        valve.silent_for(10_000);
        valve.sense(row.trips);
        if row.delay_ms > 0 {
            valve.silent_for(row.delay_ms - 1);
            assert_eq!((valve.read(0x1001, 0), valve.status()), (0, 0x08), "{name}: not yet");
            valve.advance(1);
        }
        if row.is_bus_off() {
            valve.expect_nothing();
            valve.sense(row.clears);
        } else {
            assert_eq!(valve.take(), [row.emcy(1)], "{name}");
            assert_eq!(valve.read(0x1001, 0), u32::from(row.register), "{name}");
            valve.sense(row.not_clear_yet);
            valve.expect_nothing();
            valve.sense(row.clears);
            valve.send("620: 40 01 10 00 00 00 00 00");
            assert_eq!(valve.take(), [CLEARED, "5A0: 4F 01 10 00 00 00 00 00"], "{name}");
        }
        valve.take();
        assert_eq!(valve.read(0x1001, 0), 0, "{name}");
        assert_eq!(valve.status(), 0x03, "{name}: it stays shut down");
        assert_eq!((valve.read(0x1003, 0), valve.read(0x1003, 1)), (1, 0x0001_0000 | u32::from(row.code)), "{name}");
        for index in [0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024, 0x2040] {
            assert_eq!(valve.read(index, 0), u32::from(row.counters.contains(&index)), "{name}: {index:04X}");
        }
    }
}

#[test]
fn a_cause_that_ends_a_moment_before_its_delay_begins_anew() {
    for row in ROWS.into_iter().filter(|row| row.delay_ms > 0) {
        let mut valve = Rig::booted();
        valve.sense(row.trips);
        valve.advance(row.delay_ms - 1);
        valve.sense(row.tolerated);
        valve.sense(row.trips);
        valve.silent_for(row.delay_ms - 1);
        valve.advance(1);
        assert_eq!(valve.take(), [row.emcy(1)], "{}", row.name);
    }
}

#[test]
fn a_cause_at_power_up_activates_after_its_normal_delay() {
    for row in ROWS.into_iter().filter(|row| !row.is_bus_off()) {
        let mut valve = Rig::booted();
        valve.sense(row.trips);
        valve.advance(5_000);
        valve.take();
        valve.power_cycle();
        valve.expect("720: 00");
        valve.expect(CLEARED);
        if row.delay_ms > 0 {
            valve.silent_for(row.delay_ms - 1);
            assert_eq!(valve.status(), 0x08, "{}: from INIT", row.name);
            valve.advance(1);
        }
        assert_eq!(valve.take(), [row.emcy(2)], "{}", row.name);
        assert_eq!(valve.status(), 0x03);
    }
}

#[test]
fn every_fault_shuts_the_regulation_down() {
    for row in ROWS.into_iter().filter(|row| !row.is_bus_off()) {
        let mut valve = Rig::active();
        valve.send("220: 0F 00 00 40");
        valve.advance_cyclic(1000, "220: 0F 00 00 40");
        valve.take();
        valve.sense(row.trips);
        valve.advance_cyclic(row.delay_ms, "220: 0F 00 00 40");
        assert_eq!(valve.take_under("0A0"), [row.emcy(1)], "{}", row.name);
        assert_eq!((valve.status(), valve.outputs().solenoids), (0x03, false), "{}", row.name);
        assert_eq!(valve.read(0x6301, 1), 16384, "from where the springs take it");
        valve.advance(75);
        assert_eq!(valve.read(0x6301, 1), 8192);
        valve.advance(75);
        assert_eq!(valve.read(0x6301, 1), 0, "{}", row.name);
    }
}

#[test]
fn counters_stop_at_127_and_go_on_being_told() {
    let mut valve = Rig::booted();
    for count in 1..=130 {
        valve.sense(|inputs| inputs.internal_fault = true);
        let count = count.min(127);
        assert_eq!(valve.take(), [emcy(0x1000, 0x01, count)]);
        assert_eq!((valve.read(0x2024, 0), valve.read(0x2040, 0)), (count, count));
        assert_eq!(valve.read(0x1003, 1), count << 16 | 0x1000);
        valve.sense_sends(|inputs| inputs.internal_fault = false, &[CLEARED]);
    }
}

/// Three that fall due at the same instant: one EMCY each, by priority; only the end of the last is told.
#[test]
fn several_at_once() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.supply_mv = 8_000);
    valve.advance(1750);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.silent_until(250, &[emcy(0x8301, 0x09, 1), emcy(0x3412, 0x0D, 1)]);
    valve.sense_sends(|inputs| inputs.internal_fault = true, &[&emcy(0x1000, 0x0D, 1)]);
    assert_eq!(valve.read(0x1003, 0), 3);
    assert_eq!([1, 2, 3].map(|sub| valve.read(0x1003, sub)), [0x0001_1000, 0x0001_3412, 0x0001_8301]);

    valve.sense_sends(|inputs| inputs.temperature_c = 25, &[]);
    assert_eq!(valve.read(0x1001, 0), 0x05);
    valve.sense_sends(|inputs| inputs.supply_mv = 24_000, &[]);
    valve.sense_sends(|inputs| inputs.internal_fault = false, &[CLEARED]);
}

/// The time guard and a temperature at the instant of an RPDO: the EMCYs first, then the TPDO, which shows FAULT_HOLD.
#[test]
fn an_emcy_goes_before_the_tpdo_of_the_same_instant() {
    let mut valve = Rig::active();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.leap(protocol_core::time::Duration::from_millis(250));
    let told = [emcy(0x8301, 0x09, 1), emcy(0x8003, 0x99, 1)];
    assert_eq!(valve.take(), told);

    let mut valve = Rig::active();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.hold_bus(true);
    valve.advance(250);
    // the set-point ends the time guard's fault, and the temperature's goes on
    valve.send("220: 0F 00 00 00");
    valve.hold_bus(false);
    assert_eq!(valve.take(), [&told[..], &["1A0: 03 00 00 00".to_owned()]].concat());
}

mod bus_off {
    use super::*;

    fn set(valve: &mut Rig, bus: BusErrorMode) {
        valve.sense(|inputs| inputs.bus = bus);
    }

    #[test]
    fn nothing_is_sent_until_the_bus_is_back_then_8140_and_its_end() {
        let mut valve = Rig::booted();
        valve.write(0x1017, 0, 2, 100).unwrap();
        valve.take();
        valve.activate();
        set(&mut valve, BusErrorMode::BusOff);
        valve.expect_nothing();
        assert!(!valve.outputs().solenoids);
        valve.silent_for(250);
        set(&mut valve, BusErrorMode::ErrorActive);
        assert_eq!(valve.take(), [emcy(0x8140, 0x11, 1), CLEARED.to_owned()]);
        assert_eq!((valve.status(), valve.read(0x1001, 0), valve.read(0x2019, 0)), (0x03, 0, 1));
        assert_eq!(valve.read(0x1003, 1), 0x0001_8140);
        // the NMT state is what it was, and the heartbeat goes on in its old rhythm
        valve.advance_sends(50, &["720: 05"]);
    }

    /// Error passive is no recovery from bus-off to be waited for, nor a fault.
    #[test]
    fn error_passive_is_no_fault() {
        let mut valve = Rig::booted();
        set(&mut valve, BusErrorMode::ErrorPassive);
        valve.expect_nothing();
        assert_eq!((valve.status(), valve.read(0x1001, 0)), (0x08, 0));
    }

    #[test]
    fn with_another_fault_active_its_end_is_not_told() {
        let mut valve = Rig::booted();
        valve.sense(|inputs| inputs.internal_fault = true);
        valve.take();
        set(&mut valve, BusErrorMode::BusOff);
        set(&mut valve, BusErrorMode::ErrorActive);
        assert_eq!(valve.take(), [emcy(0x8140, 0x11, 1)]);
        valve.sense_sends(|inputs| inputs.internal_fault = false, &[CLEARED]);
    }

    /// EMCYs are told all the same, each activation in its turn: they are how the master learns what happened.
    #[test]
    fn another_fault_meanwhile_is_told_after_it() {
        let mut valve = Rig::booted();
        set(&mut valve, BusErrorMode::BusOff);
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance(250);
        set(&mut valve, BusErrorMode::ErrorActive);
        assert_eq!(valve.take(), [emcy(0x8140, 0x11, 1), emcy(0x8301, 0x19, 1)]);
        valve.sense_sends(|inputs| inputs.temperature_c = 25, &[CLEARED]);
    }

    /// An answer that waits for a busy bus is lost with it.
    #[test]
    fn what_was_queued_is_not_sent() {
        let mut valve = Rig::booted();
        valve.hold_bus(true);
        valve.send("620: 40 00 10 00 00 00 00 00");
        set(&mut valve, BusErrorMode::BusOff);
        valve.hold_bus(false);
        valve.expect_nothing();
        set(&mut valve, BusErrorMode::ErrorActive);
        assert_eq!(valve.take(), [emcy(0x8140, 0x11, 1), CLEARED.to_owned()]);
    }

    /// The boot-up of a valve whose bus is off goes out when it is back, before anything else.
    #[test]
    fn at_power_up() {
        let mut valve = Rig::booted();
        set(&mut valve, BusErrorMode::BusOff);
        valve.advance(1000);
        valve.power_cycle();
        valve.silent_for(1000);
        set(&mut valve, BusErrorMode::ErrorActive);
        let sent = valve.take();
        assert_eq!(sent, ["720: 00", CLEARED, "0A0: 40 81 11 02 00 00 00 00", CLEARED]);
    }
}

mod memory {
    use super::*;

    #[test]
    fn a_watchdog_reset_is_told_counted_and_over() {
        let mut valve = Rig::booted();
        valve.watchdog_reset();
        assert_eq!(valve.take(), ["720: 00", CLEARED, "0A0: 00 10 01 01 00 00 00 00", CLEARED]);
        assert_eq!((valve.status(), valve.read(0x1001, 0), valve.read(0x2024, 0)), (0x03, 0, 1));
        valve.send("000: 81 00");
        assert_eq!(valve.take(), ["720: 00", CLEARED], "it is reported once");
        assert_eq!((valve.status(), valve.read(0x2024, 0)), (0x08, 1));
    }

    #[test]
    fn a_damaged_memory_lasts_until_the_next_start() {
        let mut valve = Rig::booted();
        valve.memory_damaged = true;
        valve.power_cycle_sends(&["720: 00", CLEARED, "0A0: 00 10 01 01 00 00 00 00"]);
        valve.write(0x1010, 1, 4, 0x6576_6173).unwrap();
        valve.advance(20_000);
        assert_eq!((valve.read(0x1001, 0), valve.take().len()), (1, 0));
        valve.memory_damaged = false;
        valve.send("000: 81 00");
        assert_eq!(valve.take(), ["720: 00", CLEARED]);
        assert_eq!(valve.read(0x1001, 0), 0);
    }

    /// Two causes of the internal error are one fault: told once, gone with the last.
    #[test]
    fn causes_of_one_fault_do_not_add_up() {
        let mut valve = Rig::booted();
        valve.sense(|inputs| inputs.internal_fault = true);
        valve.take();
        valve.writes_fail = true;
        assert_eq!(valve.write(0x1010, 1, 4, 0x6576_6173), Err(0x0606_0000));
        valve.writes_fail = false;
        valve.expect_nothing();
        valve.sense_sends(|inputs| inputs.internal_fault = false, &[]);
        valve.exchange(SAVE, &[CLEARED, SAVED]);
        assert_eq!(valve.read(0x2024, 0), 1);
    }
}
