//! TPDO 1 by SYNC, and what it carries (SPEC 9).

use protocol_core::controller::BusErrorMode;
use protocol_core::device::ProductInputs;
use protocol_core::encoder::Shaft;
use tests::Rig;

use super::{SAVE, booted};

fn turn_to(rig: &mut Rig, angle: u32) {
    rig.sense_hat(|inputs| inputs.product = ProductInputs::Encoder(Shaft::at(angle)));
}

/// Operational, with TPDO 1 of this type switched on.
fn operational(kind: u32) -> Rig {
    let mut rig = booted();
    rig.write_all(&[(0x1800, 2, 1, kind), (0x1800, 1, 4, 0x181)]);
    rig.exchange("000: 01 00", &[]);
    rig
}

#[test]
fn it_is_off_when_it_leaves_the_factory() {
    let mut rig = booted();
    assert_eq!(rig.write(0x1800, 2, 1, 1), Ok(()));
    rig.silent_to(&["000: 01 00", "080:"]);
}

#[test]
fn one_that_is_not_saved_is_off_after_either_reset() {
    for reset in ["000: 81 00", "000: 82 00"] {
        let mut rig = booted();
        for (sub, size, value) in [(2, 1, 1), (5, 2, 10)] {
            assert_eq!(rig.write(0x1800, sub, size, value), Ok(()));
        }
        rig.write_all(&[(0x1010, 2, 4, SAVE), (0x1800, 1, 4, 0x181)]);
        rig.exchange("000: 01 00", &[]);
        rig.exchange("080:", &["181: 00 00 00 00"]);
        rig.exchange(reset, &["701: 00"]);
        rig.silent_to(&["000: 01 00", "080:"]);
        assert_eq!(rig.write(0x1800, 2, 1, 254), Ok(()));
        rig.silent_for(100);
    }
}

#[test]
fn every_nth_sync() {
    for kind in [1, 2, 3, 240] {
        let mut rig = operational(kind);
        for _ in 0..3 {
            for sync in 1..=kind {
                rig.exchange("080:", if sync == kind { &["181: 00 00 00 00"] } else { &[] });
            }
        }
    }
}

#[test]
fn type_0_sends_at_the_first_sync_and_then_what_has_changed() {
    let mut rig = operational(0);
    rig.exchange("080:", &["181: 00 00 00 00"]);
    rig.exchange("080:", &[]);
    turn_to(&mut rig, 2);
    rig.exchange("080:", &[]);
    turn_to(&mut rig, 9_000);
    rig.expect_nothing();
    rig.exchange("080:", &["181: 00 10 00 00"]);
    rig.exchange("080:", &[]);
    // There and back between two SYNCs.
    turn_to(&mut rig, 18_000);
    turn_to(&mut rig, 9_000);
    rig.exchange("080:", &[]);
    // Operational is entered anew.
    rig.silent_to(&["000: 80 00", "080:", "000: 01 00"]);
    rig.exchange("080:", &["181: 00 10 00 00"]);
    // The type is written.
    assert_eq!(rig.write(0x1800, 2, 1, 0), Ok(()));
    rig.exchange("080:", &["181: 00 10 00 00"]);
}

#[test]
fn type_0_counts_what_was_sent_not_what_was_lost() {
    let mut rig = operational(0);
    rig.exchange("080:", &["181: 00 00 00 00"]);
    turn_to(&mut rig, 9_000);
    rig.hold_bus(true);
    rig.exchange("080:", &[]);
    turn_to(&mut rig, 18_000);
    rig.exchange("080:", &[]);
    rig.hold_bus(false);
    assert_eq!(rig.take(), ["181: 00 20 00 00"], "the newer one");
    rig.exchange("080:", &[]);
}

#[test]
fn type_0_counts_what_bus_off_has_lost_as_not_sent() {
    let mut rig = operational(0);
    assert_eq!(rig.write(0x1029, 1, 1, 1), Ok(()));
    rig.hold_bus(true);
    rig.exchange("080:", &[]);
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::BusOff);
    rig.hold_bus(false);
    rig.sense_hat(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    assert!(rig.take_under("181").is_empty(), "lost with the mailbox");
    rig.exchange("080:", &["181: 00 00 00 00"]);
    rig.exchange("080:", &[]);
}

#[test]
fn a_synchronous_pdo_tells_the_position_at_the_sync() {
    let mut rig = operational(1);
    turn_to(&mut rig, 9_000);
    rig.hold_bus(true);
    rig.exchange("080:", &[]);
    rig.advance(10);
    rig.free_bus_sends(&["181: 00 10 00 00"]);
}

#[test]
fn all_four_objects() {
    let mut rig = operational(1);
    rig.write_all(&[(0x1800, 1, 4, 0x8000_0181), (0x1A00, 0, 1, 0)]);
    for (sub, entry) in [(1, 0x6503_0010), (2, 0x1001_0008), (3, 0x6004_0020)] {
        assert_eq!(rig.write(0x1A00, sub, 4, entry), Ok(()));
    }
    rig.write_all(&[(0x1A00, 0, 1, 3), (0x1800, 1, 4, 0x181), (0x1029, 2, 1, 1)]);
    rig.sense_hat(|inputs| {
        inputs.internal_fault = true;
        inputs.product = ProductInputs::Encoder(Shaft { measuring_error: true, ..Shaft::at(9_000) });
    });
    rig.take();
    rig.exchange("080:", &["181: 01 00 81 00 10 00 00"]);
    // 1002 is always 0.
    assert_eq!(rig.write(0x1800, 1, 4, 0x8000_0181), Ok(()));
    assert_eq!(rig.write(0x1A00, 0, 1, 0), Ok(()));
    assert_eq!(rig.write(0x1A00, 1, 4, 0x1002_0020), Ok(()));
    assert_eq!(rig.write(0x1A00, 0, 1, 1), Ok(()));
    assert_eq!(rig.write(0x1800, 1, 4, 0x181), Ok(()));
    rig.exchange("080:", &["181: 00 00 00 00"]);
}

#[test]
fn a_pdo_of_nothing_can_be_on_and_is_not_sent() {
    let mut rig = booted();
    rig.write_all(&[(0x1A00, 0, 1, 0), (0x1800, 1, 4, 0x181), (0x1800, 2, 1, 1), (0x1800, 5, 2, 1)]);
    rig.exchange("000: 01 00", &[]);
    for kind in [0, 1, 254, 255] {
        assert_eq!(rig.write(0x1800, 2, 1, kind), Ok(()));
        rig.exchange("080:", &[]);
        rig.silent_for(10);
    }
}

#[test]
fn a_29_bit_sync() {
    let mut rig = operational(1);
    assert_eq!(rig.write(0x1005, 0, 4, 0x3234_5678), Ok(()));
    rig.exchange("12345678:", &["181: 00 00 00 00"]);
    rig.silent_to(&["080:", "678:"]);
}

#[test]
fn type_0_on_a_held_bus_tells_the_position_at_the_last_sync() {
    let mut rig = operational(0);
    turn_to(&mut rig, 9_000);
    rig.exchange("080:", &["181: 00 10 00 00"]);
    rig.hold_bus(true);
    // Two EMCYs wait, so the TPDO does not come to a mailbox.
    for mode in [BusErrorMode::ErrorPassive, BusErrorMode::ErrorActive] {
        rig.sense_hat(|inputs| inputs.bus = mode);
    }
    turn_to(&mut rig, 18_000);
    rig.send("080:");
    turn_to(&mut rig, 9_000);
    rig.send("080:");
    rig.hold_bus(false);
    assert!(
        !rig.take_under("181").contains(&"181: 00 20 00 00".to_owned()),
        "the shaft was elsewhere at the last SYNC"
    );
}

/// Bit 30 can be toggled while the PDO is on, and switches nothing on.
#[test]
fn toggling_bit_30_counts_on() {
    let mut rig = operational(3);
    rig.exchange("080:", &[]);
    assert_eq!(rig.write(0x1800, 1, 4, 0x4000_0181), Ok(()));
    rig.exchange("080:", &[]);
    assert_eq!(rig.write(0x1800, 1, 4, 0x181), Ok(()));
    rig.exchange("080:", &["181: 00 00 00 00"]);
    // What was sent last is known still.
    let mut rig = operational(0);
    rig.exchange("080:", &["181: 00 00 00 00"]);
    assert_eq!(rig.write(0x1800, 1, 4, 0x4000_0181), Ok(()));
    rig.exchange("080:", &[]);
}
