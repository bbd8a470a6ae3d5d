//! The stored objects of the devices and their defaults: the tables of SPEC 4.5 and 9.

use hal_sim::Kind;
use protocol_core::device::Protocol;

use super::client::Object;

/// Returns the stored objects of a device, record by record.
pub(super) fn groups(kind: Kind) -> Vec<Vec<Object>> {
    let mapping = |index| (0..=8).map(move |sub| (index, sub));
    match (kind, kind.protocol()) {
        (_, Protocol::Isobus) => Vec::new(),
        (Kind::Pve(_), _) => {
            let single = [(0x1005, 0), (0x1017, 0), (0x1028, 1), (0x1400, 1), (0x1400, 2), (0x1800, 1), (0x1800, 2)];
            vec![single.into_iter().chain(mapping(0x1600)).chain(mapping(0x1A00)).chain([(0x6053, 0)]).collect()]
        }
        (Kind::Hat(_), _) => {
            let single = [(0x1005, 0), (0x1014, 0), (0x1017, 0), (0x1029, 1), (0x1029, 2), (0x1F80, 0)];
            let tpdo = [(0x1800, 1), (0x1800, 2), (0x1800, 3), (0x1800, 5)];
            let communication = single.into_iter().chain(tpdo).chain(mapping(0x1A00)).collect();
            vec![communication, vec![(0x6003, 0), (0x6509, 0)]]
        }
    }
}

/// Returns the value of an object after "load", for a device with this node ID.
pub(super) fn default(kind: Kind, node_id: u8, (index, sub): Object) -> Vec<u8> {
    let n = u32::from(node_id);
    let is_valve = matches!(kind, Kind::Pve(_));
    let (value, size): (u32, usize) = match (index, sub) {
        (0x1005, _) => (0x80, 4),
        (0x1014, _) => (0x80 + n, 4),
        (0x1017, _) => (0, 2),
        (0x1028, _) => (0x8000_0000, 4),
        (0x1029, _) => (0, 1),
        (0x1400, 1) => (0x200 + n, 4),
        (0x1400, _) => (0xFF, 1),
        (0x1600 | 0x1A00, 0) => (if is_valve { 2 } else { 1 }, 1),
        (0x1600, 1) => (0x6040_0010, 4),
        (0x1600, 2) => (0x6300_0110, 4),
        (0x1800, 1) => (if is_valve { 0x180 + n } else { 0x8000_0180 + n }, 4),
        (0x1800, 2) => (if is_valve { 0xFF } else { 254 }, 1),
        (0x1800, _) => (0, 2),
        (0x1A00, 1) => (if is_valve { 0x6041_0010 } else { 0x6004_0020 }, 4),
        (0x1A00, 2) if is_valve => (0x6301_0110, 4),
        (0x1600 | 0x1A00, _) if is_valve => (0x0001_0001, 4),
        (0x1A00, _) => (0, 4),
        (0x1F80, _) => (0x08, 4),
        (0x6003 | 0x6509, _) => (0, 4),
        (0x6053, _) => {
            let text = if kind.name().starts_with("pvea") { "PVEA-CI S6" } else { "PVEO-CI S6" };
            return text.into();
        }
        _ => panic!("{index:04X}:{sub} is not stored"),
    };
    value.to_le_bytes()[..size].to_vec()
}
