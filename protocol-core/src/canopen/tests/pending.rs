//! Pending frames while the bus is blocked, and frames returned by the controller.

use super::Rig;
use crate::controller::Filter;
use crate::frame::Frame;
use crate::wire::emcy::Emcy;

fn operational() -> Rig {
    let mut rig = Rig::booted();
    rig.exchange("605: 2B 17 10 00 0A 00 00 00");
    rig.exchange("000: 01 00");
    assert_eq!(rig.advance(0), ["705: 05"]);
    rig
}

fn next(rig: &mut Rig) -> Option<Frame> {
    rig.node.next_frame(&rig.lamp, rig.now)
}

#[test]
fn the_most_urgent_first_and_the_latest_of_news() {
    let mut rig = operational();
    rig.held = true;
    rig.advance(50);
    for text in ["605: 40 00 10 00 00 00 00 00", "205: 01", "205: 02", "605: 40 01 10 00 00 00 00 00"] {
        rig.exchange(text);
    }
    rig.node.send_emcy(Emcy { code: 0x4200, ..Emcy::default() });
    rig.held = false;
    let expected = [
        "085: 00 42 00 00 00 00 00 00",
        "185: 02 00",
        "585: 43 00 10 00 91 01 00 00",
        "585: 4F 01 10 00 00 00 00 00",
        "705: 05",
    ];
    assert_eq!(rig.sent(), expected);
}

/// An EMCY precedes a TPDO queued at the same time, even if the TPDO has a more urgent identifier.
#[test]
fn an_emcy_before_a_more_urgent_tpdo() {
    let mut rig = operational();
    rig.exchange("605: 23 00 18 01 00 00 00 80");
    rig.exchange("605: 23 00 18 01 81 00 00 00");
    rig.held = true;
    rig.exchange("205: 01");
    rig.node.send_emcy(Emcy::default());
    rig.held = false;
    assert_eq!(rig.sent(), ["085: 00 00 00 00 00 00 00 00", "081: 01 00"]);
}

#[test]
fn a_frame_that_is_out_of_date_is_aborted() {
    let mut rig = operational();
    rig.exchange("205: 01");
    rig.exchange("605: 2B 17 10 00 0A 00 00 00");
    rig.advance(0);
    rig.held = true;
    rig.exchange("205: 02");
    assert_eq!(next(&mut rig).map(|frame| frame.key()), Some(0x185));
    assert_eq!(rig.node.take_abort(), None);
    rig.exchange("205: 03");
    assert_eq!(rig.node.take_abort(), Some(Filter::exactly(0x185)));
    assert_eq!(next(&mut rig).unwrap().data(), [3, 0]);
    rig.advance(10);
    assert_eq!(next(&mut rig).unwrap().data(), [5]);
    rig.exchange("000: 80 00");
    let aborts = [rig.node.take_abort(), rig.node.take_abort(), rig.node.take_abort()];
    assert!(aborts.contains(&Some(Filter::exactly(0x185))) && aborts.contains(&Some(Filter::exactly(0x705))));
    assert_eq!(next(&mut rig).unwrap().data(), [0x7F], "no TPDO in pre-operational");
    assert_eq!(next(&mut rig), None);
}

/// A controller can hold both, and aborts by identifier.
#[test]
fn an_emcy_is_not_aborted_with_a_tpdo_under_its_identifier() {
    let mut rig = operational();
    rig.exchange("605: 23 00 18 01 00 00 00 80");
    rig.exchange("605: 23 00 18 01 85 00 00 00");
    rig.held = true;
    rig.exchange("205: 01");
    assert_eq!(next(&mut rig).unwrap().data(), [1, 0]);
    rig.node.send_emcy(Emcy { code: 0x4200, ..Emcy::default() });
    assert_eq!(next(&mut rig).unwrap().data()[..2], [0x00, 0x42]);
    rig.exchange("205: 02");
    assert_eq!(rig.node.take_abort(), None);
}

/// The EMCY and the TPDO have equal arbitration values, so a controller may send either first: the node hands out the
/// TPDO only once the EMCY is sent.
#[test]
fn an_emcy_before_a_tpdo_under_its_identifier() {
    let mut rig = operational();
    rig.exchange("605: 23 00 18 01 00 00 00 80");
    rig.exchange("605: 23 00 18 01 85 00 00 00");
    rig.held = true;
    rig.node.send_emcy(Emcy { code: 0x4200, ..Emcy::default() });
    rig.exchange("205: 01");
    assert_eq!(next(&mut rig).unwrap().data()[..2], [0x00, 0x42]);
    assert_eq!(next(&mut rig), None);
    rig.node.all_sent();
    assert_eq!(next(&mut rig).unwrap().data(), [1, 0]);
}

#[test]
fn what_is_given_back_is_owed_again() {
    let mut rig = operational();
    rig.held = true;
    rig.advance(10);
    rig.exchange("605: 40 00 10 00 00 00 00 00");
    rig.exchange("205: 02");
    rig.node.send_emcy(Emcy { code: 0x4200, ..Emcy::default() });
    let frames: std::vec::Vec<Frame> = core::iter::from_fn(|| next(&mut rig)).collect();
    assert_eq!(frames.len(), 4);
    for frame in frames.iter().rev() {
        rig.node.give_back(*frame);
    }
    rig.lamp.brightness = 9;
    rig.held = false;
    let expected = ["085: 00 42 00 00 00 00 00 00", "185: 09 00", "585: 43 00 10 00 91 01 00 00", "705: 05"];
    assert_eq!(rig.sent(), expected, "the TPDO tells what is true when it goes out");
}

#[test]
fn bus_off_keeps_emcys_and_the_boot_up_and_counts_answers() {
    let mut rig = Rig::started(Some(5), None);
    rig.held = true;
    assert_eq!(next(&mut rig).map(|frame| frame.key()), Some(0x705));
    rig.exchange("605: 40 00 10 00 00 00 00 00");
    rig.node.send_emcy(Emcy::default());
    assert!(!rig.node.has_frame(), "the boot-up is not on the bus yet");
    rig.node.set_bus_off(true);
    rig.exchange("605: 40 00 10 00 00 00 00 00");
    assert!(!rig.node.has_frame());
    assert_eq!(rig.node.frames_dropped(), 2);
    rig.node.set_bus_off(false);
    rig.held = false;
    assert_eq!(rig.sent(), ["705: 00", "085: 00 00 00 00 00 00 00 00"]);
}

/// Bus-off and LSS silence drop the controller's frames: a frame returned later is neither sent nor counted twice.
#[test]
fn what_is_given_back_too_late_is_not_sent() {
    for by_bus_off in [true, false] {
        let mut rig = operational();
        rig.exchange("000: 80 00");
        rig.held = true;
        rig.exchange("605: 40 00 10 00 00 00 00 00");
        let answer = next(&mut rig).unwrap();
        if by_bus_off {
            rig.node.set_bus_off(true);
        } else {
            rig.exchange("7E5: 04 01 00 00 00 00 00 00");
            rig.exchange("7E5: 15 00 00 00 00 00 00 00");
        }
        rig.node.give_back(answer);
        rig.node.set_bus_off(false);
        rig.node.poll(&rig.lamp, rig.now);
        rig.held = false;
        assert!(rig.sent().is_empty(), "bus-off: {by_bus_off}");
        assert_eq!(rig.node.frames_dropped(), 1, "bus-off: {by_bus_off}");
    }
}

extern crate std;
