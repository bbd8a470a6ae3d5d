//! Frame lengths, against manually computed values, an independent script, and the worst case.

use proptest::prelude::*;
use protocol_core::frame::{Frame, Id, extended, standard};

use super::bits::FrameBits;

fn data(id: impl Into<Id>, bytes: &[u8]) -> FrameBits {
    FrameBits::of(&Frame::of(id.into(), bytes).unwrap())
}

#[test]
fn zeros_have_a_stuff_bit_after_every_fifth() {
    // Start of frame, identifier, control field and CRC are all zero: 34 bits, 6 stuff bits, a trailer of 10 bits.
    assert_eq!(data(standard(0), &[]).on_wire(), 34 + 6 + 10);
}

#[test]
fn standard_frames() {
    for (id, bytes, raw, stuff) in [
        (0x123, &[][..], 34, 1),
        (0x720, &[5], 42, 3),
        (0x1A0, &[9, 0, 0, 0], 66, 7),
        (0x7FF, &[0xFF; 8], 98, 15),
        (0x555, &[0x55; 8], 98, 1),
        (0x078, &[0x3C; 8], 98, 20),
        // The worst case found by a search; the theoretical limit is 24.
        (0x07C, &[0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3C, 0x3F], 98, 21),
    ] {
        assert_eq!(data(standard(id), bytes).on_wire(), raw + stuff + 10, "{id:03X} {bytes:X?}");
    }
}

#[test]
fn extended_frames() {
    for (id, bytes, raw, stuff) in [
        (0x18FE_EF00, &[0; 8][..], 118, 16),
        (0x0CFE_3080, &[0xFF; 8], 118, 16),
        (0x1555_5555, &[0x55; 8], 118, 0),
        (0x000E_4180, &[0x3C; 8], 118, 25),
        (0x1BC7_8805, &[0x03, 0x22, 0x10, 0x01], 86, 5),
    ] {
        assert_eq!(data(extended(id), bytes).on_wire(), raw + stuff + 10, "{id:08X} {bytes:X?}");
    }
}

#[test]
fn remote_frames_have_a_length_and_no_data() {
    assert_eq!(FrameBits::of(&Frame::remote(standard(0x700).into(), 1)).on_wire(), 34 + 3 + 10);
    assert_eq!(FrameBits::of(&Frame::remote(extended(0x1FFF_FFFF).into(), 0)).on_wire(), 54 + 7 + 10);
}

#[test]
fn two_frames_part_where_the_first_bit_differs() {
    let (a, b) = (data(standard(0x700), &[0x7F]), data(standard(0x700), &[0x05]));
    // 19 bits up to the data, including two stuff bits (8 zeros of the identifier, the zeros up to the length), and the
    // first data bit; the second data bit is 1 in 7F and 0 in 05.
    let parting = a.first_difference(b).unwrap();
    assert!(!parting.dominant);
    let other = b.first_difference(a).unwrap();
    assert!(other.dominant);
    assert_eq!(parting.bit, other.bit);
    assert_eq!(parting.bit, 19 + 1 + 2);
    assert_eq!(a.first_difference(a), None);
    // Frames of different lengths differ in the data length code.
    let longer = data(standard(0x700), &[0x7F, 0]).first_difference(a).unwrap();
    assert_eq!(longer.bit, 1 + 11 + 3 + 2 + 2);
}

/// Counts the stuff bits of a frame bit by bit, as in ISO 11898-1, 10.5.
fn stuffed_bit_by_bit(bits: &[bool]) -> u32 {
    let (mut count, mut run, mut last) = (0, 0, None);
    for bit in bits {
        run = if last == Some(*bit) { run + 1 } else { 1 };
        last = Some(*bit);
        if run == 5 {
            (count, run, last) = (count + 1, 1, Some(!bit));
        }
    }
    count
}

proptest! {
    /// The table agrees with the stuffing rule, even for a part of a frame.
    #[test]
    fn the_table_counts_as_the_rule_says(value: u128, len in 1..=118_u32, part in 1..=118_u32) {
        // A start of frame is dominant.
        let value = value & ((1 << (len - 1)) - 1);
        let bits: Vec<bool> = (0..len).rev().map(|place| value >> place & 1 == 1).collect();
        let part = part.min(len);
        let expected = stuffed_bit_by_bit(&bits[..part as usize]);
        prop_assert_eq!(FrameBits { value, len }.stuff_bits(part), expected);
    }

    /// ISO 11898-1: after the first five bits, at most every fourth bit is followed by a stuff bit.
    #[test]
    fn no_frame_is_longer_than_the_worst_case(raw in 0..=0x1FFF_FFFF_u32, long: bool, bytes: [u8; 8], len in 0..=8_usize) {
        let id: Id = if long { extended(raw).into() } else { standard(raw as u16).into() };
        let bits = data(id, &bytes[..len]);
        let unstuffed = if long { 39 } else { 19 } + 8 * len as u32 + 15;
        prop_assert!(bits.on_wire() >= unstuffed + 10);
        prop_assert!(bits.on_wire() <= unstuffed + (unstuffed - 1) / 4 + 10);
    }
}
