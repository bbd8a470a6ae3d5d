//! SDO block transfers in progress (CiA 301 7.2.4.3.9 to 7.2.4.3.16). A segment contains a sequence number instead of a
//! command, so only earlier frames show that a frame is a segment.

use std::collections::BTreeMap;

use protocol_core::frame::{Frame, Id};
use protocol_core::wire::cob_id::{Function, classify};

use super::text_or_hex;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Party {
    Client,
    Server,
}

/// The block transfers on a bus. A client and its server use the COB-IDs 0x600 and 0x580 + node ID, so there is at most
/// one transfer per node ID.
#[derive(Clone, Debug, Default)]
pub(super) struct Blocks(BTreeMap<u8, Transfer>);

#[derive(Clone, Copy, Debug)]
struct Transfer {
    /// The sender of the segments.
    sender: Party,
    /// The number of segments per block, as requested by the receiver.
    size: u8,
    /// The number of the next segment; `None` between blocks.
    next: Option<u8>,
    /// The number of the last segment of the transfer; `None` until that segment is sent.
    last: Option<u8>,
}

impl Transfer {
    const fn new(sender: Party, size: u8, next: Option<u8>) -> Self {
        Self { sender, size, next, last: None }
    }

    fn is_segment(&self, from: Party, command: u8) -> bool {
        self.sender == from && self.next == Some(command & !LAST)
    }

    /// Updates the transfer with a segment, given its command byte.
    fn count(&mut self, command: u8) {
        let number = command & !LAST;
        let is_last = command & LAST != 0;
        self.last = is_last.then_some(number);
        self.next = (!is_last && number < self.size).then_some(number + 1);
    }
}

/// The flag of the last segment; the other bits are the sequence number.
const LAST: u8 = 1 << 7;

impl Blocks {
    /// Explains a segment of the block transfer with this node; `None` if the frame is not a segment.
    pub(super) fn segment(&self, node: u8, from: Party, bytes: &[u8; 8]) -> Option<String> {
        let [command, data @ ..] = bytes;
        self.0.get(&node).filter(|transfer| transfer.is_segment(from, *command))?;
        let direction = match from {
            Party::Client => "write",
            Party::Server => "read response",
        };
        let last = if command & LAST != 0 { "last segment" } else { "segment" };
        Some(format!("SDO block {direction}, {last} {}: {}", command & !LAST, text_or_hex(data)))
    }

    /// Updates the transfers with a frame on the bus.
    pub(super) fn observe(&mut self, frame: &Frame) {
        let (Id::Standard(id), Some(&bytes)) = (frame.id(), frame.eight()) else { return };
        let (from, node) = match classify(id) {
            Some((Function::SdoAnswer, node)) => (Party::Server, node.get()),
            Some((Function::SdoRequest, node)) => (Party::Client, node.get()),
            _ => return,
        };
        let [command, acknowledged, size, _, initial_size, ..] = bytes;
        let transfer = self.0.get_mut(&node);
        match (from, command >> 5, command & 0b11, transfer) {
            (_, _, _, Some(transfer)) if transfer.is_segment(from, command) => transfer.count(command),
            (Party::Client, 5, 0, _) => {
                self.0.insert(node, Transfer::new(Party::Server, initial_size, None));
            }
            (Party::Server, 6, 0 | 2, Some(transfer)) if transfer.sender == from => {}
            (Party::Client, 5, 3, Some(transfer)) if transfer.sender != from => transfer.next = Some(1),
            (Party::Server, 5, 0, _) => {
                self.0.insert(node, Transfer::new(Party::Client, initial_size, Some(1)));
            }
            (_, 5, 2, Some(transfer)) if transfer.sender != from && transfer.last != Some(acknowledged) => {
                *transfer = Transfer::new(transfer.sender, size, Some(1));
            }
            _ => {
                self.0.remove(&node);
            }
        }
    }
}

#[cfg(test)]
#[path = "block_tests.rs"]
mod tests;
