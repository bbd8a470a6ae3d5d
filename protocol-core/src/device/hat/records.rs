//! What a sensor keeps in its memory beside the parameters (SPEC 6, 9): the payloads of the records.

use super::kind::{Kind, Setup};
use crate::canopen::lss::Configuration;
use crate::controller::BitRate;
use crate::wire::cob_id::NodeId;
use crate::wire::lss::{Address, LssNodeId};

/// The version of every record's payload.
pub(super) const VERSION: u8 = 1;

/// Vendor ID: HYDAC.
const VENDOR: u32 = 0xDA;
/// Revision number (A).
const REVISION: u32 = 0x0001_0007;
/// The serial number that a sensor leaves the factory with (A).
const SERIAL: u32 = 1;

/// Returns the identity of a sensor with this serial number; `None` for the default.
pub(super) fn identity(kind: Kind, serial: Option<u32>) -> Address {
    Address { vendor: VENDOR, product: kind.product_code(), revision: REVISION, serial: serial.unwrap_or(SERIAL) }
}

/// Decodes the factory record: the serial number.
pub(super) fn decode_serial(payload: &[u8]) -> Option<u32> {
    payload.try_into().map(u32::from_le_bytes).ok()
}

/// Node ID and bit rate: as stored, as demanded, or as in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    pub(super) node_id: LssNodeId,
    pub(super) bit_rate: BitRate,
}

impl Layer {
    /// What "load" restores.
    pub(super) const FACTORY: Self =
        Self { node_id: LssNodeId(NodeId::new(Kind::Hat1000.default_node_id())), bit_rate: BitRate::Kbit500 };

    /// What a new memory is filled with.
    pub(super) fn new(setup: &Setup) -> Self {
        Self { node_id: LssNodeId(setup.node_id.and_then(NodeId::new)), ..Self::FACTORY }
    }

    /// This layer with what a configuration changes.
    pub(super) fn with(self, change: Configuration) -> Self {
        Self { node_id: change.node_id.unwrap_or(self.node_id), bit_rate: change.bit_rate.unwrap_or(self.bit_rate) }
    }

    /// The layer as LSS knows it.
    pub(super) const fn configuration(self) -> Configuration {
        Configuration { node_id: Some(self.node_id), bit_rate: Some(self.bit_rate) }
    }

    pub(super) fn encode(self) -> [u8; 2] {
        [self.node_id.get(), self.bit_rate.table_index()]
    }

    pub(super) fn decode(payload: &[u8]) -> Option<Self> {
        let &[node_id, bit_rate] = payload else { return None };
        Some(Self { node_id: LssNodeId::new(node_id)?, bit_rate: BitRate::from_table_index(bit_rate)? })
    }
}
