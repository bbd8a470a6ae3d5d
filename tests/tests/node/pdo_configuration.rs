//! How tools configure a PDO, and a data sheet's defaults written back (SPEC 4.1, 9).

use protocol_core::canopen::dictionary::{Access, Initial, Value};
use protocol_core::device::describe;
use tests::Rig;

use super::kinds::{Kind, each_kind};

const NOT_MAPPABLE: Result<(), u32> = Err(0x0604_0041);
const DEVICE_STATE: Result<(), u32> = Err(0x0800_0022);
const OFF: u32 = 1 << 31;

/// A PDO, with a mapping that is longer than its default.
struct Pdo {
    communication: u16,
    /// Without the node ID.
    cob_id: u32,
    entries: &'static [u32],
}

const VALVE: &[Pdo] = &[
    Pdo { communication: 0x1400, cob_id: 0x200, entries: &[0x6042_0008, 0x6040_0010, 0x6300_0110] },
    Pdo { communication: 0x1800, cob_id: 0x180, entries: &[0x3301_0008, 0x6041_0010, 0x6301_0110] },
];
const SENSOR: &[Pdo] =
    &[Pdo { communication: 0x1800, cob_id: 0x180, entries: &[0x6004_0020, 0x6503_0010, 0x1001_0008] }];

/// A node of each kind, with each of its PDOs and the COB-ID of that.
fn each(check: impl Fn(&mut Rig, &Pdo, u32)) {
    each_kind(|kind| {
        for pdo in if kind.is_sensor() { SENSOR } else { VALVE } {
            check(&mut kind.booted(), pdo, pdo.cob_id + u32::from(kind.node_id));
        }
    });
}

/// PDO off, number 0, all entries 0, the new entries, their number, PDO on: as gocanopen does it.
fn configure(rig: &mut Rig, pdo: &Pdo, cob_id: u32, entries: &[u32]) {
    let mapping = pdo.communication + 0x200;
    let count = u32::try_from(entries.len()).expect("a few");
    rig.write_all(&[(pdo.communication, 1, 4, cob_id | OFF), (mapping, 0, 1, 0)]);
    (1..=8).for_each(|sub| rig.write_all(&[(mapping, sub, 4, 0)]));
    (1..).zip(entries).for_each(|(sub, entry)| rig.write_all(&[(mapping, sub, 4, *entry)]));
    rig.write_all(&[(mapping, 0, 1, count), (pdo.communication, 1, 4, cob_id)]);
}

/// What the mapping reads: the number, and all entries.
fn mapping(rig: &mut Rig, pdo: &Pdo) -> Vec<u32> {
    (0..=8).map(|sub| rig.read(pdo.communication + 0x200, sub)).collect()
}

#[test]
fn all_entries_0_and_then_the_new_ones() {
    each(|rig, pdo, cob_id| {
        for entries in [pdo.entries, &pdo.entries[1..2], pdo.entries] {
            configure(rig, pdo, cob_id, entries);
            let mut expected = vec![u32::try_from(entries.len()).expect("a few")];
            expected.extend(entries);
            expected.resize(9, 0);
            assert_eq!(mapping(rig, pdo), expected);
            // "save" keeps it, the unused entries included.
            rig.save(1);
            rig.start_anew();
            assert_eq!((mapping(rig, pdo), rig.read(pdo.communication, 1)), (expected, cob_id));
        }
    });
}

#[test]
fn the_pdo_that_was_configured_so_works() {
    each(|rig, pdo, cob_id| {
        configure(rig, pdo, cob_id, pdo.entries);
        rig.send("000: 01 00");
        if pdo.communication == 0x1400 {
            rig.send("220: 02 01 00 00 40");
            assert_eq!((rig.take().len(), rig.read(0x6042, 0), rig.read(0x6300, 1)), (1, 2, 0x4000));
        } else {
            rig.write_all(&[(0x1800, 2, 1, 1)]);
            rig.send("080:");
            let sent = rig.take();
            let bits: u32 = pdo.entries.iter().map(|entry| entry & 0xFF).sum();
            assert!(sent.len() == 1 && sent[0].starts_with(&format!("{cob_id:03X}:")), "{sent:?}");
            assert_eq!(sent[0].split(' ').count() - 1, bits as usize / 8, "{sent:?}");
        }
    });
}

#[test]
fn an_entry_of_0_is_not_counted_in() {
    each(|rig, pdo, cob_id| {
        let mapping = pdo.communication + 0x200;
        configure(rig, pdo, cob_id, &pdo.entries[..1]);
        assert_eq!(rig.write(mapping, 8, 4, 0), Ok(()), "as it is");
        rig.write_all(&[(pdo.communication, 1, 4, cob_id | OFF)]);
        assert_eq!(rig.write(mapping, 0, 1, 2), NOT_MAPPABLE);
        assert_eq!(rig.write(mapping, 1, 4, 0), NOT_MAPPABLE, "it is counted");
        assert_eq!(rig.write(mapping, 8, 4, 0x0000_0008), NOT_MAPPABLE, "a length");
        assert_eq!(rig.write(mapping, 8, 4, 0x0000_0100), NOT_MAPPABLE, "a sub-index");
        assert_eq!(rig.read(mapping, 0), 1);
        // The others can be made unused while some are counted.
        rig.write_all(&[(mapping, 0, 1, 0), (mapping, 2, 4, pdo.entries[1]), (mapping, 0, 1, 1), (mapping, 2, 4, 0)]);
        rig.write_all(&[(mapping, 0, 1, 0), (mapping, 2, 4, pdo.entries[1]), (pdo.communication, 1, 4, OFF)]);
        rig.write_all(&[(mapping, 0, 1, 1), (pdo.communication, 1, 4, cob_id)]);
        assert_eq!(rig.write(mapping, 2, 4, 0), DEVICE_STATE, "the PDO is on");
        assert_eq!(rig.read(mapping, 2), pdo.entries[1]);
    });
}

/// What a client can write of a new node, in the order of its data sheet: index, sub-index, size, default.
fn defaults(kind: &Kind) -> Vec<(u16, u8, u8, u32)> {
    let mut rows = Vec::new();
    describe(kind.setup.kind, |entry, initial| {
        let object = entry.object();
        let value = match initial {
            Initial::Fixed(Value::Number(number)) => number,
            Initial::NodeIdPlus(base) => base + u32::from(kind.node_id),
            _ => return,
        };
        if entry.access() == Access::Rw && !matches!(object.index, 0x1010 | 0x1011) {
            rows.push((object.index, object.sub, entry.size(), value));
        }
    })
    .expect("a dictionary");
    rows
}

/// As a DCF is loaded: in the order of the sheet, into a new node and into one that maps more by default.
#[test]
fn the_data_sheets_defaults_in_its_order() {
    each_kind(|kind| {
        let rows = defaults(kind);
        assert!(rows.iter().any(|row| row.0 == 0x1A00 && row.1 == 8), "{rows:X?}");
        let mut node = kind.booted();
        node.write_all(&rows);
        if kind.is_sensor() {
            let [pdo] = SENSOR else { panic!("one PDO") };
            configure(&mut node, pdo, pdo.cob_id + u32::from(kind.node_id), pdo.entries);
            node.write_all(&rows);
        }
        for (index, sub, _, value) in rows {
            assert_eq!(node.read(index, sub), value, "{index:04X}:{sub}");
        }
    });
}
