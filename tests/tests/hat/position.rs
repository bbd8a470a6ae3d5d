//! The position against the angle: wrap, preset, offset, alarms (SPEC 9).

use protocol_core::device::ProductInputs;
use protocol_core::encoder::Shaft;
use tests::Rig;

use super::{SAVE, booted};

fn turn_to(rig: &mut Rig, shaft: Shaft) {
    rig.sense_hat(|inputs| inputs.product = ProductInputs::Encoder(shaft));
}

fn position(rig: &mut Rig) -> u32 {
    rig.read(0x6004, 0)
}

#[test]
fn the_position_is_the_angle_rounded_down() {
    let mut rig = booted();
    for (angle, expected) in [
        (0, 0),
        (2, 0),
        (3, 1),
        (4, 1),
        (5, 2),
        (8_999, 4_095),
        (9_000, 4_096),
        (18_000, 8_192),
        (35_997, 16_382),
        (35_999, 16_383),
        (36_000, 0),
    ] {
        turn_to(&mut rig, Shaft::at(angle));
        assert_eq!(position(&mut rig), expected, "{angle}");
    }
}

#[test]
fn a_turning_shaft_is_sampled_when_it_is_read() {
    let mut rig = booted();
    let since = rig.now();
    // One turn a second, and back.
    for (speed_rpm, expected) in [(60, [0, 4_096, 8_192, 12_288, 0]), (-60, [0, 12_288, 8_192, 4_096, 0])] {
        let since = if speed_rpm > 0 { since } else { rig.now() };
        turn_to(&mut rig, Shaft { speed_rpm, since, ..Shaft::at(0) });
        for quarter in expected {
            assert_eq!(position(&mut rig), quarter);
            rig.advance(250);
        }
    }
}

#[test]
fn a_preset_makes_the_present_position_read_it() {
    let mut rig = booted();
    for (angle, preset, offset) in [
        (9_000, 0, -4_096),
        (9_000, 4_096, 0),
        (9_000, 12_287, 8_191),
        (9_000, 12_288, -8_192),
        (0, 16_383, -1),
        (35_999, 0, 1),
        (35_999, 16_383, 0),
    ] {
        turn_to(&mut rig, Shaft::at(angle));
        assert_eq!(rig.write(0x6003, 0, 4, preset), Ok(()));
        assert_eq!(position(&mut rig), preset);
        assert_eq!(rig.read(0x6509, 0) as i32, offset, "{angle} {preset}");
        assert_eq!(rig.read(0x6003, 0), preset);
        // It turns on from there, over the end.
        turn_to(&mut rig, Shaft::at((angle + 9_000) % 36_000));
        let raw = (angle + 9_000) % 36_000 * 16_384 / 36_000;
        assert_eq!(position(&mut rig), raw.wrapping_add_signed(offset) % 16_384);
    }
}

#[test]
fn a_preset_that_is_refused_changes_nothing() {
    let mut rig = booted();
    turn_to(&mut rig, Shaft::at(9_000));
    assert_eq!(rig.write(0x6003, 0, 4, 100), Ok(()));
    assert_eq!(rig.write(0x6003, 0, 4, 16_384), Err(0x0609_0031));
    assert_eq!((position(&mut rig), rig.read(0x6003, 0), rig.read(0x6509, 0) as i32), (100, 100, 100 - 4_096));
}

#[test]
fn an_unsaved_preset_is_lost_at_either_reset() {
    for reset in ["000: 81 01", "000: 82 01"] {
        let mut rig = booted();
        turn_to(&mut rig, Shaft::at(9_000));
        assert_eq!(rig.write(0x6003, 0, 4, 5), Ok(()));
        rig.exchange(reset, &["701: 00"]);
        assert_eq!((position(&mut rig), rig.read(0x6003, 0), rig.read(0x6509, 0)), (4_096, 0, 0), "{reset}");
        rig.write_all(&[(0x6003, 0, 4, 5), (0x1010, 3, 4, SAVE)]);
        rig.exchange(reset, &["701: 00"]);
        assert_eq!((position(&mut rig), rig.read(0x6003, 0)), (5, 5), "{reset}");
        assert_eq!(rig.read(0x6509, 0) as i32, 5 - 4_096);
        rig.start_anew();
        assert_eq!(position(&mut rig), 5);
    }
}

#[test]
fn a_measuring_error_is_an_alarm_and_nothing_else() {
    let mut rig = booted();
    rig.exchange("000: 01 00", &[]);
    turn_to(&mut rig, Shaft { measuring_error: true, ..Shaft::at(9_000) });
    rig.expect_nothing();
    assert_eq!((rig.read(0x6503, 0), rig.read(0x1001, 0), position(&mut rig)), (1, 0, 4_096));
    assert_eq!(rig.read(0x1003, 0), 0);
    turn_to(&mut rig, Shaft::at(18_000));
    assert_eq!((rig.read(0x6503, 0), position(&mut rig)), (0, 8_192));
}
