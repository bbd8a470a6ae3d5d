//! How tools configure a PDO of any kind on CANopen, and a data sheet's defaults written back (SPEC 4.1, 9).

use std::collections::BTreeMap;

use protocol_core::canopen::dictionary::{Access, Initial, Value};
use protocol_core::device::{Kind, Protocol, Setup, describe};
use tests::Rig;

const NOT_MAPPABLE: Result<(), u32> = Err(0x0604_0041);
const DEVICE_STATE: Result<(), u32> = Err(0x0800_0022);
const OFF: u32 = 1 << 31;

/// Mappings of a product that are longer than its default.
struct Product {
    kinds: [&'static str; 2],
    node_id: u32,
    pdos: &'static [Pdo],
}

struct Pdo {
    communication: u16,
    /// Without the node ID.
    cob_id: u32,
    entries: &'static [u32],
}

const PRODUCTS: [Product; 2] = [
    Product {
        kinds: ["pvea-canopen", "pveo-canopen"],
        node_id: 0x20,
        pdos: &[
            Pdo { communication: 0x1400, cob_id: 0x200, entries: &[0x6042_0008, 0x6040_0010, 0x6300_0110] },
            Pdo { communication: 0x1800, cob_id: 0x180, entries: &[0x3301_0008, 0x6041_0010, 0x6301_0110] },
        ],
    },
    Product {
        kinds: ["hat1000", "hat3000"],
        node_id: 1,
        pdos: &[Pdo { communication: 0x1800, cob_id: 0x180, entries: &[0x6004_0020, 0x6503_0010, 0x1001_0008] }],
    },
];

fn booted(kind: Kind) -> Rig {
    let mut rig = Rig::power_on(Setup::<Kind>::new(kind));
    rig.take();
    rig
}

/// A device of each kind on CANopen, with each of its PDOs.
fn each(mut check: impl FnMut(&mut Rig, &Pdo, u32)) {
    let mut kinds = 0;
    for kind in Kind::ALL.into_iter().filter(|kind| kind.protocol() == Protocol::Canopen) {
        let product = PRODUCTS.iter().find(|product| product.kinds.contains(&kind.name())).expect("listed");
        for pdo in product.pdos {
            check(&mut booted(kind), pdo, pdo.cob_id + product.node_id);
        }
        kinds += 1;
    }
    assert_eq!(kinds, 4);
}

#[track_caller]
fn write_all(rig: &mut Rig, steps: impl IntoIterator<Item = (u16, u8, u8, u32)>) {
    for (index, sub, size, value) in steps {
        assert_eq!(rig.write(index, sub, size, value), Ok(()), "{index:04X}:{sub} := {value:X}");
    }
}

/// PDO off, number 0, all entries 0, the new entries, their number, PDO on: as gocanopen does it.
fn configure(rig: &mut Rig, pdo: &Pdo, cob_id: u32, entries: &[u32]) {
    let mapping = pdo.communication + 0x200;
    let count = u32::try_from(entries.len()).expect("a few");
    write_all(rig, [(pdo.communication, 1, 4, cob_id | OFF), (mapping, 0, 1, 0)]);
    write_all(rig, (1..=8).map(|sub| (mapping, sub, 4, 0)));
    write_all(rig, (1..).zip(entries).map(|(sub, entry)| (mapping, sub, 4, *entry)));
    write_all(rig, [(mapping, 0, 1, count), (pdo.communication, 1, 4, cob_id)]);
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
            write_all(rig, [(0x1010, 1, 4, u32::from_le_bytes(*b"save"))]);
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
            write_all(rig, [(0x1800, 2, 1, 1)]);
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
        write_all(rig, [(pdo.communication, 1, 4, cob_id | OFF)]);
        assert_eq!(rig.write(mapping, 0, 1, 2), NOT_MAPPABLE);
        assert_eq!(rig.write(mapping, 1, 4, 0), NOT_MAPPABLE, "it is counted");
        assert_eq!(rig.write(mapping, 8, 4, 0x0000_0008), NOT_MAPPABLE, "a length");
        assert_eq!(rig.write(mapping, 8, 4, 0x0000_0100), NOT_MAPPABLE, "a sub-index");
        assert_eq!(rig.read(mapping, 0), 1);
        // The others can be made unused while some are counted.
        write_all(rig, [(mapping, 0, 1, 0), (mapping, 2, 4, pdo.entries[1]), (mapping, 0, 1, 1), (mapping, 2, 4, 0)]);
        write_all(rig, [(mapping, 0, 1, 0), (mapping, 2, 4, pdo.entries[1]), (pdo.communication, 1, 4, OFF)]);
        write_all(rig, [(mapping, 0, 1, 1), (pdo.communication, 1, 4, cob_id)]);
        assert_eq!(rig.write(mapping, 2, 4, 0), DEVICE_STATE, "the PDO is on");
        assert_eq!(rig.read(mapping, 2), pdo.entries[1]);
    });
}

/// What a client can write of a new device, in the order of its data sheet: index, sub-index, size, default.
fn defaults(kind: Kind, node_id: u32) -> Vec<(u16, u8, u8, u32)> {
    let mut rows = Vec::new();
    describe(kind, |entry, initial| {
        let object = entry.object();
        let value = match initial {
            Initial::Fixed(Value::Number(number)) => number,
            Initial::NodeIdPlus(base) => base + node_id,
            _ => return,
        };
        if entry.access() == Access::Rw && !matches!(object.index, 0x1010 | 0x1011) {
            rows.push((object.index, object.sub, entry.size(), value));
        }
    })
    .expect("a dictionary");
    rows
}

/// As a DCF is loaded: in the order of the sheet, into a new device and into one that maps more by default.
#[test]
fn the_data_sheets_defaults_in_its_order() {
    for product in &PRODUCTS {
        for kind in product.kinds.map(|name| Kind::from_name(name).expect("a kind")) {
            let rows = defaults(kind, product.node_id);
            assert!(rows.iter().any(|row| row.0 == 0x1A00 && row.1 == 8), "{rows:X?}");
            let mut rig = booted(kind);
            write_all(&mut rig, rows.clone());
            for pdo in product.pdos.iter().filter(|pdo| pdo.entries[0] == 0x6004_0020) {
                configure(&mut rig, pdo, pdo.cob_id + product.node_id, pdo.entries);
                write_all(&mut rig, rows.clone());
            }
            for (index, sub, _, value) in rows {
                assert_eq!(rig.read(index, sub), value, "{kind}: {index:04X}:{sub}");
            }
        }
    }
}

/// In the order of CiA 301, whatever was mapped before.
#[test]
fn the_data_sheets_defaults_of_a_mapping_in_the_order_of_cia_301() {
    for product in &PRODUCTS {
        for kind in product.kinds.map(|name| Kind::from_name(name).expect("a kind")) {
            let rows: BTreeMap<_, _> = defaults(kind, product.node_id)
                .into_iter()
                .map(|(index, sub, _, value)| ((index, sub), value))
                .collect();
            let mut rig = booted(kind);
            for pdo in product.pdos {
                let (communication, mapping) = (pdo.communication, pdo.communication + 0x200);
                let cob_id = pdo.cob_id + product.node_id;
                configure(&mut rig, pdo, cob_id, &pdo.entries.iter().rev().copied().collect::<Vec<_>>());
                write_all(&mut rig, [(communication, 1, 4, cob_id | OFF), (mapping, 0, 1, 0)]);
                write_all(&mut rig, (1..=8).map(|sub| (mapping, sub, 4, rows[&(mapping, sub)])));
                write_all(&mut rig, [(mapping, 0, 1, rows[&(mapping, 0)])]);
                write_all(&mut rig, [(communication, 1, 4, rows[&(communication, 1)])]);
                for sub in 0..=8 {
                    assert_eq!(rig.read(mapping, sub), rows[&(mapping, sub)], "{kind}: {mapping:04X}:{sub}");
                }
            }
        }
    }
}
