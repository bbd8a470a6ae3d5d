//! What happens while a restart, a write or a message waits (SPEC 5, 6).

use protocol_core::actuator::SpoolFault;
use protocol_core::controller::BusErrorMode;
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, CLAIM, DM1_CLEAR, EXTEND, HIGHER_NAME, LOWER_NAME};

const ANNOUNCE: &str = "1CECFF27: 20 09 00 02 FF D8 FE 00";
const NAME: &str = "1CEBFF27: 01 01 00 20 07 08 FF 02";
const ADDRESS_85: &str = "1CEBFF27: 02 20 85 FF FF FF FF FF";

/// A fault came and went at one instant, and the bus did not take its DM1: the present state replaces it.
#[test]
fn a_code_that_passed_on_a_bus_that_is_held() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    // Monitor 1 is due between two AVEFs.
    valve.advance(10);
    valve.send(EXTEND);
    valve.advance_cyclic(400, EXTEND);
    valve.advance(50);
    valve.send(EXTEND);
    valve.advance(48);
    valve.take();
    valve.hold_bus(true);
    valve.advance(5);
    assert_eq!(valve.pending(), 1);
    valve.advance_cyclic(10_000, BLOCK);
    valve.hold_bus(false);
    assert_eq!(valve.take_news(), [DM1_CLEAR]);
    valve.advance_cyclic_news(3000, BLOCK, &[]);
}

/// The memory has done what was asked, but the answer cannot go out.
#[test]
fn an_answer_that_is_due_in_bus_off_is_counted() {
    for request in ["1BC78883: 04 2E 10 01 85", "18EA8327: CC FE 00"] {
        let mut valve = Rig::with_two_previously_active();
        valve.write_time = Duration::from_millis(100);
        valve.send(request);
        valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
        valve.advance(1000);
        valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        valve.advance(1000);
        assert_eq!(valve.device().frames_dropped(), 1, "{request}");
    }
}

/// DM3 waits behind the commanded address, and a fault that it asked to clear comes back meanwhile.
#[test]
fn a_count_that_falls_while_dm3_and_a_restart_wait() {
    let mut valve = Rig::with_two_previously_active();
    valve.advance_cyclic(20_000, BLOCK);
    valve.write_time = Duration::from_millis(400);
    valve.send_all(&[ANNOUNCE, NAME, ADDRESS_85, "18EA8327: CC FE 00"]);
    valve.advance(300);
    // Due at 550 ms: after the restart is wanted, before the memory has cleared the counters.
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(2000);
    assert_eq!(valve.node_id(), Some(0x85));
    // Once before DM3, which the next occurrence keeps from being cleared, once before the restart, once after it.
    let told = valve.take_under("18FECA85");
    assert_eq!(told.first().map(String::as_str), Some("18FECA85: 04 FF F1 8F 90 03 FF FF"));
}

/// Two controllers command an address at once: the last that was stored counts.
#[test]
fn two_commands_one_of_which_fails() {
    for (failing, address) in [(0, 0x86), (1, 0x85), (2, 0x86)] {
        let mut valve = Rig::claimed();
        valve.advance(20_000);
        valve.write_time = Duration::from_millis(100);
        valve.failing_writes.insert(failing);
        for source in [0x27, 0x28] {
            valve.send(&ANNOUNCE.replace("FF27", &format!("FF{source:02X}")));
            valve.send(&NAME.replace("FF27", &format!("FF{source:02X}")));
        }
        valve.send_all(&[ADDRESS_85, "1CEBFF28: 02 20 86 FF FF FF FF FF"]);
        valve.take();
        valve.advance(1000);
        assert_eq!(valve.node_id(), Some(address), "write {failing} fails: {:?}", valve.take());
    }
}

/// A valve whose restart waits for the memory still answers for its address, and leaves it when it loses.
#[test]
fn an_address_that_is_contended_while_a_restart_waits() {
    for (claim, defended) in [(HIGHER_NAME, true), (LOWER_NAME, false)] {
        let mut valve = Rig::claimed();
        // A count, to be stored before the restart.
        valve.internal_fault_comes_and_goes();
        valve.write_time = Duration::from_millis(400);
        for frame in [ANNOUNCE, NAME, ADDRESS_85] {
            valve.send(frame);
        }
        valve.advance(450);
        valve.take();
        valve.exchange(claim, if defended { &[CLAIM] } else { &[] });
        // Neither a command nor another contender's claim of another address is heard.
        valve.exchange(EXTEND, &[]);
        assert!(!valve.outputs().solenoids);
        valve.advance(300);
        assert_eq!(valve.node_id(), defended.then_some(0x83), "the restart waits still");
        let flows = valve.take_under("0CFE1383").len();
        assert_eq!(flows, if defended { 3 } else { 0 }, "{claim}");
        valve.advance(400);
        let sent = valve.take();
        assert!(sent.contains(&CLAIM.replace("18EEFF83", "18EEFF85")), "{sent:?}");
    }
}
