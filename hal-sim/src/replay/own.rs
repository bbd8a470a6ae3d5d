//! Which frames of a recording are of the devices that stand-ins stand for: those with identifiers of their node IDs
//! and addresses, and those that the stand-ins themselves have sent under.

use std::collections::BTreeSet;

use protocol_core::device::Protocol;
use protocol_core::frame::{Frame, Id, standard};
use protocol_core::wire::j1939_id::{Address, J1939Id, Pgn};
use protocol_core::wire::name::Name;
use protocol_core::wire::uds;

use super::begin::Begin;
use crate::explain::Node;

/// Answers to LSS: whoever is asked by LSS sends them.
const LSS_ANSWER: u16 = 0x7E4;

/// The mark of a 29-bit identifier in a [key](Frame::key).
const EXTENDED: u32 = 1 << 29;

/// Returns whether a frame is of a device. `keys` are identifiers that stand-ins have sent under.
pub(super) fn is_own(frame: &Frame, nodes: &[Node], keys: &BTreeSet<u32>, begin: &Begin) -> bool {
    // A remote frame has the identifier of the answer that it asks for.
    if frame.is_remote() {
        return false;
    }
    if is_claim(frame.key()) {
        return is_own_claim(frame, nodes, begin);
    }
    let is_lss = frame.id() == Id::Standard(standard(LSS_ANSWER));
    is_lss && nodes.iter().any(|node| node.kind.protocol() == Protocol::Canopen)
        || nodes.iter().any(|node| node.node_id.is_some_and(|id| is_of(frame, node.kind.protocol(), id)))
        || keys.contains(&frame.key())
}

/// Returns whether a frame has an identifier of the device with this node ID, or address.
pub(super) fn is_of(frame: &Frame, protocol: Protocol, node_id: u8) -> bool {
    match (frame.id(), protocol) {
        (Id::Standard(id), Protocol::Canopen) => {
            matches!(id.as_raw(), 0x081..=0x0FF | 0x181..=0x1FF | 0x581..=0x5FF | 0x701..=0x77F)
                && id.as_raw() & 0x7F == u16::from(node_id)
        }
        (Id::Standard(_), Protocol::Isobus) => false,
        (Id::Extended(id), protocol) => match uds::parse_id(id.as_raw()) {
            Some((source, _)) => source.raw() == u16::from(node_id),
            None => protocol == Protocol::Isobus && J1939Id::from_raw(id.as_raw()).source().get() == node_id,
        },
    }
}

/// Returns the identifier of a [key](Frame::key), as frames are printed.
pub(super) fn id_of_key(key: u32) -> String {
    if key & EXTENDED == 0 { format!("{key:03X}") } else { format!("{:08X}", key & !EXTENDED) }
}

/// Returns whether a [key](Frame::key) is of an address claim, or of a cannot-claim.
pub(super) fn is_claim(key: u32) -> bool {
    key & EXTENDED != 0
        && uds::parse_id(key & !EXTENDED).is_none()
        && J1939Id::from_raw(key & !EXTENDED).pgn() == Pgn::ADDRESS_CLAIMED
}

/// Returns whether a frame says that its sender has no address.
pub(super) fn is_cannot_claim(frame: &Frame) -> bool {
    match frame.id() {
        Id::Extended(id) => is_claim(frame.key()) && J1939Id::from_raw(id.as_raw()).source() == Address::NULL,
        Id::Standard(_) => false,
    }
}

/// Returns whether a claim is of a device: by its NAME, that of the stand-in or that of its first claim in the log.
/// Where the log has none, another NAME of the same product at the address of the device is taken for its own.
fn is_own_claim(frame: &Frame, nodes: &[Node], begin: &Begin) -> bool {
    let name_of = |frame: &Frame| frame.eight().map(|bytes| Name::from_bytes(*bytes));
    let Some(name) = name_of(frame) else { return false };
    let source = match frame.id() {
        Id::Extended(id) => J1939Id::from_raw(id.as_raw()).source(),
        Id::Standard(_) => Address::NULL,
    };
    let product = |name: Name| (name.fields().manufacturer_code, name.fields().function);
    begin.power_ups().iter().zip(nodes).any(|(power_up, node)| {
        let Some(own) = power_up.frame.filter(|first| is_claim(first.key())).as_ref().and_then(name_of) else {
            return false;
        };
        own == name
            || match &power_up.logged {
                Some(logged) => name_of(logged) == Some(name),
                None => node.node_id == Some(source.get()) && product(own) == product(name),
            }
    })
}
