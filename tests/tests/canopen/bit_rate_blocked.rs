//! The bit rate is switched at its instant, whatever the bus takes, and the silence around it is kept (SPEC 4.4).

use protocol_core::controller::BitRate;
use protocol_core::time::Duration;
use tests::{Rig, lss};

use super::{BOOT, INTERNAL_ERROR};

/// Twice 100 ms.
const ACTIVATE: &str = "7E5: 15 64 00 00 00 00 00 00";

/// A valve on a held bus, with 500 kbit/s pending.
fn held() -> Rig {
    let mut valve = Rig::booted();
    valve.exchange(lss::TO_CONFIGURATION, &[]);
    valve.exchange("7E5: 13 00 02 00 00 00 00 00", &["7E4: 13 00 00 00 00 00 00 00"]);
    valve.hold_bus(true);
    valve
}

/// The rate changes after the first delay, and nothing has been sent by the end of the second.
#[track_caller]
fn switches_silently(valve: &mut Rig) {
    valve.advance(99);
    assert_eq!(valve.bit_rates(), []);
    valve.advance(1);
    assert_eq!(valve.bit_rates(), [BitRate::Kbit500]);
    valve.silent_for(99);
}

/// The bus is free again before the switch: what waits would be at the old rate, in the silence.
#[test]
fn answers_are_not_sent_in_the_silence() {
    for request in ["620: 40 00 10 00 00 00 00 00", lss::INQUIRE_NODE_ID, "1BC78820: 03 22 F0 10"] {
        let mut valve = held();
        valve.send_all(&[request, ACTIVATE]);
        valve.hold_bus(false);
        switches_silently(&mut valve);
        valve.silent_for(1000);
    }
}

/// A reset in the silence begins anew: a fault of before is told as every start tells it, once.
#[test]
fn emcys_do_not_outlive_a_reset_in_the_silence() {
    let mut valve = held();
    valve.send(ACTIVATE);
    valve.hold_bus(false);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.send("000: 82 20");
    switches_silently(&mut valve);
    valve.advance_sends(1, &[BOOT[0], BOOT[1], INTERNAL_ERROR]);
}

/// The bus is free again after the switch: what waits would be at the wrong rate.
#[test]
fn answers_are_not_sent_at_the_new_rate() {
    let mut valve = held();
    valve.send_all(&["620: 40 00 10 00 00 00 00 00", ACTIVATE]);
    switches_silently(&mut valve);
    valve.hold_bus(false);
    valve.silent_for(1000);
}

/// The master has moved and acknowledges no more: the heartbeat that it does not get must not keep the valve.
#[test]
fn a_heartbeat_that_nobody_acknowledges() {
    for release_after in [0, 50, 100, 150] {
        let mut valve = held();
        valve.hold_bus(false);
        assert_eq!(valve.write(0x1017, 0, 2, 100), Ok(()));
        valve.take();
        valve.hold_bus(true);
        valve.advance(100);
        assert_eq!(valve.pending(), 1);
        valve.send(ACTIVATE);
        for ms in 0..200 {
            if ms == release_after {
                valve.hold_bus(false);
            }
            assert_eq!(valve.bit_rates().len(), usize::from(ms >= 100), "{ms} ms");
            valve.expect_nothing();
            valve.advance(1);
        }
        valve.take();
        valve.advance_sends(100, &["720: 7F"]);
    }
}

/// An EMCY is promised: it is sent after the silence, at the new rate.
#[test]
fn an_emcy_waits_for_the_end_of_the_silence() {
    for free in [true, false] {
        let mut valve = held();
        valve.sense(|inputs| inputs.internal_fault = true);
        valve.send(ACTIVATE);
        if free {
            valve.hold_bus(false);
        }
        switches_silently(&mut valve);
        valve.hold_bus(false);
        valve.advance_sends(1, &[INTERNAL_ERROR]);
    }
}

/// So is a boot-up, and it is the first frame.
#[test]
fn a_boot_up_waits_for_the_end_of_the_silence() {
    for free in [true, false] {
        let mut valve = Rig::booted();
        valve.hold_bus(true);
        valve.power_cycle();
        assert_eq!(valve.pending(), 1);
        valve.send_all(&[lss::TO_CONFIGURATION, "7E5: 13 00 02 00 00 00 00 00", ACTIVATE]);
        if free {
            valve.hold_bus(false);
        }
        switches_silently(&mut valve);
        valve.hold_bus(false);
        valve.advance_sends(1, &BOOT);
    }
}

/// Reset communication neither breaks the silence nor takes the new rate away.
#[test]
fn reset_communication_in_the_silence() {
    for at in [0, 50, 99, 100, 150, 199] {
        let mut valve = held();
        valve.hold_bus(false);
        valve.send(ACTIVATE);
        valve.advance(at);
        valve.send("000: 82 20");
        valve.silent_for(199 - at);
        assert_eq!(valve.bit_rates(), [BitRate::Kbit500], "reset after {at} ms");
        valve.advance(1);
        assert_eq!(valve.take(), BOOT, "reset after {at} ms");
        assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
    }
}

/// A platform that comes late, or delays of 0, let switch and end of the silence fall together: what is owed goes out
/// at the new rate, not before it.
#[test]
fn nothing_is_sent_before_a_late_switch() {
    for (delay, late) in [("00", 0), ("64", 5000)] {
        let mut valve = held();
        valve.sense(|inputs| inputs.internal_fault = true);
        valve.send(&format!("7E5: 15 {delay} 00 00 00 00 00 00"));
        valve.leap(Duration::from_millis(late));
        assert_eq!(valve.bit_rates(), [BitRate::Kbit500]);
        valve.hold_bus(false);
        assert_eq!(valve.take(), [INTERNAL_ERROR], "delay {delay}");
    }
}
