//! The bus of the rig: what a held one leaves in the mailboxes, and what comes out of them.

use protocol_core::controller::BusErrorMode;
use tests::Rig;

/// A valve whose heartbeat waits in a mailbox.
fn held() -> Rig {
    let mut valve = Rig::booted();
    assert_eq!(valve.write(0x1017, 0, 2, 100), Ok(()));
    valve.take();
    valve.hold_bus(true);
    valve.advance(100);
    assert_eq!(valve.pending(), 1);
    valve
}

/// Beside a pending frame the controller takes only a strictly more urgent one, three in all; the bus takes them in the
/// order of arbitration, with what waited in the device.
#[test]
fn more_urgent_frames_overtake() {
    let mut valve = held();
    valve.send("620: 40 00 10 00 00 00 00 00");
    valve.send("620: 40 18 10 01 00 00 00 00");
    assert_eq!(valve.pending(), 2, "of the two answers one waits in the device");
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(valve.pending(), 3);
    valve.advance(10);
    valve.expect_nothing();
    valve.hold_bus(false);
    assert_eq!(valve.pending(), 0);
    let answers = ["5A0: 43 00 10 00 98 01 00 00", "5A0: 43 18 10 01 19 00 00 01"];
    assert_eq!(valve.take(), ["0A0: 00 10 01 01 00 00 00 00", answers[0], answers[1], "720: 7F"]);
}

/// A fourth one takes the place of the least urgent, which goes back to the device.
#[test]
fn a_displaced_frame_is_not_lost() {
    let mut valve = held();
    valve.send("000: 01 20");
    valve.advance(100);
    valve.send("620: 40 00 10 00 00 00 00 00");
    valve.send("220: 01 00 00 00");
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(valve.pending(), 3);
    valve.hold_bus(false);
    let sent = valve.take();
    let ids: Vec<_> = sent.iter().map(|frame| &frame[..3]).collect();
    assert!(ids.starts_with(&["0A0", "1A0", "5A0", "720"]), "{sent:?}");
}

#[test]
fn bus_off_empties_the_mailboxes() {
    let mut valve = held();
    valve.send("620: 40 00 10 00 00 00 00 00");
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    assert_eq!(valve.pending(), 0);
    valve.hold_bus(false);
    valve.expect_nothing();
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    assert!(!valve.take().iter().any(|frame| frame.starts_with("5A0")));
}
