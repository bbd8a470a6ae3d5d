//! Attributes log frames to the replayed devices, by the identifiers derived from node IDs and addresses and by the
//! identifiers that the simulated devices have sent.

use std::collections::BTreeSet;

use protocol_core::device::Protocol;
use protocol_core::frame::{Frame, Id, standard};
use protocol_core::wire::j1939_id::{Address, J1939Id};
use protocol_core::wire::name::Name;

use super::identifier::{is_claim, is_of, is_write_answer};
use super::timeline::Timeline;
use crate::explain::Node;

/// The identifier of LSS responses, common to all devices.
const LSS_ANSWER: u16 = 0x7E4;

/// Returns whether a frame belongs to a replayed device. `keys` are the identifiers that the simulated devices have
/// sent. `written` is the destination of the last UDS write.
pub(super) fn is_own(
    frame: &Frame,
    nodes: &[Node],
    keys: &BTreeSet<u32>,
    written: Option<u8>,
    timeline: &Timeline,
) -> bool {
    // A remote frame has the identifier of the requested frame.
    if frame.is_remote() {
        return false;
    }
    if is_claim(frame.key()) {
        return is_own_claim(frame, nodes, timeline);
    }
    if written.is_some() && is_write_answer(frame) {
        return nodes.iter().any(|node| node.node_id == written);
    }
    let is_lss = frame.id() == Id::Standard(standard(LSS_ANSWER));
    is_lss && nodes.iter().any(|node| node.kind.protocol() == Protocol::Canopen)
        || nodes.iter().any(|node| node.node_id.is_some_and(|id| is_of(frame, node.kind.protocol(), id)))
        || keys.contains(&frame.key())
}

/// Returns whether an address claim belongs to a replayed device. The claim must have the NAME of the simulated device,
/// or of the device's first claim in the log. If the log does not contain the first claim, any NAME of the same product
/// is accepted at the device's address.
fn is_own_claim(frame: &Frame, nodes: &[Node], timeline: &Timeline) -> bool {
    let name_of = |frame: &Frame| frame.eight().map(|bytes| Name::from_bytes(*bytes));
    let Some(name) = name_of(frame) else { return false };
    let source = match frame.id() {
        Id::Extended(id) => J1939Id::from_raw(id.as_raw()).source(),
        Id::Standard(_) => Address::NULL,
    };
    let product = |name: Name| (name.fields().manufacturer_code, name.fields().function);
    timeline.power_ups.iter().zip(nodes).any(|(power_up, node)| {
        let Some(own) = power_up.frame.filter(|first| is_claim(first.key())).as_ref().and_then(name_of) else {
            return false;
        };
        own == name
            || match &power_up.logged {
                Some(logged) => name_of(&logged.frame) == Some(name),
                None => node.node_id == Some(source.get()) && product(own) == product(name),
            }
    })
}
