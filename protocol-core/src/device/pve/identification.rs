//! The identifiers of UDS lite (SPEC 7).

use heapless::Vec;

use super::Kind;
use super::records::{Factory, LocalLayer};
use crate::frame::{Frame, Id};
use crate::uds::{DATA_MAX, Identifiers, NODE_ID, Reaction, serve};
use crate::wire::lss::NO_NODE_ID;
use crate::wire::uds::{Address, Identifier, parse_id};

/// The value of identifier 0xF010, the address format.
const ADDRESS_FORMAT: u8 = 0xA5;

/// The valve data that UDS reads.
pub(super) struct Identification<'a> {
    pub(super) kind: Kind,
    pub(super) factory: &'a Factory,
    /// The stored node ID and bit rate.
    pub(super) local_layer: LocalLayer,
    /// True if a client's write of the node ID is waiting or in progress.
    pub(super) busy: bool,
}

impl Identification<'_> {
    /// Handles a request to the node ID or address `node`.
    pub(super) fn serve_node(&self, node: u8, frame: &Frame) -> Reaction {
        let Id::Extended(id) = frame.id() else { return Reaction::Nothing };
        if frame.is_remote() {
            return Reaction::Nothing;
        }
        match parse_id(id.as_raw()) {
            Some((source, _)) => serve(Address::node(node), source, frame.data(), self),
            None => Reaction::Nothing,
        }
    }
}

impl Identifiers for Identification<'_> {
    /// Returns the data of an identifier. Numbers are big-endian (A).
    fn read(&self, identifier: Identifier) -> Option<Vec<u8, DATA_MAX>> {
        let factory = self.factory;
        let bytes: &[u8] = match identifier {
            NODE_ID => &[self.local_layer.node_id.unwrap_or(NO_NODE_ID)],
            0xF010 => &[ADDRESS_FORMAT],
            // The diagnostic file identifier is the part number (A).
            0xF1FA..=0xF1FD => &self.kind.part_number().to_be_bytes(),
            0xF192 => &factory.hardware_number.to_be_bytes(),
            0xF193 => &factory.hardware_version,
            0xF194 => &factory.software_number.to_be_bytes(),
            0xF195 => &factory.software_version,
            0xF18C => &factory.identity.serial.to_be_bytes(),
            0xF18B => &factory.manufactured,
            _ => return None,
        };
        Vec::from_slice(bytes).ok()
    }

    fn accepts_node_id(&self, node_id: u8) -> bool {
        self.kind.node_ids().contains(&node_id)
    }

    fn is_busy(&self) -> bool {
        self.busy
    }
}
