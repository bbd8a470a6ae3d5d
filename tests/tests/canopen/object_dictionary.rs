//! Every row of the object dictionary, and that there is nothing beside it (SPEC 4.1).

use std::collections::BTreeSet;

use protocol_core::device::pve::{Kind, Setup};
use tests::Rig;

const NO_OBJECT: u32 = 0x0602_0000;
const NO_SUB: u32 = 0x0609_0011;
const READ_ONLY: u32 = 0x0601_0002;
const TOO_LONG: u32 = 0x0607_0012;
const TOO_SHORT: u32 = 0x0607_0013;
const INVALID_VALUE: u32 = 0x0609_0030;
const TOO_HIGH: u32 = 0x0609_0031;
const TOO_LOW: u32 = 0x0609_0032;
const CANNOT_STORE: u32 = 0x0800_0020;
const NO_DATA: u32 = 0x0800_0024;

/// How many bytes a number has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Type {
    U8 = 1,
    U16 = 2,
    U32 = 4,
    I8 = -1,
    I16 = -2,
}

impl Type {
    fn size(self) -> u8 {
        (self as i8).unsigned_abs()
    }
}

use Type::{I8, I16, U8, U16, U32};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Access {
    Ro,
    Rw,
}

use Access::{Ro, Rw};

/// The numbers of a `pvea-canopen` fresh from the factory, at node 0x20.
const NUMBERS: [(u16, u8, Type, Access, u32); 63] = [
    (0x1000, 0, U32, Ro, 0x0000_0198),
    (0x1001, 0, U8, Ro, 0),
    (0x1003, 0, U8, Rw, 0),
    (0x1005, 0, U32, Rw, 0x80),
    (0x1010, 0, U8, Ro, 1),
    (0x1010, 1, U32, Rw, 1),
    (0x1011, 0, U8, Ro, 5),
    (0x1011, 1, U32, Rw, 1),
    (0x1011, 5, U32, Rw, 1),
    (0x1014, 0, U32, Ro, 0xA0),
    (0x1017, 0, U16, Rw, 0),
    (0x1018, 0, U8, Ro, 3),
    (0x1018, 1, U32, Ro, 0x0100_0019),
    (0x1018, 2, U32, Ro, 0x5336_0000),
    (0x1018, 3, U32, Ro, 0x0001_0020),
    (0x1018, 4, U32, Ro, 0x5B2E_0100),
    (0x1028, 0, U8, Ro, 1),
    (0x1028, 1, U32, Rw, 0x8000_0000),
    (0x1400, 0, U8, Ro, 2),
    (0x1400, 1, U32, Rw, 0x220),
    (0x1400, 2, U8, Rw, 0xFF),
    (0x1600, 0, U8, Rw, 2),
    (0x1600, 1, U32, Rw, 0x6040_0010),
    (0x1600, 2, U32, Rw, 0x6300_0110),
    (0x1600, 3, U32, Rw, 0x0001_0001),
    (0x1600, 4, U32, Rw, 0x0001_0001),
    (0x1600, 5, U32, Rw, 0x0001_0001),
    (0x1600, 6, U32, Rw, 0x0001_0001),
    (0x1600, 7, U32, Rw, 0x0001_0001),
    (0x1600, 8, U32, Rw, 0x0001_0001),
    (0x1800, 0, U8, Ro, 2),
    (0x1800, 1, U32, Rw, 0x1A0),
    (0x1800, 2, U8, Rw, 0xFF),
    (0x1A00, 0, U8, Rw, 2),
    (0x1A00, 1, U32, Rw, 0x6041_0010),
    (0x1A00, 2, U32, Rw, 0x6301_0110),
    (0x1A00, 3, U32, Rw, 0x0001_0001),
    (0x1A00, 4, U32, Rw, 0x0001_0001),
    (0x1A00, 5, U32, Rw, 0x0001_0001),
    (0x1A00, 6, U32, Rw, 0x0001_0001),
    (0x1A00, 7, U32, Rw, 0x0001_0001),
    (0x1A00, 8, U32, Rw, 0x0001_0001),
    (0x2001, 0, U8, Ro, 0),
    (0x2002, 0, U8, Ro, 0),
    (0x200F, 0, U8, Ro, 0),
    (0x2019, 0, U8, Ro, 0),
    (0x201D, 0, U8, Ro, 0),
    (0x2023, 0, U8, Ro, 0),
    (0x2024, 0, U8, Ro, 0),
    (0x2040, 0, U8, Ro, 0),
    (0x3300, 0, I8, Rw, 0),
    (0x3301, 0, I8, Ro, 0),
    (0x3302, 0, I8, Ro, 0),
    (0x3303, 0, I16, Rw, 0),
    (0x3304, 0, I16, Ro, 0),
    (0x6040, 0, U16, Rw, 0),
    (0x6041, 0, U16, Ro, 0x08),
    (0x6042, 0, I8, Rw, 1),
    (0x605F, 0, U32, Ro, 0x0500_0000),
    (0x6300, 0, U8, Ro, 1),
    (0x6300, 1, I16, Rw, 0),
    (0x6301, 0, U8, Ro, 1),
    (0x6301, 1, I16, Ro, 0),
];

/// Sub-indices that exist and have nothing to be read as long as there was no error.
const EMPTY_HISTORY: (u16, std::ops::RangeInclusive<u8>) = (0x1003, 1..=8);

/// The texts: index, `pvea-canopen`, `pveo-canopen`.
const TEXTS: [(u16, Access, &str, &str); 3] = [
    (0x100A, Ro, "APP-_S6m1_M_R132_CANOPEN-_11149437_-000_ 180701", "APP-_S6m1_M_R132_CANOPEN-_11149443_-000_ 180701"),
    (0x6052, Ro, "1529741568", "1529741568"),
    (0x6053, Rw, "PVEA-CI S6", "PVEO-CI S6"),
];

fn exists(index: u16, sub: u8) -> bool {
    NUMBERS.iter().any(|row| (row.0, row.1) == (index, sub))
        || TEXTS.iter().any(|row| (row.0, 0) == (index, sub))
        || (index == EMPTY_HISTORY.0 && EMPTY_HISTORY.1.contains(&sub))
}

fn indices() -> BTreeSet<u16> {
    NUMBERS.iter().map(|row| row.0).chain(TEXTS.iter().map(|row| row.0)).collect()
}

fn abort(rig: &mut Rig, command: u8, index: u16, sub: u8) -> Option<u32> {
    let answer = rig.sdo(command, index, sub, 0);
    let [command, low, high, answered_sub, code @ ..] = *answer.bytes();
    assert_eq!((u16::from_le_bytes([low, high]), answered_sub), (index, sub), "{answer}");
    (command == 0x80).then(|| u32::from_le_bytes(code))
}

#[test]
fn every_number_reads_its_default_in_its_length() {
    for mut rig in [Rig::booted(), Rig::booted_pveo()] {
        for (index, sub, data_type, _, value) in NUMBERS {
            let answer = rig.sdo(0x40, index, sub, 0);
            let [low, high] = index.to_le_bytes();
            let command = 0x43 | (4 - data_type.size()) << 2;
            let [a, b, c, d] = value.to_le_bytes();
            assert_eq!(answer.data(), [command, low, high, sub, a, b, c, d], "{index:04X}:{sub}");
        }
    }
}

#[test]
fn every_text_reads_its_default() {
    for (mut rig, pveo) in [(Rig::booted(), false), (Rig::booted_pveo(), true)] {
        for (index, _, of_pvea, of_pveo) in TEXTS {
            let expected = if pveo { of_pveo } else { of_pvea };
            let text = rig.read_segmented(index, 0).map(String::from_utf8);
            assert_eq!(text, Ok(Ok(expected.to_owned())), "{index:04X}");
        }
    }
}

#[test]
fn the_history_is_there_and_empty() {
    let mut rig = Rig::booted();
    for sub in EMPTY_HISTORY.1 {
        assert_eq!(rig.read_abort(0x1003, sub), NO_DATA, "{sub}");
        assert_eq!(rig.write(0x1003, sub, 4, 0), Err(READ_ONLY), "{sub}");
    }
}

#[test]
fn there_is_no_other_index() {
    let mut rig = Rig::booted();
    let indices = indices();
    for index in (0..=0xFFFF).filter(|index| !indices.contains(index)) {
        for sub in [0, 1] {
            // upload, expedited download, segmented download
            for command in [0x40, 0x2F, 0x21] {
                assert_eq!(abort(&mut rig, command, index, sub), Some(NO_OBJECT), "{command:02X} {index:04X}:{sub}");
            }
        }
    }
}

#[test]
fn there_is_no_other_sub_index() {
    let mut rig = Rig::booted();
    for index in indices() {
        for sub in (0..=255).filter(|sub| !exists(index, *sub)) {
            for command in [0x40, 0x2F, 0x21] {
                assert_eq!(abort(&mut rig, command, index, sub), Some(NO_SUB), "{command:02X} {index:04X}:{sub}");
            }
        }
    }
}

#[test]
fn what_is_read_only_cannot_be_written() {
    let mut rig = Rig::booted();
    for (index, sub, data_type, _, value) in NUMBERS.into_iter().filter(|row| row.3 == Ro) {
        // Not even with the value that it has.
        assert_eq!(rig.write(index, sub, data_type.size(), value), Err(READ_ONLY), "{index:04X}:{sub}");
        assert_eq!(abort(&mut rig, 0x22, index, sub), Some(READ_ONLY), "{index:04X}:{sub}");
        assert_eq!(abort(&mut rig, 0x20, index, sub), Some(READ_ONLY), "{index:04X}:{sub}");
    }
    for (index, ..) in TEXTS.into_iter().filter(|row| row.1 == Ro) {
        assert_eq!(rig.write(index, 0, 4, 0x3131_3131), Err(READ_ONLY), "{index:04X}");
        assert_eq!(rig.write_segmented(index, 0, b"1111111"), Err(READ_ONLY), "{index:04X}");
    }
}

#[test]
fn a_number_of_another_length_is_refused() {
    let mut rig = Rig::booted();
    for (index, sub, data_type, _, value) in NUMBERS.into_iter().filter(|row| row.3 == Rw) {
        for size in 1..=4 {
            let refused = match size.cmp(&data_type.size()) {
                std::cmp::Ordering::Less => TOO_SHORT,
                std::cmp::Ordering::Equal => continue,
                std::cmp::Ordering::Greater => TOO_LONG,
            };
            assert_eq!(rig.write(index, sub, size, value), Err(refused), "{index:04X}:{sub} in {size} bytes");
        }
    }
    for (index, sub, _, _, value) in NUMBERS {
        assert_eq!(rig.read(index, sub), value, "{index:04X}:{sub}");
    }
}

/// Values that an object takes, and reads back.
#[test]
fn what_can_be_written_reads_back() {
    let table = [
        (0x1003, 0, U8, &[0][..]),
        (0x1005, 0, U32, &[0x81, 0x100, 0x80, 0x8000_0080]),
        (0x1017, 0, U16, &[1, 10, 105, 0x7FFF, 0]),
        (0x1028, 1, U32, &[0xA1, 0x8000_0000, 0xFFFF_FFFF, 0x8000_0000]),
        (0x1400, 1, U32, &[0x8000_0220, 0xC000_0221, 0x0000_0221, 0x4000_0221]),
        (0x1400, 2, U8, &[0xFF]),
        (0x1800, 1, U32, &[0x8000_01A0, 0xC000_01A1, 0x0000_01A1, 0x4000_01A1]),
        (0x1800, 2, U8, &[1, 7, 240, 0xFF]),
        (0x3300, 0, I8, &[0x01, 0x7F, 0x81, 0xFF, 0x00]),
        (0x3303, 0, I16, &[1, 1000, 0xFC18, 0xFFFF, 0]),
        (0x6040, 0, U16, &[0xFFF0, 0x0000]),
        (0x6042, 0, I8, &[2, 1]),
        (0x6300, 1, I16, &[1, 16384, 0xC000, 32767, 0xFFFF, 0]),
    ];
    let mut rig = Rig::booted();
    for (index, sub, data_type, values) in table {
        for value in values {
            assert_eq!(rig.write(index, sub, data_type.size(), *value), Ok(()), "{index:04X}:{sub} := {value:X}");
            // A heartbeat time is followed by a heartbeat.
            rig.take();
            assert_eq!(rig.read(index, sub), *value, "{index:04X}:{sub}");
        }
    }
}

#[test]
fn what_is_out_of_range_is_refused_and_changes_nothing() {
    let table = [
        (0x1003, 0, U8, INVALID_VALUE, &[1, 8, 255][..]),
        (0x1005, 0, U32, INVALID_VALUE, &[0x4000_0080, 0xC000_0080, 0x2000_0080, 0x7F, 0x181_0000]),
        (0x1010, 1, U32, CANNOT_STORE, &[0, 1, 0x7361_7665, 0x6461_6F6C, 0x6576_6172, 0xFFFF_FFFF]),
        (0x1011, 1, U32, CANNOT_STORE, &[0, 1, 0x6C6F_6164, 0x6576_6173, 0x7364_6B70, 0xFFFF_FFFF]),
        (0x1011, 5, U32, CANNOT_STORE, &[0, 1, 0x6461_6F6C, 0x706B_6473, 0xFFFF_FFFF]),
        (0x1017, 0, U16, TOO_HIGH, &[0x8000, 0xFFFF]),
        (0x1028, 1, U32, INVALID_VALUE, &[0x2000_00A1, 0x0000_0000, 0x0000_0701]),
        (0x1400, 2, U8, INVALID_VALUE, &[0, 1, 240, 241, 252, 253, 254]),
        (0x1800, 2, U8, INVALID_VALUE, &[0, 241, 251, 252, 253, 254]),
        (0x3300, 0, I8, TOO_LOW, &[0x80]),
        (0x3303, 0, I16, TOO_HIGH, &[1001, 16384, 0x7FFF]),
        (0x3303, 0, I16, TOO_LOW, &[0xFC17, 0xC000, 0x8000]),
        (0x6042, 0, I8, INVALID_VALUE, &[0, 3, 0x7F, 0x80, 0xFF]),
        (0x6300, 1, I16, TOO_HIGH, &[16385, 32766]),
        (0x6300, 1, I16, TOO_LOW, &[0xBFFF, 0x8000, 0x8001]),
    ];
    let mut rig = Rig::booted();
    for (index, sub, data_type, code, values) in table {
        let before = rig.read(index, sub);
        for value in values {
            let refused = rig.write(index, sub, data_type.size(), *value);
            assert_eq!(refused, Err(code), "{index:04X}:{sub} := {value:X}: {refused:X?}");
            assert_eq!(rig.read(index, sub), before, "{index:04X}:{sub}");
        }
    }
    assert!(rig.writes.len() <= 2, "nothing was stored beyond what a first start stores: {:?}", rig.writes);
}

#[test]
fn a_description_takes_up_to_ten_characters() {
    let mut rig = Rig::booted();
    for text in ["boom left", "1234567890", "", "x", "1234567"] {
        assert_eq!(rig.write_segmented(0x6053, 0, text.as_bytes()), Ok(()), "{text}");
        // One of one to four characters is read expedited.
        match text.len() {
            1..=4 => assert_eq!(rig.read(0x6053, 0).to_le_bytes()[..text.len()], *text.as_bytes()),
            _ => assert_eq!(rig.read_segmented(0x6053, 0).as_deref(), Ok(text.as_bytes())),
        }
    }
    for text in ["12345678901", "123456789012345678901234567890"] {
        assert_eq!(rig.write_segmented(0x6053, 0, text.as_bytes()), Err(TOO_LONG), "{text}");
    }
    assert_eq!(rig.read_segmented(0x6053, 0).as_deref(), Ok(&b"1234567"[..]));
    // expedited, with a size
    assert_eq!(rig.write(0x6053, 0, 3, u32::from_le_bytes(*b"arm?")), Ok(()));
    assert_eq!(rig.read(0x6053, 0).to_le_bytes(), *b"arm\0");
}

#[test]
fn the_numbers_that_follow_the_node_id_and_the_serial_number() {
    for (node_id, serial) in [(0x01, 0), (0x7F, u32::MAX), (0x10, 42)] {
        let setup = Setup { node_id: Some(node_id), serial: Some(serial), ..Setup::new(Kind::PveaCanopen) };
        let mut rig = Rig::booted_as(setup);
        let node_id = u32::from(node_id);
        assert_eq!(rig.read(0x1014, 0), 0x80 + node_id);
        assert_eq!(rig.read(0x1400, 1), 0x200 + node_id);
        assert_eq!(rig.read(0x1800, 1), 0x180 + node_id);
        assert_eq!(rig.read(0x1018, 4), serial);
        let text = serial.to_string();
        match text.len() {
            1..=4 => assert_eq!(rig.read(0x6052, 0).to_le_bytes()[..text.len()], *text.as_bytes()),
            _ => assert_eq!(rig.read_segmented(0x6052, 0).as_deref(), Ok(text.as_bytes())),
        }
    }
}
