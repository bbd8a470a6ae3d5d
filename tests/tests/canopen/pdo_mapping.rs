//! PDO mapping: the two procedures, dummies bit by bit, and what is refused when (SPEC 4.1).

use tests::Rig;

const NOT_MAPPABLE: u32 = 0x0604_0041;
const TOO_MANY_BITS: u32 = 0x0604_0042;
const DEVICE_STATE: u32 = 0x0800_0022;

const RPDO: u16 = 0x1400;
const TPDO: u16 = 0x1800;
const RPDO_MAPPING: u16 = 0x1600;
const TPDO_MAPPING: u16 = 0x1A00;

const RPDO_OFF: u32 = 0x8000_0220;
const RPDO_ON: u32 = 0x0000_0220;
const TPDO_OFF: u32 = 0x8000_01A0;
const TPDO_ON: u32 = 0x0000_01A0;

/// What goes into which PDO, with its length.
const INTO_RPDO: [u32; 5] = [0x6040_0010, 0x3300_0008, 0x3303_0010, 0x6042_0008, 0x6300_0110];
const INTO_TPDO: [u32; 5] = [0x6041_0010, 0x3301_0008, 0x3302_0008, 0x3304_0010, 0x6301_0110];
/// Dummies: the data types of CiA 301, each in its length.
const DUMMIES: [u32; 7] = [0x0001_0001, 0x0002_0008, 0x0003_0010, 0x0004_0020, 0x0005_0008, 0x0006_0010, 0x0007_0020];

/// Both PDOs off.
fn off() -> Rig {
    let mut rig = Rig::booted();
    rig.write_all(&[(RPDO, 1, 4, RPDO_OFF), (TPDO, 1, 4, TPDO_OFF)]);
    rig
}

/// An operational valve in ACTIVE whose spool was moved to 0x1000.
fn moved() -> Rig {
    let mut rig = Rig::active();
    rig.send("220: 0F 00 00 10");
    rig.advance(100);
    rig.expect("1A0: 0F 00 00 00");
    rig.exchange("220: 0F 00 00 10", &["1A0: 0F 00 00 10"]);
    rig
}

/// PDO off, number 0, number n, entries, PDO on.
#[test]
fn the_manuals_procedure() {
    let mut rig = Rig::booted();
    rig.exchange("620: 23 00 14 01 20 02 00 80", &["5A0: 60 00 14 01 00 00 00 00"]);
    rig.exchange("620: 2F 00 16 00 00 00 00 00", &["5A0: 60 00 16 00 00 00 00 00"]);
    rig.exchange("620: 2F 00 16 00 03 00 00 00", &["5A0: 60 00 16 00 00 00 00 00"]);
    rig.exchange("620: 23 00 16 01 08 00 42 60", &["5A0: 60 00 16 01 00 00 00 00"]);
    rig.exchange("620: 23 00 16 02 10 00 40 60", &["5A0: 60 00 16 02 00 00 00 00"]);
    rig.exchange("620: 23 00 16 03 08 00 00 33", &["5A0: 60 00 16 03 00 00 00 00"]);
    rig.exchange("620: 23 00 14 01 20 02 00 00", &["5A0: 60 00 14 01 00 00 00 00"]);
    rig.exchange("000: 01 00", &[]);
    rig.exchange("220: 02 01 00 7F", &["1A0: 09 00 00 00"]);
    assert_eq!((rig.read(0x6042, 0), rig.read(0x6300, 1)), (2, 0x4000));
}

/// PDO off, number 0, entries, number n, PDO on.
#[test]
fn the_procedure_of_cia_301() {
    let mut rig = moved();
    rig.write_all(&[
        (TPDO, 1, 4, TPDO_OFF),
        (TPDO_MAPPING, 0, 1, 0),
        (TPDO_MAPPING, 1, 4, 0x3301_0008),
        (TPDO_MAPPING, 2, 4, 0x3302_0008),
        (TPDO_MAPPING, 3, 4, 0x3304_0010),
        (TPDO_MAPPING, 4, 4, 0x6301_0110),
        (TPDO_MAPPING, 5, 4, 0x6041_0010),
        (TPDO_MAPPING, 0, 1, 5),
        (TPDO, 1, 4, TPDO_ON),
    ]);
    rig.exchange("220: 0F 00 00 10", &["1A0: 20 E0 FA 00 00 10 0F 00"]);
}

#[test]
fn every_entry_reads_back() {
    let mut rig = off();
    for (mapping, objects) in [(RPDO_MAPPING, INTO_RPDO), (TPDO_MAPPING, INTO_TPDO)] {
        for sub in 1..=8 {
            for entry in objects.into_iter().chain(DUMMIES) {
                assert_eq!(rig.write(mapping, sub, 4, entry), Ok(()), "{mapping:04X}:{sub} := {entry:08X}");
                assert_eq!(rig.read(mapping, sub), entry);
            }
        }
    }
}

#[test]
fn what_cannot_be_mapped() {
    let neither = [
        // no such object
        0x0000_0000,
        0x0000_0008,
        0x0008_0008,
        0x001B_0040,
        0x6043_0010,
        0x7FFF_0010,
        0xFFFF_FFFF,
        // no such sub-index
        0x6040_0110,
        0x3300_0108,
        0x6300_0210,
        0x6301_0210,
        0x6041_FF10,
        // neither goes into a PDO
        0x1000_0020,
        0x1001_0008,
        0x1017_0010,
        0x2001_0008,
        0x6053_0008,
        0x605F_0020,
        0x6300_0008,
        0x6301_0008,
        // another length
        0x6040_0008,
        0x6040_0011,
        0x6040_0020,
        0x6040_0000,
        0x6041_0008,
        0x3300_0010,
        0x3301_0007,
        0x3302_0010,
        0x3303_0008,
        0x3304_0020,
        0x6042_0010,
        0x6300_010F,
        0x6301_0120,
        0x0001_0008,
        0x0002_0001,
        0x0005_0010,
        0x0004_0008,
        0x0007_0040,
        0x0001_0000,
    ];
    let mut rig = off();
    for (mapping, other_way) in [(RPDO_MAPPING, INTO_TPDO), (TPDO_MAPPING, INTO_RPDO)] {
        for entry in neither.into_iter().chain(other_way) {
            assert_eq!(rig.write(mapping, 1, 4, entry), Err(NOT_MAPPABLE), "{mapping:04X} := {entry:08X}");
        }
        assert_eq!(rig.read(mapping, 1) & 0xFFFF, 0x0010, "the entry stays");
    }
}

#[test]
fn the_number_of_entries_is_8_at_the_most() {
    let mut rig = off();
    for mapping in [RPDO_MAPPING, TPDO_MAPPING] {
        for count in [9, 0x10, 0x7F, 0xFE, 0xFF] {
            assert_eq!(rig.write(mapping, 0, 1, count), Err(TOO_MANY_BITS), "{count}");
        }
        for count in 0..=8 {
            assert_eq!(rig.write(mapping, 0, 1, count), Ok(()), "{count}");
            assert_eq!(rig.read(mapping, 0), count);
        }
    }
}

#[test]
fn the_bits_are_counted_when_the_number_is_written() {
    for (mapping, word, byte) in [(RPDO_MAPPING, 0x6300_0110, 0x3300_0008), (TPDO_MAPPING, 0x6301_0110, 0x3302_0008)] {
        let mut rig = off();
        for sub in 1..=3 {
            assert_eq!(rig.write(mapping, sub, 4, word), Ok(()));
        }
        rig.write_all(&[(mapping, 4, 4, byte), (mapping, 5, 4, 0x0002_0008), (mapping, 6, 4, 0x0001_0001)]);
        // 48, 56 and 64 bits
        for count in [3, 4, 5] {
            assert_eq!(rig.write(mapping, 0, 1, count), Ok(()), "{count}");
        }
        // 65 bits; the number stays
        assert_eq!(rig.write(mapping, 0, 1, 6), Err(TOO_MANY_BITS));
        assert_eq!(rig.write(mapping, 0, 1, 8), Err(TOO_MANY_BITS));
        assert_eq!(rig.read(mapping, 0), 5);
    }
}

#[test]
fn the_bits_are_counted_again_when_the_pdo_is_switched_on() {
    for (communication, mapping, on, wide) in
        [(RPDO, RPDO_MAPPING, RPDO_ON, 0x6300_0110), (TPDO, TPDO_MAPPING, TPDO_ON, 0x6301_0110)]
    {
        let mut rig = off();
        // In the manual's order, the entries come after the number.
        assert_eq!(rig.write(mapping, 0, 1, 5), Ok(()));
        for sub in 1..=5 {
            assert_eq!(rig.write(mapping, sub, 4, wide), Ok(()));
        }
        assert_eq!(rig.write(communication, 1, 4, on), Err(TOO_MANY_BITS));
        assert_eq!(rig.read(communication, 1), on | 0x8000_0000, "it stays off");
        // The number that is held can be written, whatever it counts.
        rig.write_all(&[(mapping, 0, 1, 5), (mapping, 0, 1, 4), (communication, 1, 4, on)]);
    }
}

#[test]
fn nothing_of_it_changes_while_the_pdo_is_on() {
    let mut rig = Rig::booted();
    for (communication, mapping, on, entry) in
        [(RPDO, RPDO_MAPPING, RPDO_ON, 0x3300_0008), (TPDO, TPDO_MAPPING, TPDO_ON, 0x3301_0008)]
    {
        for count in [0, 1, 3, 8] {
            assert_eq!(rig.write(mapping, 0, 1, count), Err(DEVICE_STATE), "{count}");
        }
        for sub in 1..=8 {
            assert_eq!(rig.write(mapping, sub, 4, entry), Err(DEVICE_STATE), "{sub}");
        }
        assert_eq!(rig.write(communication, 1, 4, on + 1), Err(DEVICE_STATE));
        // What is held already can be written.
        for sub in 0..=8 {
            let (size, value) = (if sub == 0 { 1 } else { 4 }, rig.read(mapping, sub));
            assert_eq!(rig.write(mapping, sub, size, value), Ok(()), "{sub}");
        }
        assert_eq!(rig.write(communication, 1, 4, on), Ok(()));
    }
}

#[test]
fn as_many_bytes_as_the_bits_need() {
    let status = 0x6041_0010;
    let dummy = |bits: u32| match bits {
        1 => DUMMIES[0],
        8 => DUMMIES[4],
        16 => DUMMIES[5],
        _ => DUMMIES[6],
    };
    for (gaps, data) in [
        (&[][..], "0F 00"),
        (&[1], "0F 00 00"),
        (&[1; 7], "0F 00 00"),
        (&[8], "0F 00 00"),
        (&[8, 1], "0F 00 00 00"),
        (&[16], "0F 00 00 00"),
        (&[32], "0F 00 00 00 00 00"),
        (&[32, 16], "0F 00 00 00 00 00 00 00"),
    ] {
        let mut rig = moved();
        let entries: Vec<u32> = [status].into_iter().chain(gaps.iter().map(|bits| dummy(*bits))).collect();
        rig.map(TPDO, &entries);
        rig.exchange("220: 0F 00 00 10", &[&format!("1A0: {data}")]);
    }
}

/// The default entries 3–8 are six gaps of one bit: all eight are 38 bits.
#[test]
fn the_default_entries_all_counted() {
    let mut rig = Rig::booted();
    for (communication, mapping, on) in [(RPDO, RPDO_MAPPING, RPDO_ON), (TPDO, TPDO_MAPPING, TPDO_ON)] {
        rig.write_all(&[(communication, 1, 4, on | 0x8000_0000), (mapping, 0, 1, 8), (communication, 1, 4, on)]);
    }
    rig.silent_to(&["000: 01 00", "220: 0F 00 00 00"]);
    rig.exchange("220: 0F 00 00 00 FF", &["1A0: 09 00 00 00 00"]);
}

#[test]
fn a_tpdo_packs_bit_by_bit() {
    let mut rig = moved();
    // 1 bit, status in 16, 1 bit, 8 bits of value, 1 bit, 16 bits of value: 43 bits
    rig.map(TPDO, &[DUMMIES[0], 0x6041_0010, DUMMIES[0], 0x3302_0008, DUMMIES[0], 0x6301_0110]);
    let bits: u64 = 0x000F << 1 | 0xE0 << 18 | 0x1000 << 27;
    let bytes: Vec<String> = bits.to_le_bytes()[..6].iter().map(|byte| format!("{byte:02X}")).collect();
    rig.exchange("220: 0F 00 00 10", &[&format!("1A0: {}", bytes.join(" "))]);
    // Seven gaps push a value over two bytes.
    rig.map(TPDO, &[DUMMIES[0], DUMMIES[0], DUMMIES[0], DUMMIES[0], DUMMIES[0], DUMMIES[0], DUMMIES[0], 0x3301_0008]);
    rig.exchange("220: 0F 00 00 10", &["1A0: 00 10"]);
}

#[test]
fn an_rpdo_unpacks_bit_by_bit() {
    let mut rig = Rig::booted();
    // 1 bit, control word, 1 bit, set-point, 8 bits, mode: 50 bits
    rig.map(RPDO, &[DUMMIES[0], 0x6040_0010, DUMMIES[0], 0x6300_0110, DUMMIES[1], 0x6042_0008]);
    rig.exchange("000: 01 00", &[]);
    // Everything that is a gap is set.
    let bits: u64 = 1 | 0xA001 << 1 | 1 << 17 | 0xC000 << 18 | 0xFF << 34 | 2 << 42 | 0x3FFF << 50;
    let bytes: Vec<String> = bits.to_le_bytes().iter().map(|byte| format!("{byte:02X}")).collect();
    rig.exchange(&format!("220: {}", bytes.join(" ")), &["1A0: 09 00 00 00"]);
    assert_eq!((rig.read(0x6040, 0), rig.read(0x6300, 1), rig.read(0x6042, 0)), (0xA001, 0xC000, 2));
    // 50 bits are seven bytes: six are too short.
    rig.exchange(&format!("220: {}", bytes[..6].join(" ")), &[]);
    rig.exchange(&format!("220: {}", bytes[..7].join(" ")), &["1A0: 09 00 00 00"]);
}

#[test]
fn an_rpdo_of_gaps_alone_still_brings_a_tpdo() {
    let mut rig = Rig::booted();
    rig.map(RPDO, &[DUMMIES[4]]);
    rig.silent_to(&["000: 01 00", "220:"]);
    rig.exchange("220: FF", &["1A0: 08 00 00 00"]);
    assert_eq!(rig.read(0x6040, 0), 0);
}
