//! SYNC consumer and the synchronous TPDO (SPEC 4.1, 4.2).

use protocol_core::time::Duration;
use tests::Rig;

const SENT: &[&str] = &["1A0: 08 00 00 00"];

/// Operational, with this transmission type.
fn synchronous(kind: u32) -> Rig {
    let mut rig = Rig::booted();
    assert_eq!(rig.write(0x1800, 2, 1, kind), Ok(()));
    rig.exchange("000: 01 00", &[]);
    rig
}

/// The TPDO comes with the `n`-th SYNC and with none before it.
#[track_caller]
fn expect_at(rig: &mut Rig, n: u32) {
    for sync in 1..=n {
        rig.exchange("080:", if sync == n { SENT } else { &[] });
    }
}

#[test]
fn every_type_from_1_to_240() {
    for kind in 1..=240 {
        let mut rig = synchronous(kind);
        for _ in 0..3 {
            expect_at(&mut rig, kind);
        }
    }
}

#[test]
fn syncs_are_counted_from_entering_operational() {
    let mut rig = Rig::booted();
    assert_eq!(rig.write(0x1800, 2, 1, 3), Ok(()));
    rig.silent_to(&["080:", "080:", "000: 01 00"]);
    expect_at(&mut rig, 3);
    // Started again while it is operational: it does not enter.
    rig.silent_to(&["080:", "000: 01 00"]);
    expect_at(&mut rig, 2);
    // Left and entered again.
    for leave in ["000: 80 00", "000: 02 00"] {
        rig.silent_to(&["080:", "080:", leave, "080:", "000: 01 00"]);
        for sent in [false, false, true] {
            rig.send("080:");
            assert_eq!(!rig.take().is_empty(), sent);
        }
    }
}

#[test]
fn a_new_type_is_in_force_at_once_and_counts_from_there() {
    let mut rig = synchronous(4);
    for _ in 0..3 {
        rig.exchange("080:", &[]);
    }
    assert_eq!(rig.write(0x1800, 2, 1, 2), Ok(()));
    expect_at(&mut rig, 2);
    // The type that it has, too.
    rig.exchange("080:", &[]);
    assert_eq!(rig.write(0x1800, 2, 1, 2), Ok(()));
    expect_at(&mut rig, 2);
    // A type that is refused changes nothing.
    rig.exchange("080:", &[]);
    assert_eq!(rig.write(0x1800, 2, 1, 241), Err(0x0609_0030));
    expect_at(&mut rig, 1);
}

#[test]
fn an_rpdo_acts_at_once_and_brings_no_synchronous_tpdo() {
    let mut rig = synchronous(1);
    for word in ["01", "03", "07"] {
        rig.exchange(&format!("220: {word} 00 00 00"), &[]);
    }
    rig.exchange("220: 07 00 00 40", &[]);
    // Sampled at the SYNC.
    rig.advance(125);
    rig.exchange("080:", &["1A0: 0F 00 00 20"]);
    rig.exchange("220: 07 00 00 40", &[]);
    rig.advance(125);
    rig.exchange("080:", &["1A0: 0F 00 00 40"]);
}

#[test]
fn an_event_driven_tpdo_heeds_no_sync() {
    let mut rig = synchronous(0xFF);
    for _ in 0..300 {
        rig.exchange("080:", &[]);
    }
    rig.exchange("220: 00 00 00 00", SENT);
}

#[test]
fn a_tpdo_that_is_off_heeds_no_sync() {
    let mut rig = synchronous(2);
    rig.exchange("080:", &[]);
    assert_eq!(rig.write(0x1800, 1, 4, 0x8000_01A0), Ok(()));
    rig.silent_to(&["080:", "080:"]);
    assert_eq!(rig.write(0x1800, 1, 4, 0x0000_01A0), Ok(()));
    expect_at(&mut rig, 2);
}

#[test]
fn what_is_a_sync() {
    let mut rig = synchronous(1);
    // A counter in it is of no matter.
    rig.exchange("080:", SENT);
    rig.exchange("080: 01", SENT);
    for other in ["080: R0", "080: R1", "00000080:", "02000000:", "081:", "07F:"] {
        rig.exchange(other, &[]);
    }
}

#[test]
fn an_emcy_goes_before_the_tpdo_of_the_same_instant() {
    let mut rig = Rig::booted();
    assert_eq!(rig.write(0x1800, 2, 1, 1), Ok(()));
    rig.exchange("000: 01 00", &[]);
    for _ in 0..3 {
        rig.exchange("220: 0F 00 00 00", &[]);
    }
    rig.leap_to(Duration::from_millis(250), "080:");
    assert_eq!(rig.take(), ["0A0: 03 80 91 01 00 00 00 00", "1A0: 03 00 00 00"]);
}

/// Bit 30 can be toggled while the PDO is on, and switches nothing on.
#[test]
fn toggling_bit_30_counts_on() {
    let mut rig = synchronous(4);
    for cob_id in [0x4000_01A0, 0x0000_01A0] {
        rig.exchange("080:", &[]);
        assert_eq!(rig.write(0x1800, 1, 4, cob_id), Ok(()));
        assert_eq!(rig.read(0x1800, 1), cob_id);
        rig.silent_to(&["080:", "080:"]);
        rig.exchange("080:", SENT);
    }
}
