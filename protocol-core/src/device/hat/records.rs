//! The payloads of sensor records other than the parameters (SPEC 6, 9).

use super::{Kind, Setup};
use crate::canopen::lss::Layer;
use crate::controller::BitRate;
use crate::wire::cob_id::NodeId;
use crate::wire::lss::{Address, LssNodeId};

/// The payload version of every record.
pub(super) const VERSION: u8 = 1;

/// The vendor ID of HYDAC.
const VENDOR: u32 = 0xDA;
/// The revision number (A).
const REVISION: u32 = 0x0001_0007;

/// Returns the identity of a sensor. Without a `serial`, the sensor has the default serial number.
pub(in crate::device) fn identity(kind: Kind, serial: Option<u32>) -> Address {
    let serial = serial.unwrap_or(kind.default_serial());
    Address { vendor: VENDOR, product: kind.product_code(), revision: REVISION, serial }
}

/// Decodes the factory record, which holds the serial number.
pub(super) fn decode_serial(payload: &[u8]) -> Option<u32> {
    payload.try_into().map(u32::from_le_bytes).ok()
}

/// The node ID and bit rate that "load" restores.
pub(super) const LAYER: Layer =
    Layer { node_id: LssNodeId(NodeId::new(Kind::Hat1000.default_node_id())), bit_rate: BitRate::Kbit500 };

/// Returns the node ID and bit rate of a new memory.
pub(in crate::device) fn new_layer(setup: &Setup) -> Layer {
    let bit_rate = setup.bit_rate.unwrap_or(LAYER.bit_rate);
    Layer { node_id: LssNodeId(setup.node_id.and_then(NodeId::new)), bit_rate }
}
