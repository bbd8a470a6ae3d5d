//! The error history, object 0x1003 (SPEC 4.1, 4.2).

use protocol_core::controller::BusErrorMode::{BusOff, ErrorActive};
use tests::Rig;

use super::{BOOT, SAVE, SAVED};

const NO_DATA: u32 = 0x0800_0024;

/// An internal error comes and goes.
fn internal(rig: &mut Rig) {
    rig.internal_fault_comes_and_goes();
    rig.take();
}

fn bus_off(rig: &mut Rig) {
    rig.sense(|inputs| inputs.bus = BusOff);
    rig.sense(|inputs| inputs.bus = ErrorActive);
    rig.take();
}

/// The history is exactly this, newest first.
#[track_caller]
fn assert_history(rig: &mut Rig, expected: &[u32]) {
    assert_eq!(rig.read(0x1003, 0) as usize, expected.len());
    for (sub, error) in (1..).zip(expected) {
        assert_eq!(rig.read(0x1003, sub), *error, "{sub}");
    }
    for sub in expected.len() as u8 + 1..=8 {
        assert_eq!(rig.read_abort(0x1003, sub), NO_DATA, "{sub}");
    }
}

#[test]
fn newest_first_with_code_and_counter() {
    let mut rig = Rig::booted();
    assert_history(&mut rig, &[]);
    internal(&mut rig);
    assert_history(&mut rig, &[0x0001_1000]);
    rig.exchange("620: 40 03 10 01 00 00 00 00", &["5A0: 43 03 10 01 00 10 01 00"]);
    rig.exchange("620: 40 03 10 02 00 00 00 00", &["5A0: 80 03 10 02 24 00 00 08"]);
    bus_off(&mut rig);
    assert_history(&mut rig, &[0x0001_8140, 0x0001_1000]);
    internal(&mut rig);
    assert_history(&mut rig, &[0x0002_1000, 0x0001_8140, 0x0001_1000]);
}

#[test]
fn the_ninth_pushes_the_oldest_out() {
    let mut rig = Rig::booted();
    let mut expected = Vec::new();
    for count in 1..=20 {
        internal(&mut rig);
        expected.insert(0, count << 16 | 0x1000);
        expected.truncate(8);
        assert_history(&mut rig, &expected);
    }
}

#[test]
fn writing_0_clears_it_and_nothing_else_can_be_written() {
    let mut rig = Rig::booted();
    for _ in 0..10 {
        internal(&mut rig);
    }
    for value in [1, 8, 0x80, 0xFF] {
        assert_eq!(rig.write(0x1003, 0, 1, value), Err(0x0609_0030));
    }
    assert_eq!(rig.read(0x1003, 0), 8);
    rig.exchange("620: 2F 03 10 00 00 00 00 00", &["5A0: 60 03 10 00 00 00 00 00"]);
    assert_history(&mut rig, &[]);
    // The counter goes on.
    internal(&mut rig);
    assert_history(&mut rig, &[0x000B_1000]);
}

#[test]
fn it_survives_reset_communication_alone() {
    let mut rig = Rig::booted();
    internal(&mut rig);
    bus_off(&mut rig);
    rig.exchange(SAVE, &[SAVED]);
    rig.exchange("000: 82 00", &BOOT);
    assert_history(&mut rig, &[0x0001_8140, 0x0001_1000]);
    rig.exchange("000: 81 00", &BOOT);
    assert_history(&mut rig, &[]);
    internal(&mut rig);
    rig.start_anew();
    assert_history(&mut rig, &[]);
}
