//! How much a reset resets, and what it forgets (SPEC 4.3, 4.5).

use protocol_core::time::Duration;
use tests::Rig;

use super::{BOOT, SAVE};

const INIT: u32 = 0x08;
const HOLD: u32 = 0x0B;
const FAULT_HOLD: u32 = 0x03;

/// A write to the memory, or an answer that the bus does not take: a reset waits for either.
fn waits(valve: &mut Rig, slow_memory: bool) {
    if slow_memory {
        valve.write_time = Duration::from_millis(300);
        valve.send(SAVE);
    } else {
        valve.hold_bus(true);
        valve.send("620: 40 00 10 00 00 00 00 00");
    }
}

/// Only an NMT command for the valve itself makes a reset that waits the larger one.
#[test]
fn what_does_not_widen_a_reset_that_waits() {
    for other in ["000: 81 21", "220: 81 20", "220: 81 00", "080: 81 20", "000: R2"] {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(300);
        valve.send_all(&[SAVE, "000: 82 20", other]);
        valve.advance(300);
        assert_eq!(valve.take(), BOOT, "{other}");
        assert_eq!(valve.status(), FAULT_HOLD, "{other}");
    }
}

/// A new node ID that waits for the memory is in force after the larger reset, too.
#[test]
fn a_stored_node_id_with_two_resets() {
    let mut valve = Rig::booted();
    valve.write_time = Duration::from_millis(300);
    valve.send_all(&["1BC78820: 04 2E 10 01 21", "000: 82 20", "000: 81 20"]);
    valve.advance_sends(300, &["1BC408F1: 03 6E 10 01", "721: 00", "0A1: 00 00 00 00 00 00 00 00"]);
    assert_eq!(valve.status(), INIT);
}

/// A valve in FAULT_HOLD, operational, without a fault.
fn in_fault_hold() -> Rig {
    let mut valve = Rig::booted();
    valve.silent_to(&["000: 02 20", "000: 01 20"]);
    assert_eq!(valve.status(), FAULT_HOLD);
    valve
}

/// The fault reset, 0011 then 1011, is forgotten by a reset or a stop between the two.
#[test]
fn a_reset_or_stop_forgets_half_a_fault_reset() {
    for orders in [&["000: 82 20"][..], &["000: 02 20"], &["000: 02 20", "000: 80 20"], &["000: 80 20", "000: 02 20"]] {
        for by_sdo in [false, true] {
            let mut valve = in_fault_hold();
            let control = |valve: &mut Rig, word: u8| {
                valve.send("000: 01 20");
                if by_sdo {
                    valve.send(&format!("620: 2B 40 60 00 {word:02X} 00 00 00"));
                } else {
                    valve.send(&format!("220: {word:02X} 00 00 00"));
                }
                valve.take();
                valve.status()
            };
            assert_eq!(control(&mut valve, 0x03), FAULT_HOLD);
            for order in orders {
                valve.send(order);
            }
            valve.take();
            assert_eq!(control(&mut valve, 0x0B), FAULT_HOLD, "{orders:?}");
            assert_eq!(control(&mut valve, 0x03), FAULT_HOLD, "{orders:?}");
            assert_eq!(control(&mut valve, 0x0B), HOLD, "{orders:?}");
        }
    }
}

/// Leaving operational for pre-operational has no effect on the device state machine.
#[test]
fn pre_operational_forgets_nothing() {
    let mut valve = in_fault_hold();
    valve.send_all(&["220: 03 00 00 00", "000: 80 20", "000: 01 20", "220: 0B 00 00 00"]);
    valve.take();
    assert_eq!(valve.status(), HOLD);
}

/// The fault log is written before a restart on command, with what falls while the reset waits.
#[test]
fn a_count_that_falls_while_a_reset_waits() {
    for slow_memory in [false, true] {
        let mut valve = Rig::booted();
        waits(&mut valve, slow_memory);
        valve.send("000: 81 20");
        valve.internal_fault_comes_and_goes();
        valve.advance(10);
        valve.hold_bus(false);
        valve.advance(1000);
        let sent = valve.take();
        assert!(sent.ends_with(&BOOT.map(str::to_owned)), "{sent:?}");
        assert_eq!(valve.read(0x2024, 0), 1);
    }
}

/// What ends a start while fault 8 is active, if the reset has left it.
fn told_after(order: &str) -> Vec<String> {
    let told: &[&str] = if order == "82" { &["0A0: 03 80 91 01 00 00 00 00"] } else { &[] };
    BOOT.iter().chain(told).map(|frame| (*frame).to_owned()).collect()
}

/// A valve that waits for its reset hears no set-points any more: time guarding shuts it down.
#[test]
fn a_valve_that_waits_for_its_reset_is_guarded() {
    for order in ["81", "82"] {
        for slow_memory in [false, true] {
            let mut valve = Rig::active();
            valve.send("220: 0F 00 00 40");
            if slow_memory {
                valve.write_time = Duration::from_secs(5);
                valve.send(SAVE);
            } else {
                valve.hold_bus(true);
                valve.send("620: 40 00 10 00 00 00 00 00");
            }
            valve.send(&format!("000: {order} 20"));
            valve.advance(249);
            assert!(valve.outputs().solenoids, "{order}");
            valve.advance(1);
            assert!(!valve.outputs().solenoids, "{order}");
            valve.hold_bus(false);
            valve.advance(20_000);
            let sent = valve.take();
            assert!(sent.ends_with(&told_after(order)), "{order}: {sent:?}");
            assert_eq!(valve.read(0x2023, 0), 1, "{order}");
        }
    }
}
