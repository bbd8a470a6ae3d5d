//! Identifiers of devices and of address claims.

use protocol_core::device::Protocol;
use protocol_core::frame::{Frame, Id, extended};
use protocol_core::uds::NODE_ID_ANSWER;
use protocol_core::wire::cob_id::classify;
use protocol_core::wire::j1939_id::{Address, J1939Id, Pgn};
use protocol_core::wire::uds;

/// The mark of a 29-bit identifier in a [key](Frame::key).
const EXTENDED: u32 = 1 << 29;

/// Returns whether the identifier of a frame names the device with this node ID or address as the sender.
pub(super) fn is_of(frame: &Frame, protocol: Protocol, node_id: u8) -> bool {
    match (frame.id(), protocol) {
        (Id::Standard(id), Protocol::Canopen) => {
            // TPDOs 2 to 4, which a simulated device does not have. A frame in the log is thus a difference.
            let is_further_tpdo = [0x280, 0x380, 0x480].contains(&id.as_raw().wrapping_sub(node_id.into()));
            is_further_tpdo
                || classify(id).is_some_and(|(function, node)| function.is_from_node() && node.get() == node_id)
        }
        (Id::Standard(_), Protocol::Isobus) => false,
        (Id::Extended(id), protocol) => match uds::parse_id(id.as_raw()) {
            Some((source, _)) => source.raw() == u16::from(node_id) && !is_write_answer(frame),
            None => protocol == Protocol::Isobus && J1939Id::from_raw(id.as_raw()).source().get() == node_id,
        },
    }
}

/// Returns the destination of a UDS write.
pub(super) fn destination_of_write(frame: &Frame) -> Option<u8> {
    let Id::Extended(id) = frame.id() else { return None };
    let (_, destination) = uds::parse_id(id.as_raw())?;
    matches!(frame.data(), [_, uds::WRITE, ..]).then(|| u8::try_from(destination.raw()).ok()).flatten()
}

/// Returns whether a frame answers a UDS write under the identifier that all valves use for a write of the node ID
/// (SPEC 7). Its source bits name address 0x81.
pub(super) fn is_write_answer(frame: &Frame) -> bool {
    const WRITTEN: u8 = uds::WRITE + uds::POSITIVE;
    frame.id() == Id::Extended(extended(NODE_ID_ANSWER))
        && matches!(frame.data(), [_, WRITTEN, ..] | [_, uds::NEGATIVE, uds::WRITE, ..])
}

/// Formats the identifier of a [key](Frame::key) in hex.
pub(super) fn id_of_key(key: u32) -> String {
    if key & EXTENDED == 0 { format!("{key:03X}") } else { format!("{:08X}", key & !EXTENDED) }
}

/// Returns whether a [key](Frame::key) is that of an address claim or cannot-claim.
pub(super) fn is_claim(key: u32) -> bool {
    key & EXTENDED != 0
        && uds::parse_id(key & !EXTENDED).is_none()
        && J1939Id::from_raw(key & !EXTENDED).pgn() == Pgn::ADDRESS_CLAIMED
}

pub(super) fn is_cannot_claim(frame: &Frame) -> bool {
    match frame.id() {
        Id::Extended(id) => is_claim(frame.key()) && J1939Id::from_raw(id.as_raw()).source() == Address::NULL,
        Id::Standard(_) => false,
    }
}
