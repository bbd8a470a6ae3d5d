//! Every object: what it reads, who may write it, what it takes (SPEC 9).

use protocol_core::device::hat::{Kind, Setup};
use protocol_core::device::pve;
use protocol_core::wire::sdo::Multiplexer;
use tests::Rig;

use super::{INVALID, LOAD, SAVE, STATE, booted, booted_as};

const READ_ONLY: Result<(), u32> = Err(0x0601_0002);
const OFF: u32 = 1 << 31;

/// What a row says of an object.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Access {
    Ro,
    Rw,
}
use Access::{Ro, Rw};

/// Index, sub-index, bytes, access, default.
const OBJECTS: &[(u16, u8, u8, Access, u32)] = &[
    (0x1000, 0, 4, Ro, 0x0001_0196),
    (0x1001, 0, 1, Ro, 0),
    (0x1002, 0, 4, Ro, 0),
    (0x1003, 0, 1, Ro, 0),
    (0x1005, 0, 4, Rw, 0x80),
    (0x1010, 0, 1, Ro, 4),
    (0x1010, 1, 4, Rw, 1),
    (0x1010, 2, 4, Rw, 1),
    (0x1010, 3, 4, Rw, 1),
    (0x1010, 4, 4, Rw, 1),
    (0x1011, 0, 1, Ro, 4),
    (0x1011, 1, 4, Rw, 1),
    (0x1011, 2, 4, Rw, 1),
    (0x1011, 3, 4, Rw, 1),
    (0x1011, 4, 4, Rw, 1),
    (0x1014, 0, 4, Rw, 0x81),
    (0x1017, 0, 2, Rw, 0),
    (0x1018, 0, 1, Ro, 4),
    (0x1018, 1, 4, Ro, 0xDA),
    (0x1018, 2, 4, Ro, 925_010),
    (0x1018, 3, 4, Ro, 0x0001_0007),
    (0x1018, 4, 4, Ro, 1),
    (0x1029, 0, 1, Ro, 2),
    (0x1029, 1, 1, Rw, 0),
    (0x1029, 2, 1, Rw, 0),
    (0x1800, 0, 1, Ro, 5),
    (0x1800, 1, 4, Rw, 0x8000_0181),
    (0x1800, 2, 1, Rw, 254),
    (0x1800, 3, 2, Rw, 0),
    (0x1800, 5, 2, Rw, 0),
    (0x1A00, 0, 1, Rw, 1),
    (0x1A00, 1, 4, Rw, 0x6004_0020),
    (0x1A00, 2, 4, Rw, 0),
    (0x1A00, 3, 4, Rw, 0),
    (0x1A00, 4, 4, Rw, 0),
    (0x1A00, 5, 4, Rw, 0),
    (0x1A00, 6, 4, Rw, 0),
    (0x1A00, 7, 4, Rw, 0),
    (0x1A00, 8, 4, Rw, 0),
    (0x1F80, 0, 4, Rw, 0x08),
    (0x2001, 0, 1, Ro, 2),
    (0x2001, 1, 1, Ro, 1),
    (0x2001, 2, 1, Rw, 1),
    (0x2002, 0, 1, Ro, 2),
    (0x2002, 1, 1, Ro, 2),
    (0x2002, 2, 1, Rw, 2),
    (0x6000, 0, 2, Ro, 0),
    (0x6001, 0, 4, Ro, 16_384),
    (0x6002, 0, 4, Ro, 16_384),
    (0x6003, 0, 4, Rw, 0),
    (0x6004, 0, 4, Ro, 0),
    (0x6500, 0, 2, Ro, 0),
    (0x6501, 0, 4, Ro, 16_384),
    (0x6503, 0, 2, Ro, 0),
    (0x6504, 0, 2, Ro, 1),
    (0x6505, 0, 2, Ro, 0),
    (0x6506, 0, 2, Ro, 0),
    (0x6507, 0, 4, Ro, 0x0107_0302),
    (0x6508, 0, 4, Ro, 0xFFFF_FFFF),
    (0x6509, 0, 4, Ro, 0),
    (0x650A, 0, 1, Ro, 3),
    (0x650A, 1, 4, Ro, 0),
    (0x650A, 2, 4, Ro, 0),
    (0x650A, 3, 4, Ro, 16_383),
    (0x650B, 0, 4, Ro, 1),
];

const TEXTS: [(u16, &[u8]); 3] = [(0x1008, b"HAT 1000"), (0x1009, b"01.01"), (0x100A, b"01.07")];

#[test]
fn every_object_of_a_new_sensor() {
    let mut rig = booted();
    for (index, sub, size, access, default) in OBJECTS {
        let answer = rig.sdo(0x40, *index, *sub, 0);
        assert_eq!(answer.bytes()[0], 0x43 | (4 - size) << 2, "the size of {index:04X}:{sub}");
        assert_eq!(rig.read(*index, *sub), *default, "{index:04X}:{sub}");
        if *access == Ro {
            assert_eq!(rig.write(*index, *sub, *size, *default), READ_ONLY, "{index:04X}:{sub}");
        } else if !matches!(index, 0x1010 | 0x1011) {
            assert_eq!(rig.write(*index, *sub, *size, *default), Ok(()), "{index:04X}:{sub}, rewritten");
        }
    }
    for (index, text) in TEXTS {
        assert_eq!(rig.read_segmented(index, 0).as_deref(), Ok(text));
        assert_eq!(rig.write(index, 0, 4, 0), READ_ONLY);
    }
    for sub in 1..=8 {
        assert_eq!(rig.read_abort(0x1003, sub), 0x0800_0024, "no error yet");
    }
}

#[test]
fn what_a_hat_3000_has_different() {
    let mut rig = booted_as(Setup { serial: Some(0x1234_5678), ..Setup::new(Kind::Hat3000) });
    assert_eq!(rig.read_segmented(0x1008, 0).as_deref(), Ok(&b"HAT 3000"[..]));
    assert_eq!(rig.read(0x1018, 2), 925_011);
    assert_eq!((rig.read(0x1018, 4), rig.read(0x650B, 0)), (0x1234_5678, 0x1234_5678));
}

#[test]
fn no_other_object() {
    let mut rig = booted();
    let is_known = |index| OBJECTS.iter().any(|row| row.0 == index) || matches!(index, 0x1008..=0x100A);
    for index in (0x0001..=0xFFFF).filter(|index| !is_known(*index)) {
        assert_eq!(rig.read_abort(index, 0), 0x0602_0000, "{index:04X}");
    }
    for index in OBJECTS.iter().map(|row| row.0) {
        for sub in 0..=255 {
            let known = OBJECTS.iter().any(|row| (row.0, row.1) == (index, sub)) || index == 0x1003 && sub <= 8;
            if !known {
                assert_eq!(rig.read_abort(index, sub), 0x0609_0011, "{index:04X}:{sub}");
            }
        }
    }
    assert!(pve::entry(Multiplexer::new(0x6004, 0)).is_none());
}

#[test]
fn ranges() {
    let mut rig = booted();
    for (index, sub, size, taken, refused, abort) in [
        (
            0x1005,
            0,
            4,
            &[0x81, 0x2000_0000, 0x3FFF_FFFF, 0x80][..],
            &[0x4000_0080, 0x7F, 0x800, 0x181 << 12][..],
            INVALID,
        ),
        (0x1017, 0, 2, &[1, 0xFFFF, 0], &[], INVALID),
        (0x1029, 1, 1, &[1, 2, 0], &[3, 255], INVALID),
        (0x1029, 2, 1, &[1, 2, 0], &[3, 255], INVALID),
        (0x1800, 2, 1, &[0, 1, 240, 255, 254], &[241, 253], INVALID),
        (0x1800, 3, 2, &[1, 0xFFFF, 0], &[], INVALID),
        (0x1800, 5, 2, &[1, 0xFFFF, 0], &[], INVALID),
        (0x1F80, 0, 4, &[0x0C, 0x08], &[0, 4, 0x0D, 0x108], INVALID),
        (0x2001, 2, 1, &[127, 255, 1], &[0, 128, 254], INVALID),
        (0x2002, 2, 1, &[0, 1, 3, 4, 6, 7, 8, 2], &[5, 9, 255], INVALID),
        (0x6003, 0, 4, &[1, 16_383, 0], &[16_384, 0xFFFF_FFFF], Err(0x0609_0031)),
    ] {
        for value in taken {
            assert_eq!(rig.write(index, sub, size, *value), Ok(()), "{index:04X}:{sub} := {value:X}");
            // The heartbeat.
            rig.take();
            assert_eq!(rig.read(index, sub), *value);
        }
        for value in refused {
            assert_eq!(rig.write(index, sub, size, *value), abort, "{index:04X}:{sub} := {value:X}");
            assert_eq!(rig.read(index, sub), *taken.last().unwrap(), "unchanged");
        }
    }
}

#[test]
fn other_signatures_store_nothing() {
    let mut rig = booted();
    rig.writes.clear();
    for sub in 1..=4 {
        for wrong in [0, LOAD, SAVE.swap_bytes()] {
            assert_eq!(rig.write(0x1010, sub, 4, wrong), Err(0x0800_0020));
        }
        for wrong in [0, SAVE, LOAD.swap_bytes()] {
            assert_eq!(rig.write(0x1011, sub, 4, wrong), Err(0x0800_0020));
        }
    }
    assert_eq!(rig.writes, []);
}

#[test]
fn the_cob_id_of_the_emcy() {
    let mut rig = booted();
    // While it is on, the identifier stays.
    assert_eq!(rig.write(0x1014, 0, 4, 0x82), STATE);
    for refused in [0x4000_0081, 0xC000_0081] {
        assert_eq!(rig.write(0x1014, 0, 4, refused), INVALID, "{refused:X}");
    }
    assert_eq!(rig.write(0x1014, 0, 4, OFF | 0x81), Ok(()));
    for refused in [0x7F, 0x581, 0x701, 0x800, 0x0001_0081] {
        assert_eq!(rig.write(0x1014, 0, 4, refused), INVALID, "{refused:X}");
    }
    assert_eq!(rig.write(0x1014, 0, 4, 0x2ABC_DEF0), Ok(()));
    assert_eq!(rig.read(0x1014, 0), 0x2ABC_DEF0);
    assert_eq!(rig.write(0x1014, 0, 4, 0x2ABC_DEF0), Ok(()), "rewritten");
    assert_eq!(rig.write(0x1014, 0, 4, 0x81), STATE);
}

#[test]
fn the_mapping_in_the_order_of_cia_301_only() {
    let mut rig = booted();
    const NOT_MAPPABLE: Result<(), u32> = Err(0x0604_0041);
    const TOO_LONG: Result<(), u32> = Err(0x0604_0042);
    assert_eq!(rig.write(0x1A00, 1, 4, 0x6503_0010), STATE, "sub 0 is not 0");
    assert_eq!(rig.write(0x1A00, 0, 1, 2), NOT_MAPPABLE, "entry 2 maps nothing");
    assert_eq!(rig.write(0x1A00, 0, 1, 9), TOO_LONG);
    assert_eq!(rig.write(0x1A00, 0, 1, 0), Ok(()));
    for dummy in [0x0001_0001, 0x0005_0008, 0x6004_0010, 0x6003_0020, 0x1018_0420, 0x6004_0120] {
        assert_eq!(rig.write(0x1A00, 1, 4, dummy), NOT_MAPPABLE, "{dummy:X}");
    }
    for (sub, entry) in [(1, 0x1001_0008), (2, 0x1002_0020), (3, 0x6503_0010), (4, 0x1001_0008), (5, 0x6004_0020)] {
        assert_eq!(rig.write(0x1A00, sub, 4, entry), Ok(()), "{entry:X}");
    }
    assert_eq!(rig.write(0x1A00, 0, 1, 5), TOO_LONG);
    rig.write_all(&[(0x1A00, 0, 1, 4), (0x1800, 1, 4, 0x181)]);
    assert_eq!(rig.write(0x1A00, 0, 1, 0), STATE, "on");
    assert_eq!(rig.write(0x1800, 3, 2, 1), STATE, "on");
    assert_eq!(rig.write(0x1800, 3, 2, 0), Ok(()), "rewritten");
    assert_eq!(rig.write(0x1800, 1, 4, 0x182), STATE);
}

#[test]
fn four_objects_can_be_mapped_and_no_other() {
    let mut rig = booted();
    assert_eq!(rig.write(0x1A00, 0, 1, 0), Ok(()));
    let mut taken = Vec::new();
    let texts = TEXTS.map(|(index, text)| (index, 0, u8::try_from(text.len()).unwrap()));
    let errors = (1..=8).map(|sub| (0x1003, sub, 4));
    let objects = OBJECTS.iter().map(|row| (row.0, row.1, row.2)).chain(texts).chain(errors);
    for (index, sub, size) in objects {
        let entry = u32::from(index) << 16 | u32::from(sub) << 8 | u32::from(size * 8);
        match rig.write(0x1A00, 8, 4, entry) {
            Ok(()) => taken.push(entry),
            refused => assert_eq!(refused, Err(0x0604_0041), "{entry:X}"),
        }
        // In its own length alone.
        for bits in [0, 1, 8, 16, 32, 64, 255] {
            let other = entry & !0xFF | bits;
            if other != entry {
                assert_eq!(rig.write(0x1A00, 8, 4, other), Err(0x0604_0041), "{other:X}");
            }
        }
    }
    assert_eq!(taken, [0x1001_0008, 0x1002_0020, 0x6004_0020, 0x6503_0010]);
}

#[test]
fn reserved_and_29_bit_identifiers_of_the_pdo() {
    let mut rig = booted();
    for refused in [0x7F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x0001_0181] {
        assert_eq!(rig.write(0x1800, 1, 4, refused), INVALID, "{refused:X}");
        assert_eq!(rig.write(0x1800, 1, 4, refused | OFF), Ok(()), "off: not looked at");
    }
    rig.write_all(&[(0x1800, 1, 4, 0x2000_0181), (0x1800, 2, 1, 1)]);
    rig.exchange("000: 01 00", &[]);
    rig.exchange("080:", &["00000181: 00 00 00 00"]);
}

#[test]
fn what_only_the_valve_has() {
    let mut rig = booted();
    for text in ["1BC788F1: 03 22 10 01", "201: 0F 00 00 00", "181: R4", "080: R0"] {
        rig.exchange(text, &[]);
    }
    assert!(Rig::booted().read_abort(0x6003, 0) == 0x0602_0000);
}
