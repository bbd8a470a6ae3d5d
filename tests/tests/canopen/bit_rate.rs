//! The bit rate: configured, activated, stored (SPEC 4.4, 4.5; use case 5).

use protocol_core::controller::BitRate;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;

const BOOT: [&str; 2] = ["720: 00", CLEARED];
const CLEARED: &str = "0A0: 00 00 00 00 00 00 00 00";
const TO_CONFIGURATION: &str = "7E5: 04 01 00 00 00 00 00 00";
const TO_500K: &str = "7E5: 13 00 02 00 00 00 00 00";
const TAKEN: &str = "7E4: 13 00 00 00 00 00 00 00";
const STORE: &str = "7E5: 17 00 00 00 00 00 00 00";
const STORED: &str = "7E4: 17 00 00 00 00 00 00 00";

/// A valve with 500 kbit/s pending.
fn configured() -> Rig {
    let mut valve = Rig::booted();
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.exchange(TO_500K, &[TAKEN]);
    valve
}

#[test]
fn use_case_5() {
    let mut valve = Rig::booted();
    valve.exchange("000: 02 00", &[]);
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.exchange(TO_500K, &[TAKEN]);
    assert_eq!(valve.bit_rates(), [], "not before it is activated");
    valve.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    assert_eq!(valve.bit_rates(), [BitRate::Kbit500]);
    valve.exchange(STORE, &[STORED]);
    valve.exchange("000: 81 00", &BOOT);
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT);
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
}

#[test]
fn every_table_and_index() {
    for table in 0..=255_u8 {
        for index in 0..=255_u8 {
            let rate = match (table, index) {
                (0, 2) => Some(BitRate::Kbit500),
                (0, 3) => Some(BitRate::Kbit250),
                (0, 4) => Some(BitRate::Kbit125),
                _ => None,
            };
            if rate.is_none() && table > 1 && index > 5 {
                continue;
            }
            let mut valve = Rig::booted();
            valve.exchange(TO_CONFIGURATION, &[]);
            let error = u8::from(rate.is_none());
            let request = format!("7E5: 13 {table:02X} {index:02X} 00 00 00 00 00");
            valve.exchange(&request, &[&format!("7E4: 13 {error:02X} 00 00 00 00 00 00")]);
            valve.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
            assert_eq!(valve.bit_rates(), [rate.unwrap_or(BitRate::Kbit250)], "{table} {index}");
        }
    }
}

/// The delay runs twice: the rate changes after the first, and nothing is sent until the second has passed.
#[test]
fn the_two_delays() {
    for (delay, request) in [(1000, "7E5: 15 E8 03 00 00 00 00 00"), (1, "7E5: 15 01 00 00 00 00 00 00")] {
        let mut valve = configured();
        valve.exchange(request, &[]);
        let step = Duration::from_micros(1);
        valve.advance_by(Duration::from_millis(delay) - step);
        assert_eq!(valve.bit_rates(), [], "{delay}");
        valve.advance_by(step);
        assert_eq!(valve.bit_rates(), [BitRate::Kbit500], "{delay}");
        assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
        valve.advance_by(Duration::from_millis(delay) - step);
        valve.exchange("620: 40 00 10 00 00 00 00 00", &[]);
        valve.advance_by(step);
        valve.expect_nothing();
        assert_eq!(valve.read(0x1000, 0), 0x198, "{delay}");
        assert_eq!(valve.bit_rates().len(), 1);
    }
}

/// Answers and heartbeats of the silence are lost; the heartbeat goes on in its rhythm.
#[test]
fn the_silence() {
    let mut valve = Rig::booted();
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.exchange(TO_500K, &[TAKEN]);
    valve.write(0x1017, 0, 2, 100).unwrap();
    valve.take();
    valve.advance(50);
    valve.exchange("7E5: 15 FA 00 00 00 00 00 00", &[]);
    for frame in [
        "620: 40 00 10 00 00 00 00 00",
        "7E5: 5E 00 00 00 00 00 00 00",
        STORE,
        "7E5: 15 00 00 00 00 00 00 00",
        "7E5: 04 00 00 00 00 00 00 00",
        "1BC78820: 03 22 F0 10",
    ] {
        valve.exchange(frame, &[]);
        valve.advance(20);
    }
    valve.advance(379);
    valve.expect_nothing();
    valve.advance(1);
    valve.expect_nothing();
    valve.advance(50);
    assert_eq!(valve.take(), ["720: 7F"], "600 ms after the first");
    // the requests were not served later, and configuration was not left
    valve.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E 20 00 00 00 00 00 00"]);
}

/// An EMCY waits for the end of the silence.
#[test]
fn an_emcy_waits() {
    let mut valve = configured();
    valve.exchange("7E5: 15 64 00 00 00 00 00 00", &[]);
    valve.sense(|senses| senses.internal_fault = true);
    valve.advance(199);
    valve.expect_nothing();
    valve.advance(1);
    assert_eq!(valve.take(), ["0A0: 00 10 01 01 00 00 00 00"]);
}

/// But not beyond a stop: in stopped it cannot be sent, and later it is not.
#[test]
fn an_emcy_does_not_wait_for_the_end_of_stopped() {
    let mut valve = configured();
    valve.exchange("7E5: 15 64 00 00 00 00 00 00", &[]);
    valve.sense(|senses| senses.internal_fault = true);
    valve.exchange("000: 02 00", &[]);
    valve.advance(200);
    valve.exchange("000: 80 00", &[]);
    assert_eq!(valve.read(0x1003, 1), 0x0001_1000);
}

/// Orders are obeyed meanwhile; a start drops nothing that is on its way.
#[test]
fn a_start_during_the_silence() {
    let mut valve = configured();
    valve.exchange("7E5: 15 64 00 00 00 00 00 00", &[]);
    valve.exchange("000: 01 00", &[]);
    valve.exchange("220: 01 00 00 00", &[]);
    valve.advance(200);
    assert_eq!(valve.bit_rates(), [BitRate::Kbit500]);
    valve.exchange("220: 01 00 00 00", &["1A0: 09 00 00 00"]);
}

/// An answer that waits for the bus is not sent at the new rate.
#[test]
fn what_waits_for_the_bus_is_dropped() {
    let mut valve = configured();
    valve.hold_bus(true);
    valve.send("620: 40 00 10 00 00 00 00 00");
    valve.send("7E5: 15 00 00 00 00 00 00 00");
    valve.hold_bus(false);
    valve.expect_nothing();
    assert_eq!(valve.bit_rates(), [BitRate::Kbit500]);
}

/// Without a configured rate the present one is switched to, and the silence is kept all the same.
#[test]
fn activated_without_being_configured() {
    let mut valve = Rig::booted();
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.exchange("7E5: 15 64 00 00 00 00 00 00", &[]);
    valve.advance(199);
    valve.exchange("620: 40 00 10 00 00 00 00 00", &[]);
    valve.advance(1);
    assert_eq!(valve.bit_rates(), [BitRate::Kbit250]);
    assert_eq!(valve.read(0x1000, 0), 0x198);
}

/// Activated and not stored: gone at the next start, which a reset of the communication is not.
#[test]
fn activated_and_not_stored() {
    let mut valve = configured();
    valve.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    valve.exchange("000: 82 00", &BOOT);
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
    valve.exchange("000: 81 00", &BOOT);
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit250);
}

/// Activated, tried in operational, then stored.
#[test]
fn stored_after_it_was_tried() {
    let mut valve = configured();
    valve.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    valve.exchange("000: 01 00", &[]);
    valve.exchange("000: 80 00", &[]);
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.exchange(STORE, &[STORED]);
    valve.power_cycle();
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
}

/// Stored and not activated: in force at the next start, which a reset of the communication is not.
#[test]
fn stored_and_not_activated() {
    let mut valve = configured();
    valve.exchange(STORE, &[STORED]);
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &[]);
    assert_eq!((valve.device().bit_rate(), valve.bit_rates()), (BitRate::Kbit250, &[][..]));
    valve.exchange("000: 82 00", &BOOT);
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit250);
    valve.exchange("000: 81 00", &BOOT);
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
}

#[test]
fn pending_and_neither_is_dropped() {
    for order in ["000: 81 00", "000: 82 00"] {
        let mut valve = configured();
        valve.exchange(order, &BOOT);
        valve.exchange(TO_CONFIGURATION, &[]);
        valve.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
        assert_eq!(valve.bit_rates(), [BitRate::Kbit250], "{order}");
    }
}

#[test]
fn without_a_node_id() {
    let mut valve = Rig::power_on(Setup { node_id: None, ..Setup::new(Kind::PveaCanopen) });
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.exchange(TO_500K, &[TAKEN]);
    valve.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    valve.exchange(STORE, &[STORED]);
    valve.power_cycle();
    assert_eq!((valve.device().bit_rate(), valve.node_id()), (BitRate::Kbit500, None));
}
