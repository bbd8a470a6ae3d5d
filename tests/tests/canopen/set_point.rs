//! The set-point and the actual value through all objects that show them (SPEC 2, 4.1).

use protocol_core::actuator::{Position, SetPoint};
use protocol_core::device::pve::{Kind, PveCanopen, Setup};
use protocol_core::device::{Device as _, StartCause, Viewable as _};
use protocol_core::memory::Image;
use protocol_core::time::Instant;
use protocol_core::wire::nmt::State;
use tests::{Rig, frame};

const TOO_HIGH: u32 = 0x0609_0031;
const TOO_LOW: u32 = 0x0609_0032;

/// ±16384, and 32767 for float.
const SET_POINT: (u16, u8) = (0x6300, 1);
const FLOAT: i16 = 32767;

/// v × to / from, rounded half away from zero, done in the simplest way there is.
fn convert(value: i16, to: i16, from: i16) -> i16 {
    let exact = f64::from(value) * f64::from(to) / f64::from(from);
    exact.round() as i16
}

fn read_8(rig: &mut Rig, index: u16) -> i16 {
    i16::from(rig.read(index, 0) as u8 as i8)
}

fn read_16(rig: &mut Rig, index: u16, sub: u8) -> i16 {
    rig.read(index, sub) as u16 as i16
}

/// What the three views of the set-point read: 0x6300:1, 0x3300, 0x3303.
fn views(rig: &mut Rig) -> (i16, i16, i16) {
    (read_16(rig, SET_POINT.0, SET_POINT.1), read_8(rig, 0x3300), read_16(rig, 0x3303, 0))
}

/// What the actual value's objects read: 0x6301:1, 0x3301, 0x3302, 0x3304.
fn actual(rig: &mut Rig) -> (i16, i16, i16, i16) {
    (read_16(rig, 0x6301, 1), read_8(rig, 0x3301), read_8(rig, 0x3302), read_16(rig, 0x3304, 0))
}

fn write(rig: &mut Rig, (index, sub): (u16, u8), value: i16) -> Result<(), u32> {
    let size = if index == 0x3300 { 1 } else { 2 };
    let mask = if size == 1 { 0xFF } else { 0xFFFF };
    rig.write(index, sub, size, u32::from(value as u16) & mask)
}

/// Feeds the time guard with a set-point every 100 ms for so long.
fn hold(rig: &mut Rig, object: (u16, u8), value: i16, ms: u64) {
    for _ in 0..ms.div_ceil(100) {
        assert_eq!(write(rig, object, value), Ok(()));
        rig.advance(100);
    }
}

#[test]
fn three_views_of_one_set_point() {
    let mut rig = Rig::booted();
    for value in (-16384..=16384).step_by(97).chain([-16383, -1, 0, 1, 64, 65, 8192, -8192, 16383, 16384]) {
        assert_eq!(write(&mut rig, SET_POINT, value), Ok(()), "{value}");
        assert_eq!(views(&mut rig), (value, convert(value, 127, 16384), convert(value, 1000, 16384)), "{value}");
    }
    for value in -127..=127 {
        assert_eq!(write(&mut rig, (0x3300, 0), value), Ok(()), "{value}");
        let raw = convert(value, 16384, 127);
        assert_eq!(views(&mut rig), (raw, value, convert(raw, 1000, 16384)), "{value}");
    }
    for value in -1000..=1000 {
        assert_eq!(write(&mut rig, (0x3303, 0), value), Ok(()), "{value}");
        let raw = convert(value, 16384, 1000);
        assert_eq!(views(&mut rig), (raw, convert(raw, 127, 16384), value), "{value}");
    }
}

#[test]
fn float_is_no_position() {
    let mut rig = Rig::booted();
    assert_eq!(write(&mut rig, SET_POINT, FLOAT), Ok(()));
    assert_eq!(views(&mut rig), (FLOAT, 127, 1000));
    assert_eq!(write(&mut rig, SET_POINT, 16384), Ok(()));
    assert_eq!(views(&mut rig), (16384, 127, 1000));
}

#[test]
fn what_is_out_of_range_is_refused_and_the_set_point_stays() {
    let mut rig = Rig::booted();
    assert_eq!(write(&mut rig, SET_POINT, 1234), Ok(()));
    for (object, value, code) in [
        (SET_POINT, 16385, TOO_HIGH),
        (SET_POINT, 32766, TOO_HIGH),
        (SET_POINT, -16385, TOO_LOW),
        (SET_POINT, -32767, TOO_LOW),
        (SET_POINT, i16::MIN, TOO_LOW),
        ((0x3300, 0), -128, TOO_LOW),
        ((0x3303, 0), 1001, TOO_HIGH),
        ((0x3303, 0), FLOAT, TOO_HIGH),
        ((0x3303, 0), -1001, TOO_LOW),
        ((0x3303, 0), i16::MIN, TOO_LOW),
    ] {
        assert_eq!(write(&mut rig, object, value), Err(code), "{object:04X?} := {value}");
        assert_eq!(views(&mut rig), (1234, 10, 75));
    }
}

#[test]
fn the_actual_value_in_all_its_scales() {
    let mut rig = Rig::active();
    for value in [16384, -16384, 1, -1, 64, 65, 8192, -8192, 5000, -12345, 0] {
        hold(&mut rig, SET_POINT, value, 700);
        let per_127 = convert(value, 127, 16384);
        assert_eq!(actual(&mut rig), (value, per_127, -per_127, convert(value, 1000, 16384)));
    }
    assert_eq!(rig.read(0x6041, 0), 0x0F);
}

/// Neutral to full stroke takes 250 ms, so that 1 ms is 65.5 steps; float is reached within 5 % of full stroke.
#[test]
fn the_actual_value_reads_float_when_float_is_reached() {
    let mut rig = Rig::active();
    assert_eq!(write(&mut rig, SET_POINT, FLOAT), Ok(()));
    rig.advance(125);
    assert_eq!(actual(&mut rig), (8192, 64, -64, 500));
    assert_eq!(write(&mut rig, SET_POINT, FLOAT), Ok(()));
    rig.advance(112);
    // 15532, just below 95 % of 16384
    assert_eq!(actual(&mut rig), (15532, 120, -120, 948));
    rig.advance(1);
    assert_eq!(actual(&mut rig), (FLOAT, 127, -127, 1000));
    // At the very place, but without float, it is a position.
    hold(&mut rig, SET_POINT, 16384, 300);
    assert_eq!(actual(&mut rig), (16384, 127, -127, 1000));
    hold(&mut rig, SET_POINT, FLOAT, 100);
    assert_eq!(actual(&mut rig), (FLOAT, 127, -127, 1000));
}

/// Any set-point but neutral is full stroke for a PVEO; what is read back is what was written.
#[test]
fn a_pveo_is_all_or_nothing() {
    let mut rig = Rig::booted_pveo();
    rig.activate();
    for (object, value, position) in [
        (SET_POINT, 1, 16384),
        (SET_POINT, -1, -16384),
        (SET_POINT, 0, 0),
        ((0x3300, 0), 100, 16384),
        ((0x3303, 0), -1, -16384),
        ((0x3303, 0), 1, 16384),
        (SET_POINT, -16384, -16384),
    ] {
        hold(&mut rig, object, value, 700);
        let (raw, per_127, per_1000) = views(&mut rig);
        let read = match object.0 {
            0x3300 => per_127,
            0x3303 => per_1000,
            _ => raw,
        };
        assert_eq!((read, actual(&mut rig).0), (value, position), "{object:04X?} := {value}");
    }
    assert_eq!(rig.read(0x6041, 0), 0x0F);
}

/// People and tools are shown the NMT state, and the set-point that 0x6300 reads.
#[test]
fn the_view_shows_the_nmt_state_and_the_set_point() {
    let now = Instant::from_secs(1);
    let mut valve = PveCanopen::power_on(Setup::new(Kind::PveaCanopen), &Image::empty(), StartCause::PowerOn, now);
    while valve.next_frame(now).is_some() || valve.all_sent(now) {}
    assert_eq!(valve.view(now).nmt, Some(State::PreOperational));
    valve.handle(&frame("000: 01 00"), now);
    for _ in 0..4 {
        valve.handle(&frame("220: 0F 00 00 10"), now);
    }
    let view = valve.view(now);
    let set_point = Position::new(4096).map(SetPoint::Position);
    assert_eq!((view.nmt, view.valve.map(|valve| valve.set_point)), (Some(State::Operational), set_point));
}
