//! The payloads of valve records other than the parameters (SPEC 6).

use super::{Kind, Setup};
use crate::actuator::Counters;
use crate::controller::BitRate;
use crate::wire::lss;

/// The payload version of every record.
pub(super) const VERSION: u8 = 1;

/// The factory data. They are written at the first start, and no restore changes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Factory {
    /// The identity object, which is the LSS address.
    pub(super) identity: lss::Address,
    /// The function instance of the NAME, for the ISOBUS kinds.
    pub(super) function_instance: u8,
    pub(super) hardware_number: u32,
    /// The hardware version: four characters, padded with blanks on the right.
    pub(super) hardware_version: [u8; 4],
    pub(super) software_number: u32,
    /// The software version: four characters, padded with blanks on the right.
    pub(super) software_version: [u8; 4],
    /// The manufacturing date: year, month and day in BCD.
    pub(super) manufactured: [u8; 3],
}

/// The vendor ID of Danfoss.
const VENDOR: u32 = 0x0100_0019;
/// The product code.
const PRODUCT: u32 = 0x5336_0000;
/// The revision number of R1.32: major number in the high word, minor number in the low word. (R) The manual calls it
/// BCD, but its example is not.
const REVISION: u32 = 0x0001_0020;
/// The hardware version (A).
const HARDWARE_VERSION: [u8; 4] = *b"1.00";
/// The software version (A), the same as in the revision number.
const SOFTWARE_VERSION: [u8; 4] = *b"1.32";
/// The manufacturing date (A), the same as the firmware date in 0x100A.
const MANUFACTURED: [u8; 3] = [0x18, 0x07, 0x01];

impl Factory {
    /// The placeholder until a start reads the memory.
    pub(super) const UNREAD: Self = Self {
        identity: lss::Address { vendor: 0, product: 0, revision: 0, serial: 0 },
        function_instance: 0,
        hardware_number: 0,
        hardware_version: [0; 4],
        software_number: 0,
        software_version: [0; 4],
        manufactured: [0; 3],
    };

    /// Returns the factory data of a new memory.
    pub(super) fn new(kind: Kind, serial: Option<u32>) -> Self {
        Self {
            identity: lss::Address {
                vendor: VENDOR,
                product: PRODUCT,
                revision: REVISION,
                serial: serial.unwrap_or(kind.default_serial()),
            },
            function_instance: 1,
            hardware_number: kind.part_number(),
            hardware_version: HARDWARE_VERSION,
            software_number: kind.part_number(),
            software_version: SOFTWARE_VERSION,
            manufactured: MANUFACTURED,
        }
    }

    pub(super) fn encode(&self) -> [u8; 36] {
        let Self { identity, hardware_version, software_version, manufactured: [year, month, day], .. } = *self;
        let fields: [[u8; 4]; 9] = [
            identity.vendor.to_le_bytes(),
            identity.product.to_le_bytes(),
            identity.revision.to_le_bytes(),
            identity.serial.to_le_bytes(),
            self.hardware_number.to_le_bytes(),
            self.software_number.to_le_bytes(),
            hardware_version,
            software_version,
            [year, month, day, self.function_instance],
        ];
        let mut payload = [0; 36];
        payload.copy_from_slice(fields.as_flattened());
        payload
    }

    pub(super) fn decode(payload: &[u8]) -> Option<Self> {
        let (
            &[
                vendor,
                product,
                revision,
                serial,
                hardware_number,
                software_number,
                hardware_version,
                software_version,
                [year, month, day, function_instance],
            ],
            [],
        ) = payload.as_chunks()
        else {
            return None;
        };
        Some(Self {
            identity: lss::Address {
                vendor: u32::from_le_bytes(vendor),
                product: u32::from_le_bytes(product),
                revision: u32::from_le_bytes(revision),
                serial: u32::from_le_bytes(serial),
            },
            function_instance,
            hardware_number: u32::from_le_bytes(hardware_number),
            hardware_version,
            software_number: u32::from_le_bytes(software_number),
            software_version,
            manufactured: [year, month, day],
        })
    }
}

/// The stored node ID and bit rate. On ISOBUS the node ID is the address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LocalLayer {
    /// The node ID or address; `None` only for a valve that was delivered without a node ID.
    pub(super) node_id: Option<u8>,
    pub(super) bit_rate: BitRate,
}

impl LocalLayer {
    /// The placeholder until a start reads the memory.
    pub(super) const UNREAD: Self = Self { node_id: None, bit_rate: BitRate::Kbit250 };

    /// Returns the local layer of a new memory.
    pub(super) fn new(Setup { kind, node_id, bit_rate, .. }: Setup) -> Self {
        let default = kind.bit_rates().first().copied().unwrap_or(BitRate::Kbit250);
        let bit_rate = bit_rate.filter(|rate| kind.bit_rates().contains(rate)).unwrap_or(default);
        Self { node_id: node_id.filter(|node_id| kind.node_ids().contains(node_id)), bit_rate }
    }

    pub(super) fn encode(self) -> [u8; 2] {
        [self.node_id.unwrap_or(lss::NO_NODE_ID), self.bit_rate.table_index()]
    }

    pub(super) fn decode(kind: Kind, payload: &[u8]) -> Option<Self> {
        let &[node_id, index] = payload else { return None };
        let node_id = if node_id == lss::NO_NODE_ID {
            None
        } else {
            Some(node_id).filter(|node_id| kind.node_ids().contains(node_id)).map(Some)?
        };
        let bit_rate = BitRate::from_table_index(index).filter(|rate| kind.bit_rates().contains(rate))?;
        Some(Self { node_id, bit_rate })
    }
}

pub(super) const fn encode_flag(set: bool) -> [u8; 1] {
    [set as u8]
}

pub(super) fn decode_flag(payload: &[u8]) -> Option<bool> {
    match payload {
        [0] => Some(false),
        [1] => Some(true),
        _ => None,
    }
}

/// The fault log, which holds the occurrence counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FaultLog {
    pub(super) counters: Counters,
}

/// The last byte of a fault log. Earlier versions stored the previously active faults there.
const RESERVED: u8 = 0;

impl FaultLog {
    pub(super) fn encode(self) -> [u8; 9] {
        let mut payload = [RESERVED; 9];
        if let Some(counters) = payload.first_chunk_mut() {
            *counters = self.counters.to_bytes();
        }
        payload
    }

    pub(super) fn decode(payload: &[u8]) -> Option<Self> {
        let (counters, &[_]) = payload.split_first_chunk()? else { return None };
        Some(Self { counters: Counters::from_bytes(*counters) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_as_they_were() {
        let factory = Factory::new(Kind::PveoCanopen, Some(7));
        assert_eq!(Factory::decode(&factory.encode()), Some(factory));
        assert_eq!(Factory::decode(&[0; 35]), None);
        let kind = Kind::PveaCanopen;
        for node_id in [None, Some(1), Some(127)] {
            for bit_rate in kind.bit_rates() {
                let layer = LocalLayer { node_id, bit_rate: *bit_rate };
                assert_eq!(LocalLayer::decode(kind, &layer.encode()), Some(layer));
            }
        }
        assert_eq!(LocalLayer::decode(kind, &[0, 3]), None);
        assert_eq!(LocalLayer::decode(kind, &[0x80, 3]), None);
        assert_eq!(LocalLayer::decode(Kind::PveaIsobus, &[0x20, 3]), None);
        assert_eq!(LocalLayer::decode(kind, &[0x20, 0]), None, "1 Mbit/s is not for this product");
        let counters = Counters::from_bytes([1, 2, 3, 4, 5, 6, 7, 127]);
        let log = FaultLog { counters };
        assert_eq!(FaultLog::decode(&log.encode()), Some(log));
        assert_eq!(FaultLog::decode(&[1, 2, 3, 4, 5, 6, 7, 127, 0x81]), Some(log), "of an earlier version");
        assert_eq!(decode_flag(&encode_flag(true)), Some(true));
        assert_eq!(decode_flag(&[2]), None);
    }
}
