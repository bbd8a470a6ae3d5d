//! Every object: what it reads, who may write it, what it takes; and that there is nothing beside it (SPEC 4.1, 9).

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use protocol_core::device::describe;
use tests::Rig;
use tests::sdo::{LOAD, SAVE};

use super::kinds::{Kind, each_kind};

const NO_OBJECT: u32 = 0x0602_0000;
const NO_SUB: u32 = 0x0609_0011;
const READ_ONLY: u32 = 0x0601_0002;
const NOT_MAPPABLE: u32 = 0x0604_0041;
const TOO_LONG: u32 = 0x0607_0012;
const TOO_SHORT: u32 = 0x0607_0013;
const INVALID_VALUE: u32 = 0x0609_0030;
const TOO_HIGH: u32 = 0x0609_0031;
const TOO_LOW: u32 = 0x0609_0032;
const CANNOT_STORE: u32 = 0x0800_0020;
const NO_DATA: u32 = 0x0800_0024;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Ro,
    Rw,
}

use Access::{Ro, Rw};

/// A row: index, sub-indices, bytes, access, and the value in a new node.
type Row = (u16, RangeInclusive<u8>, u8, Access, u32);

/// A `pvea-canopen` or `pveo-canopen` at node 0x20.
const VALVE: &[Row] = &[
    (0x1000, 0..=0, 4, Ro, 0x0000_0198),
    (0x1001, 0..=0, 1, Ro, 0),
    (0x1003, 0..=0, 1, Rw, 0),
    (0x1005, 0..=0, 4, Rw, 0x80),
    (0x1010, 0..=0, 1, Ro, 1),
    (0x1010, 1..=1, 4, Rw, 1),
    (0x1011, 0..=0, 1, Ro, 5),
    (0x1011, 1..=1, 4, Rw, 1),
    (0x1011, 5..=5, 4, Rw, 1),
    (0x1014, 0..=0, 4, Ro, 0xA0),
    (0x1017, 0..=0, 2, Rw, 0),
    (0x1018, 0..=0, 1, Ro, 3),
    (0x1018, 1..=1, 4, Ro, 0x0100_0019),
    (0x1018, 2..=2, 4, Ro, 0x5336_0000),
    (0x1018, 3..=3, 4, Ro, 0x0001_0020),
    (0x1018, 4..=4, 4, Ro, 0x5B2E_0100),
    (0x1028, 0..=0, 1, Ro, 1),
    (0x1028, 1..=1, 4, Rw, 0x8000_0000),
    (0x1400, 0..=0, 1, Ro, 2),
    (0x1400, 1..=1, 4, Rw, 0x220),
    (0x1400, 2..=2, 1, Rw, 0xFF),
    (0x1600, 0..=0, 1, Rw, 2),
    (0x1600, 1..=1, 4, Rw, 0x6040_0010),
    (0x1600, 2..=2, 4, Rw, 0x6300_0110),
    (0x1600, 3..=8, 4, Rw, 0x0001_0001),
    (0x1800, 0..=0, 1, Ro, 2),
    (0x1800, 1..=1, 4, Rw, 0x1A0),
    (0x1800, 2..=2, 1, Rw, 0xFF),
    (0x1A00, 0..=0, 1, Rw, 2),
    (0x1A00, 1..=1, 4, Rw, 0x6041_0010),
    (0x1A00, 2..=2, 4, Rw, 0x6301_0110),
    (0x1A00, 3..=8, 4, Rw, 0x0001_0001),
    (0x2001, 0..=0, 1, Ro, 0),
    (0x2002, 0..=0, 1, Ro, 0),
    (0x200F, 0..=0, 1, Ro, 0),
    (0x2019, 0..=0, 1, Ro, 0),
    (0x201D, 0..=0, 1, Ro, 0),
    (0x2023, 0..=0, 1, Ro, 0),
    (0x2024, 0..=0, 1, Ro, 0),
    (0x2040, 0..=0, 1, Ro, 0),
    (0x3300, 0..=0, 1, Rw, 0),
    (0x3301, 0..=0, 1, Ro, 0),
    (0x3302, 0..=0, 1, Ro, 0),
    (0x3303, 0..=0, 2, Rw, 0),
    (0x3304, 0..=0, 2, Ro, 0),
    (0x6040, 0..=0, 2, Rw, 0),
    (0x6041, 0..=0, 2, Ro, 0x08),
    (0x6042, 0..=0, 1, Rw, 1),
    (0x605F, 0..=0, 4, Ro, 0x0500_0000),
    (0x6300, 0..=0, 1, Ro, 1),
    (0x6300, 1..=1, 2, Rw, 0),
    (0x6301, 0..=0, 1, Ro, 1),
    (0x6301, 1..=1, 2, Ro, 0),
];

/// A HAT 1000 or, but for its product code, HAT 3000 at node 1.
const SENSOR: &[Row] = &[
    (0x1000, 0..=0, 4, Ro, 0x0001_0196),
    (0x1001, 0..=0, 1, Ro, 0),
    (0x1002, 0..=0, 4, Ro, 0),
    (0x1003, 0..=0, 1, Ro, 0),
    (0x1005, 0..=0, 4, Rw, 0x80),
    (0x1010, 0..=0, 1, Ro, 4),
    (0x1010, 1..=4, 4, Rw, 1),
    (0x1011, 0..=0, 1, Ro, 4),
    (0x1011, 1..=4, 4, Rw, 1),
    (0x1014, 0..=0, 4, Rw, 0x81),
    (0x1017, 0..=0, 2, Rw, 0),
    (0x1018, 0..=0, 1, Ro, 4),
    (0x1018, 1..=1, 4, Ro, 0xDA),
    (0x1018, 2..=2, 4, Ro, 925_010),
    (0x1018, 3..=3, 4, Ro, 0x0001_0007),
    (0x1018, 4..=4, 4, Ro, 1),
    (0x1029, 0..=0, 1, Ro, 2),
    (0x1029, 1..=2, 1, Rw, 0),
    (0x1800, 0..=0, 1, Ro, 5),
    (0x1800, 1..=1, 4, Rw, 0x8000_0181),
    (0x1800, 2..=2, 1, Rw, 254),
    (0x1800, 3..=3, 2, Rw, 0),
    (0x1800, 5..=5, 2, Rw, 0),
    (0x1A00, 0..=0, 1, Rw, 1),
    (0x1A00, 1..=1, 4, Rw, 0x6004_0020),
    (0x1A00, 2..=8, 4, Rw, 0),
    (0x1F80, 0..=0, 4, Rw, 0x08),
    (0x2001, 0..=0, 1, Ro, 2),
    (0x2001, 1..=1, 1, Ro, 1),
    (0x2001, 2..=2, 1, Rw, 1),
    (0x2002, 0..=1, 1, Ro, 2),
    (0x2002, 2..=2, 1, Rw, 2),
    (0x6000, 0..=0, 2, Ro, 0),
    (0x6001, 0..=0, 4, Ro, 16_384),
    (0x6002, 0..=0, 4, Ro, 16_384),
    (0x6003, 0..=0, 4, Rw, 0),
    (0x6004, 0..=0, 4, Ro, 0),
    (0x6500, 0..=0, 2, Ro, 0),
    (0x6501, 0..=0, 4, Ro, 16_384),
    (0x6503, 0..=0, 2, Ro, 0),
    (0x6504, 0..=0, 2, Ro, 1),
    (0x6505, 0..=0, 2, Ro, 0),
    (0x6506, 0..=0, 2, Ro, 0),
    (0x6507, 0..=0, 4, Ro, 0x0107_0302),
    (0x6508, 0..=0, 4, Ro, 0xFFFF_FFFF),
    (0x6509, 0..=0, 4, Ro, 0),
    (0x650A, 0..=0, 1, Ro, 3),
    (0x650A, 1..=2, 4, Ro, 0),
    (0x650A, 3..=3, 4, Ro, 16_383),
    (0x650B, 0..=0, 4, Ro, 1),
];

/// Sub-indices that exist and have nothing to be read as long as there was no error.
const EMPTY_HISTORY: (u16, RangeInclusive<u8>) = (0x1003, 1..=8);

/// Numbers of an object: what it takes, and what it refuses with which abort code. The last that it takes is there when
/// it refuses.
type Taken = (u16, u8, &'static [u32], &'static [(u32, &'static [u32])]);

const NO_SAVE: (u32, &[u32]) = (CANNOT_STORE, &[0, 1, LOAD, 0x6576_6172, SAVE.swap_bytes(), u32::MAX]);
const NO_LOAD: (u32, &[u32]) = (CANNOT_STORE, &[0, 1, SAVE, 0x7364_6B70, LOAD.swap_bytes(), u32::MAX]);

const VALVE_TAKES: &[Taken] = &[
    (0x1003, 0, &[0], &[(INVALID_VALUE, &[1, 8, 255])]),
    (
        0x1005,
        0,
        &[0x81, 0x100, 0x80, 0x8000_0080],
        &[(INVALID_VALUE, &[0x4000_0080, 0xC000_0080, 0x2000_0080, 0x7F, 0x181_0000])],
    ),
    (0x1010, 1, &[], &[NO_SAVE]),
    (0x1011, 1, &[], &[NO_LOAD]),
    (0x1011, 5, &[], &[(CANNOT_STORE, &[0, 1, LOAD, 0x706B_6473, u32::MAX])]),
    (0x1017, 0, &[1, 10, 105, 0x7FFF, 0], &[(TOO_HIGH, &[0x8000, 0xFFFF])]),
    (
        0x1028,
        1,
        &[0xA1, 0x8000_0000, 0xFFFF_FFFF, 0x8000_0000],
        &[(INVALID_VALUE, &[0x2000_00A1, 0x0000_0000, 0x0000_0701])],
    ),
    (0x1400, 1, &[0x8000_0220, 0xC000_0221, 0x0000_0221, 0x4000_0221], &[]),
    (0x1400, 2, &[0xFF], &[(INVALID_VALUE, &[0, 1, 240, 241, 252, 253, 254])]),
    (0x1800, 1, &[0x8000_01A0, 0xC000_01A1, 0x0000_01A1, 0x4000_01A1], &[]),
    (0x1800, 2, &[1, 7, 240, 0xFF], &[(INVALID_VALUE, &[0, 241, 251, 252, 253, 254])]),
    (0x3300, 0, &[0x01, 0x7F, 0x81, 0xFF, 0x00], &[(TOO_LOW, &[0x80])]),
    (
        0x3303,
        0,
        &[1, 1000, 0xFC18, 0xFFFF, 0],
        &[(TOO_HIGH, &[1001, 16384, 0x7FFF]), (TOO_LOW, &[0xFC17, 0xC000, 0x8000])],
    ),
    (0x6040, 0, &[0xFFF0, 0x0000], &[]),
    (0x6042, 0, &[2, 1], &[(INVALID_VALUE, &[0, 3, 0x7F, 0x80, 0xFF])]),
    (
        0x6300,
        1,
        &[1, 16384, 0xC000, 32767, 0xFFFF, 0],
        &[(TOO_HIGH, &[16385, 32766]), (TOO_LOW, &[0xBFFF, 0x8000, 0x8001])],
    ),
];

const SENSOR_TAKES: &[Taken] = &[
    (0x1005, 0, &[0x81, 0x2000_0000, 0x3FFF_FFFF, 0x80], &[(INVALID_VALUE, &[0x4000_0080, 0x7F, 0x800, 0x181 << 12])]),
    (0x1010, 1, &[], &[NO_SAVE]),
    (0x1010, 2, &[], &[NO_SAVE]),
    (0x1010, 3, &[], &[NO_SAVE]),
    (0x1010, 4, &[], &[NO_SAVE]),
    (0x1011, 1, &[], &[NO_LOAD]),
    (0x1011, 2, &[], &[NO_LOAD]),
    (0x1011, 3, &[], &[NO_LOAD]),
    (0x1011, 4, &[], &[NO_LOAD]),
    (0x1017, 0, &[1, 0xFFFF, 0], &[]),
    (0x1029, 1, &[1, 2, 0], &[(INVALID_VALUE, &[3, 255])]),
    (0x1029, 2, &[1, 2, 0], &[(INVALID_VALUE, &[3, 255])]),
    (0x1800, 2, &[0, 1, 240, 255, 254], &[(INVALID_VALUE, &[241, 253])]),
    (0x1800, 3, &[1, 0xFFFF, 0], &[]),
    (0x1800, 5, &[1, 0xFFFF, 0], &[]),
    (0x1F80, 0, &[0x0C, 0x08], &[(INVALID_VALUE, &[0, 4, 0x0D, 0x108])]),
    (0x2001, 2, &[127, 255, 1], &[(INVALID_VALUE, &[0, 128, 254])]),
    (0x2002, 2, &[0, 1, 3, 4, 6, 7, 8, 2], &[(INVALID_VALUE, &[5, 9, 255])]),
    (0x6003, 0, &[1, 16_383, 0], &[(TOO_HIGH, &[16_384, 0xFFFF_FFFF])]),
];

impl Kind {
    /// The numbers, one by one.
    fn numbers(&self) -> impl Iterator<Item = (u16, u8, u8, Access, u32)> + Clone {
        let rows = if self.is_sensor() { SENSOR } else { VALVE };
        let product_code = self.identity[1];
        rows.iter().flat_map(move |(index, subs, size, access, value)| {
            let value = if (*index, subs) == (0x1018, &(2..=2)) { product_code } else { *value };
            subs.clone().map(move |sub| (*index, sub, *size, *access, value))
        })
    }

    /// The texts: index, access, value in a new node.
    pub(super) fn texts(&self) -> [(u16, Access, &'static str); 3] {
        match self.setup.kind.name() {
            "pvea-canopen" => [
                (0x100A, Ro, "APP-_S6m1_M_R132_CANOPEN-_11149437_-000_ 180701"),
                (0x6052, Ro, "1529741568"),
                (0x6053, Rw, "PVEA-CI S6"),
            ],
            "pveo-canopen" => [
                (0x100A, Ro, "APP-_S6m1_M_R132_CANOPEN-_11149443_-000_ 180701"),
                (0x6052, Ro, "1529741568"),
                (0x6053, Rw, "PVEO-CI S6"),
            ],
            "hat1000" => [(0x1008, Ro, "HAT 1000"), (0x1009, Ro, "01.01"), (0x100A, Ro, "01.07")],
            _ => [(0x1008, Ro, "HAT 3000"), (0x1009, Ro, "01.01"), (0x100A, Ro, "01.07")],
        }
    }

    /// Every object, sub-index by sub-index.
    fn places(&self) -> BTreeSet<(u16, u8)> {
        let numbers = self.numbers().map(|row| (row.0, row.1));
        let history = EMPTY_HISTORY.1.map(|sub| (EMPTY_HISTORY.0, sub));
        numbers.chain(self.texts().map(|row| (row.0, 0))).chain(history).collect()
    }

    fn indices(&self) -> BTreeSet<u16> {
        self.places().into_iter().map(|(index, _)| index).collect()
    }
}

fn abort(rig: &mut Rig, command: u8, index: u16, sub: u8) -> Option<u32> {
    let answer = rig.sdo(command, index, sub, 0);
    let [command, low, high, answered_sub, code @ ..] = *answer.bytes();
    assert_eq!((u16::from_le_bytes([low, high]), answered_sub), (index, sub), "{answer}");
    (command == 0x80).then(|| u32::from_le_bytes(code))
}

#[test]
fn every_number_reads_its_default_in_its_length() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        for (index, sub, size, _, value) in kind.numbers() {
            let answer = rig.sdo(0x40, index, sub, 0);
            let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
            assert_eq!(answer.data(), [0x43 | (4 - size) << 2, low, high, sub, a, b, c, d], "{index:04X}:{sub}");
        }
    });
}

#[test]
fn every_text_reads_its_default() {
    each_kind(|kind| {
        for (index, _, text) in kind.texts() {
            assert_eq!(kind.booted().read_segmented(index, 0).as_deref(), Ok(text.as_bytes()), "{index:04X}");
        }
    });
}

#[test]
fn the_history_is_there_and_empty() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        for sub in EMPTY_HISTORY.1 {
            assert_eq!(rig.read_abort(0x1003, sub), NO_DATA, "{sub}");
            assert_eq!(rig.write(0x1003, sub, 4, 0), Err(READ_ONLY), "{sub}");
        }
    });
}

#[test]
fn there_is_no_other_index() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        let indices = kind.indices();
        for index in (0..=0xFFFF).filter(|index| !indices.contains(index)) {
            for sub in [0, 1] {
                // upload, expedited download, segmented download
                for command in [0x40, 0x2F, 0x21] {
                    assert_eq!(
                        abort(&mut rig, command, index, sub),
                        Some(NO_OBJECT),
                        "{command:02X} {index:04X}:{sub}"
                    );
                }
            }
        }
    });
}

#[test]
fn there_is_no_other_sub_index() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        let known = kind.places();
        for index in kind.indices() {
            for sub in (0..=255).filter(|sub| !known.contains(&(index, *sub))) {
                for command in [0x40, 0x2F, 0x21] {
                    assert_eq!(abort(&mut rig, command, index, sub), Some(NO_SUB), "{command:02X} {index:04X}:{sub}");
                }
            }
        }
    });
}

#[test]
fn the_data_sheet_lists_every_object_and_no_other() {
    each_kind(|kind| {
        let mut listed = BTreeSet::new();
        describe(kind.setup.kind, |entry, _| _ = listed.insert((entry.object().index, entry.object().sub)))
            .expect("a dictionary");
        assert_eq!(listed, kind.places());
    });
}

#[test]
fn what_is_read_only_cannot_be_written() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        for (index, sub, size, _, value) in kind.numbers().filter(|row| row.3 == Ro) {
            // Not even with the value that it has.
            assert_eq!(rig.write(index, sub, size, value), Err(READ_ONLY), "{index:04X}:{sub}");
            assert_eq!(abort(&mut rig, 0x22, index, sub), Some(READ_ONLY), "{index:04X}:{sub}");
            assert_eq!(abort(&mut rig, 0x20, index, sub), Some(READ_ONLY), "{index:04X}:{sub}");
        }
        for (index, ..) in kind.texts().into_iter().filter(|row| row.1 == Ro) {
            assert_eq!(rig.write(index, 0, 4, 0x3131_3131), Err(READ_ONLY), "{index:04X}");
            assert_eq!(rig.write_segmented(index, 0, b"1111111"), Err(READ_ONLY), "{index:04X}");
        }
    });
}

#[test]
fn a_number_of_another_length_is_refused() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        for (index, sub, its_size, _, value) in kind.numbers().filter(|row| row.3 == Rw) {
            for size in 1..=4 {
                let refused = match size.cmp(&its_size) {
                    Ordering::Less => TOO_SHORT,
                    Ordering::Equal => continue,
                    Ordering::Greater => TOO_LONG,
                };
                assert_eq!(rig.write(index, sub, size, value), Err(refused), "{index:04X}:{sub} in {size} bytes");
            }
        }
        for (index, sub, .., value) in kind.numbers() {
            assert_eq!(rig.read(index, sub), value, "{index:04X}:{sub}");
        }
    });
}

#[test]
fn a_number_can_be_written_with_the_value_that_it_has() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        for (index, sub, size, access, value) in kind.numbers() {
            if access == Rw && !matches!(index, 0x1010 | 0x1011) {
                assert_eq!(rig.write(index, sub, size, value), Ok(()), "{index:04X}:{sub}");
            }
        }
    });
}

#[test]
fn what_an_object_takes_reads_back_and_what_it_refuses_changes_nothing() {
    each_kind(|kind| {
        let mut rig = kind.booted();
        for (index, sub, taken, refused) in if kind.is_sensor() { SENSOR_TAKES } else { VALVE_TAKES } {
            let size = kind.numbers().find(|row| (row.0, row.1) == (*index, *sub)).expect("an object").2;
            for value in *taken {
                assert_eq!(rig.write(*index, *sub, size, *value), Ok(()), "{index:04X}:{sub} := {value:X}");
                // A heartbeat time is followed by a heartbeat.
                rig.take();
                assert_eq!(rig.read(*index, *sub), *value, "{index:04X}:{sub}");
            }
            let before = rig.read(*index, *sub);
            for (code, value) in refused.iter().flat_map(|(code, values)| values.iter().map(move |value| (code, value)))
            {
                let answer = rig.write(*index, *sub, size, *value);
                assert_eq!(answer, Err(*code), "{index:04X}:{sub} := {value:X}: {answer:X?}");
                assert_eq!(rig.read(*index, *sub), before, "{index:04X}:{sub}");
            }
        }
        assert!(rig.writes.len() <= 2, "nothing was stored beyond what a first start stores: {:?}", rig.writes);
    });
}

#[test]
fn four_objects_of_a_sensor_can_be_mapped_and_no_other() {
    each_kind(|kind| {
        if !kind.is_sensor() {
            return;
        }
        let mut rig = kind.booted();
        rig.write_all(&[(0x1A00, 0, 1, 0)]);
        let mut taken = Vec::new();
        let texts = kind.texts().map(|(index, _, text)| (index, 0, u8::try_from(text.len()).unwrap()));
        let errors = EMPTY_HISTORY.1.map(|sub| (EMPTY_HISTORY.0, sub, 4));
        for (index, sub, size) in kind.numbers().map(|row| (row.0, row.1, row.2)).chain(texts).chain(errors) {
            let entry = u32::from(index) << 16 | u32::from(sub) << 8 | u32::from(size * 8);
            match rig.write(0x1A00, 8, 4, entry) {
                Ok(()) => taken.push(entry),
                refused => assert_eq!(refused, Err(NOT_MAPPABLE), "{entry:X}"),
            }
            // In its own length alone.
            for other in [0, 1, 8, 16, 32, 64, 255].map(|bits| entry & !0xFF | bits) {
                if other != entry {
                    assert_eq!(rig.write(0x1A00, 8, 4, other), Err(NOT_MAPPABLE), "{other:X}");
                }
            }
        }
        assert_eq!(taken, [0x1001_0008, 0x1002_0020, 0x6004_0020, 0x6503_0010]);
    });
}
