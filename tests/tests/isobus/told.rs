//! No shutdown without a word: whatever keeps the valve down is told (SPEC 2, 5).

use protocol_core::actuator::Position;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::pve::{Kind, PveIsobus, Setup};
use protocol_core::device::{Device as _, StartCause};
use protocol_core::memory::Image;
use protocol_core::time::{Duration, Instant, after};
use tests::Rig;
use tests::isobus::{AVEF_BLOCKED, BLOCK, CLAIM, DM1_CLEAR, INTERNAL};

const SPOOL: &str = "18FECA83: 10 FF EC 8F 87 01 FF FF";

/// So many percent of full stroke.
fn percent(percent: i16) -> Option<Position> {
    Position::new(i16::try_from(i32::from(percent) * 16384 / 100).unwrap())
}

/// In a shutdown the spool has to be in neutral, within 5 %: held farther out, it keeps the valve down, and monitor 1
/// says so.
#[test]
fn a_spool_held_out_of_neutral_in_a_shutdown() {
    for held in [6, 8, 10, 14, 15, -6, -10, -15] {
        let mut valve = Rig::claimed();
        valve.send(BLOCK);
        valve.sense(|inputs| inputs.internal_fault = true);
        valve.advance_cyclic(100, BLOCK);
        valve.sense_news(|inputs| inputs.internal_fault = false, &[INTERNAL, DM1_CLEAR]);
        valve.sense(|inputs| inputs.spool.lever = percent(held));
        valve.advance_cyclic(700, BLOCK);
        assert_eq!(valve.take_news(), [SPOOL], "{held} %");
        valve.sense(|inputs| inputs.spool.lever = None);
        valve.advance_cyclic(400, BLOCK);
        assert_eq!(valve.take_news(), [DM1_CLEAR], "{held} %");
        // Recovered.
        valve.send("0CFE3327: FA FF 31 FF FF FF FF FF");
        assert_eq!(valve.flow()[2], 0x31, "{held} %");
    }
}

/// It was held there when the shutdown began.
#[test]
fn a_spool_that_is_out_of_neutral_as_a_shutdown_begins() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.spool.lever = percent(10));
    valve.advance_cyclic_news(2000, BLOCK, &[]);
    valve.internal_fault_comes_and_goes();
    valve.advance_cyclic_news(1000, BLOCK, &[INTERNAL, DM1_CLEAR, SPOOL]);
}

/// Within 5 % it is in neutral, and nothing keeps the valve down.
#[test]
fn a_spool_in_neutral_in_a_shutdown() {
    for held in [0, 4, -4] {
        let mut valve = Rig::claimed();
        valve.sense(|inputs| inputs.spool.lever = percent(held));
        valve.internal_fault_comes_and_goes();
        valve.advance_cyclic_news(1000, BLOCK, &[INTERNAL, DM1_CLEAR]);
        valve.send("0CFE3327: FA FF 31 FF FF FF FF FF");
        assert_eq!(valve.flow()[2], 0x31, "{held} %");
    }
}

/// Hand operation and emergency stop look for no fault of the spool, in a shutdown either.
#[test]
fn not_in_hand_operation() {
    for state in ["3A", "3E"] {
        let mut valve = Rig::claimed();
        let command = format!("0CFE3327: 00 FF {state} FF FF FF FF FF");
        valve.send(&command);
        valve.internal_fault_comes_and_goes();
        valve.sense(|inputs| inputs.spool.lever = percent(10));
        valve.advance_cyclic_news(2000, &command, &[INTERNAL, DM1_CLEAR]);
    }
}

/// A watchdog reset is told as soon as the bus and the claim let it be, and is gone then.
#[test]
fn a_watchdog_reset_without_a_bus() {
    for bus_off in [false, true] {
        for at in [0, 100, 249, 250, 300, 1000] {
            let mut valve = Rig::claimed();
            if bus_off {
                valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
            } else {
                valve.hold_bus(true);
            }
            valve.watchdog_reset();
            valve.advance(at);
            valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
            valve.hold_bus(false);
            valve.expect(CLAIM);
            valve.silent_for(249);
            valve.advance(2000);
            let sent = valve.take_news();
            assert!(sent.contains(&INTERNAL.to_owned()), "bus-off {bus_off}, {at} ms: {sent:?}");
            assert_eq!(sent.last().map(String::as_str), Some(DM1_CLEAR));
        }
    }
}

/// The bus is lost in the middle of the claim wait.
#[test]
fn a_watchdog_reset_with_a_bus_off_in_the_wait() {
    for at in [10, 200, 249] {
        let mut valve = Rig::claimed();
        valve.watchdog_reset();
        valve.advance(at);
        valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
        valve.advance(50);
        valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        valve.advance(2000);
        let sent = valve.take_news();
        assert!(sent.contains(&INTERNAL.to_owned()), "{at} ms: {sent:?}");
        assert_eq!(sent.last().map(String::as_str), Some(DM1_CLEAR));
    }
}

/// The pump learns of a frame that another one made pending when it was sent; no deadline follows for it.
#[test]
fn a_frame_that_a_sent_one_makes_pending() {
    let start = Instant::from_secs(1);
    let setup = Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) };
    let mut valve = PveIsobus::power_on(setup, &Image::empty(), StartCause::Watchdog, start);
    let mut sends = |now, frames: &[&str]| {
        valve.poll(now);
        for frame in frames {
            assert_eq!(valve.next_frame(now).map(|frame| frame.to_string()).as_deref(), Some(*frame));
        }
        assert_eq!(valve.next_frame(now), None);
        valve.all_sent(now)
    };
    assert!(!sends(start, &[CLAIM]));
    let claimed = after(start, Duration::from_millis(250));
    assert!(sends(claimed, &[AVEF_BLOCKED, INTERNAL]));
    assert!(!sends(claimed, &[DM1_CLEAR]));
}
