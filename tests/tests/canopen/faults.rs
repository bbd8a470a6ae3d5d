//! The EMCYs of faults: several at once, bus-off, and the memory's (SPEC 2, 3).

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Duration;
use tests::{Inputs, Rig};

use super::{CLEARED, SAVE, SAVED};

fn emcy(code: u16, register: u8, count: u32) -> String {
    format!("0A0: {:02X} {:02X} {register:02X} {count:02X} 00 00 00 00", code & 0xFF, code >> 8)
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
    assert_eq!(valve.read(0x1001, 0), 0x01);
    valve.sense_sends(|inputs| inputs.internal_fault = false, &[CLEARED]);
}

/// The register is that of 0x1001: one fault goes at the look at which another comes.
#[test]
fn a_fault_that_goes_when_another_comes_is_not_in_its_register() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.supply_mv = 8_000);
    valve.silent_until(2000, &[emcy(0x3412, 0x05, 1)]);
    let swap = |inputs: &mut Inputs| (inputs.supply_mv, inputs.internal_fault) = (24_000, true);
    valve.sense_sends(swap, &[&emcy(0x1000, 0x01, 1)]);
    assert_eq!(valve.read(0x1001, 0), 0x01);
    // Several come: those that stay are in it, each from its own EMCY on.
    valve.sense(|inputs| inputs.supply_mv = 40_000);
    valve.silent_until(2000, &[emcy(0x3411, 0x05, 1)]);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(249);
    valve.sense_sends(|inputs| (inputs.supply_mv, inputs.internal_fault) = (24_000, false), &[CLEARED]);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    valve.advance(1);
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    assert_eq!(valve.take(), [emcy(0x8140, 0x11, 1), emcy(0x8301, 0x19, 1)]);
}

/// The time guard and a temperature at the instant of an RPDO: the EMCYs first, then the TPDO, which shows FAULT_HOLD.
#[test]
fn an_emcy_goes_before_the_tpdo_of_the_same_instant() {
    let mut valve = Rig::active();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.leap(Duration::from_millis(250));
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

    #[test]
    fn with_a_fault_of_the_same_instant() {
        let mut valve = Rig::booted();
        valve.sense(|inputs| (inputs.internal_fault, inputs.bus) = (true, BusErrorMode::BusOff));
        valve.expect_nothing();
        set(&mut valve, BusErrorMode::ErrorActive);
        assert_eq!(valve.take(), [emcy(0x1000, 0x01, 1), emcy(0x8140, 0x11, 1)]);
        assert_eq!(valve.read(0x1001, 0), 0x01);
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
