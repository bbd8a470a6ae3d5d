//! NMT: boot-up, what an order does, what survives which reset, and what a state lets through (SPEC 4.2, 4.3).

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Duration;
use tests::{Rig, lss};

use super::{BOOT, CLEARED, SAVE};

const TEMPERATURE: &str = "0A0: 01 83 09 01 00 00 00 00";

/// What survives a reset: object, what is written before, what is read after reset communication and application.
#[test]
fn what_survives() {
    const NODE: u32 = 0x20;
    let table: [(u16, u8, u8, u32, u32, u32); 12] = [
        (0x1005, 0, 4, 0x81, 0x80, 0x80),
        (0x1017, 0, 2, 5000, 0, 0),
        (0x1028, 1, 4, 0xA1, 0x8000_0000, 0x8000_0000),
        (0x1400, 1, 4, 0x8000_0220, 0x200 + NODE, 0x200 + NODE),
        (0x1600, 0, 1, 1, 2, 2),
        (0x1600, 1, 4, 0x6300_0110, 0x6040_0010, 0x6040_0010),
        (0x1800, 2, 1, 7, 0xFF, 0xFF),
        (0x6042, 0, 1, 2, 2, 1),
        (0x6040, 0, 2, 0x1234, 0x1234, 0),
        (0x6300, 1, 2, 0x4000, 0x4000, 0),
        (0x3300, 0, 1, 127, 127, 0),
        (0x6053, 0, 4, u32::from_le_bytes(*b"abcd"), u32::from_le_bytes(*b"abcd"), 0),
    ];
    for communication in [true, false] {
        let mut valve = Rig::booted();
        valve.internal_fault_comes_and_goes();
        for (index, sub, size, value, ..) in table {
            valve.take();
            valve.write(index, sub, size, value).unwrap();
        }
        valve.take();
        valve.exchange(if communication { "000: 82 00" } else { "000: 81 00" }, &BOOT);
        for (index, sub, .., after_communication, after_application) in table {
            let expected = if communication { after_communication } else { after_application };
            if index == 0x6053 && !communication {
                assert_eq!(valve.read_segmented(0x6053, 0).unwrap(), b"PVEA-CI S6");
            } else {
                assert_eq!(valve.read(index, sub), expected, "{index:04X}:{sub}, communication: {communication}");
            }
        }
        assert_eq!(valve.read(0x1003, 0), u32::from(communication), "the history");
        assert_eq!(valve.read(0x2024, 0), 1, "the counters");
    }
}

/// Reset communication: the faults that are active are told again by priority, not counted, not entered again.
#[test]
fn reset_communication_with_active_faults() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(250);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.take();
    for _ in 0..3 {
        let sent = [BOOT[0], BOOT[1], "0A0: 00 10 09 01 00 00 00 00", TEMPERATURE];
        valve.exchange("000: 82 00", &sent);
    }
    assert_eq!((valve.read(0x1003, 0), valve.read(0x2024, 0), valve.read(0x200F, 0)), (2, 1, 1));
    assert_eq!((valve.read(0x1001, 0), valve.status()), (0x09, 0x03));
    valve.sense_sends(|inputs| inputs.internal_fault = false, &[]);
    valve.sense(|inputs| inputs.temperature_c = 25);
    valve.expect(CLEARED);
}

/// Reset application forgets them: causes that last are found anew after their delay, and counted.
#[test]
fn reset_application_with_active_faults() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(250);
    valve.expect(TEMPERATURE);
    valve.exchange("000: 81 00", &BOOT);
    assert_eq!((valve.read(0x1001, 0), valve.status(), valve.read(0x1003, 0)), (0, 0x08, 0));
    valve.silent_until(250, &["0A0: 01 83 09 02 00 00 00 00"]);
    // those without delay at once
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.take();
    valve.exchange("000: 81 00", &[BOOT[0], BOOT[1], "0A0: 00 10 01 02 00 00 00 00"]);
}

/// A delay that runs when the communication is reset goes on: the application is not restarted.
#[test]
fn reset_communication_does_not_restart_a_delay() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(200);
    valve.exchange("000: 82 00", &BOOT);
    valve.silent_until(50, &[TEMPERATURE]);
}

/// A fault that falls due while the reset waits for the memory is told once, behind the reset EMCY.
#[test]
fn a_fault_that_falls_due_during_a_reset_is_told_once() {
    for save_ms in [100, 50] {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(save_ms);
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance(200);
        valve.send(SAVE);
        valve.exchange("000: 82 00", &[]);
        // The fault log is written before the restart when the fault falls due before it.
        valve.advance(2 * save_ms);
        assert_eq!(valve.take(), [BOOT[0], BOOT[1], TEMPERATURE], "the memory takes {save_ms} ms");
        assert_eq!((valve.read(0x1003, 0), valve.read(0x200F, 0)), (1, 1));
        valve.sense(|inputs| inputs.temperature_c = 25);
        valve.expect(CLEARED);
    }
}

/// A bus-off that begins while the reset waits for the memory is found anew, as all causes are that last.
#[test]
fn a_bus_off_that_begins_during_a_reset() {
    // Reset application keeps the count of before and detects the cause anew.
    for (reset, count) in [("000: 81 00", 2), ("000: 82 00", 1)] {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(50);
        valve.send_all(&[SAVE, reset]);
        valve.advance(25);
        valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
        valve.silent_for(1000);
        valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        let bus_off = format!("0A0: 40 81 11 {count:02X} 00 00 00 00");
        assert_eq!(valve.take(), [BOOT[0], BOOT[1], &bus_off, CLEARED], "{reset}");
        assert_eq!((valve.read(0x2019, 0), valve.status()), (count, 0x03));
    }
}

#[test]
fn stopped_lets_only_nmt_heartbeat_lss_and_uds_through() {
    let mut valve = Rig::booted();
    valve.write_all(&[(0x1028, 1, 4, 0xA1), (0x1017, 0, 2, 100)]);
    valve.take();
    valve.activate();
    valve.exchange("000: 02 00", &[]);
    for silent in [
        "620: 40 00 10 00 00 00 00 00",
        "220: 0F 00 00 40",
        "080:",
        "0A1: 00 10 01 00 00 00 00 00",
        "620: 2F 42 60 00 02 00 00 00",
    ] {
        valve.exchange(silent, &[]);
    }
    valve.advance_sends(100, &["720: 04"]);
    valve.exchange("1BC78820: 03 22 F0 10", &["1BC100F1: 04 62 F0 10 A5"]);
    valve.exchange(lss::TO_CONFIGURATION, &[]);
    valve.exchange(lss::INQUIRE_NODE_ID, &["7E4: 5E 20 00 00 00 00 00 00"]);
    valve.exchange("000: 80 00", &[]);
    assert_eq!((valve.read(0x6042, 0), valve.read(0x6300, 1), valve.status()), (1, 0, 0x03));
}

/// A fault that falls due in stopped is counted; one that begins or ends there is told as far as it can be.
#[test]
fn faults_and_stopped() {
    let mut valve = Rig::booted();
    valve.exchange("000: 02 00", &[]);
    valve.internal_fault_comes_and_goes();
    valve.exchange("000: 81 00", &BOOT);
    assert_eq!(valve.read(0x2024, 0), 1);
    // one that lasts: its end is told when SDOs are served again
    let mut valve = Rig::booted();
    valve.exchange("000: 02 00", &[]);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.exchange("000: 80 00", &[]);
    assert_eq!((valve.read(0x1001, 0), valve.read(0x2024, 0)), (0x01, 1));
    valve.sense_sends(|inputs| inputs.internal_fault = false, &[CLEARED]);
    // one that ends while stopped: its end is not told later
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.take();
    valve.exchange("000: 02 00", &[]);
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.exchange("000: 80 00", &[]);
    valve.silent_for(1000);
    assert_eq!(valve.read(0x1001, 0), 0);
    // bus-off and back while stopped
    valve.exchange("000: 02 00", &[]);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    valve.sense_sends(|inputs| inputs.bus = BusErrorMode::ErrorActive, &[]);
    valve.exchange("000: 80 00", &[]);
    assert_eq!(valve.read(0x2019, 0), 1);
}

/// No EMCY for the shutdown that a stop is; the second one does nothing.
#[test]
fn a_stop_is_no_fault() {
    let mut valve = Rig::active();
    valve.send("220: 0F 00 00 40");
    valve.advance(200);
    valve.take();
    valve.exchange("000: 02 00", &[]);
    assert!(!valve.outputs().solenoids);
    valve.exchange("000: 02 00", &[]);
    valve.silent_for(10_000);
    valve.exchange("000: 01 00", &[]);
    assert_eq!((valve.read(0x1001, 0), valve.read(0x1003, 0), valve.read(0x6301, 1)), (0, 0, 0));
    // D11 leaves it at once
    valve.exchange("220: 03 00 00 00", &["1A0: 03 00 00 00"]);
    valve.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
}
