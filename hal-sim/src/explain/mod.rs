//! Explains the meaning of a frame in one short line for the trace.
//!
//! An explanation depends only on the frame and the table of devices, so that a trace can begin at any frame. There are
//! three exceptions that need earlier frames: a segment of an SDO block transfer looks like other frames, the response to
//! a node ID write by UDS does not identify its sender, and a PDO whose mapping was changed does not follow the default
//! mapping. PDOs are decoded by the default mapping and identifiers (SPEC 4.1).
//!
//! ```text
//! canopen   NMT, SYNC, EMCY, PDOs, boot-up and heartbeat        object   objects and their values
//! sdo       SDO requests and responses                          lss      LSS requests and responses
//! block     SDO block transfers in progress                     mapping  changed PDO mappings
//! isobus    address claim, requests, transport, AVC, AVEF       diagnostics   faults, DM1, DM2
//! uds       UDS lite                                            valve    control word, status word, stroke
//! recorded  unnamed devices of a recording, and its error frames
//! highlight cyclic frames, faults, and frames with an identifier of another sender
//! ```
//!
//! Imports between these modules run in one direction: `canopen` → `sdo` → `object` → `valve`.

mod block;
mod canopen;
mod diagnostics;
mod highlight;
mod isobus;
mod lss;
mod mapping;
mod object;
mod recorded;
mod sdo;
mod uds;
mod valve;

pub use diagnostics::fault;
pub use highlight::{Mark, is_cyclic};
pub use isobus::{control, state as valve_state};
pub use object::formatted;
pub use recorded::explain_error_frame;

use std::collections::BTreeMap;

use protocol_core::frame::{Frame, Id};

use self::block::Blocks;
use self::highlight::tells_fault;
use self::mapping::Mappings;
use self::recorded::Evidence;
use self::uds::Writes;
use crate::Kind;
use crate::bus::{BusError, FaultEffect};

/// A device as known to the explainer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Node {
    /// The name.
    pub name: String,
    /// The kind.
    pub kind: Kind,
    /// The current node ID or address.
    pub node_id: Option<u8>,
}

/// A translator of frames into text, based on the devices on the bus.
#[derive(Clone, Debug, Default)]
pub struct Explainer {
    /// The devices, whose node IDs the caller keeps up to date.
    pub nodes: Vec<Node>,
    blocks: Blocks,
    mappings: Mappings,
    writes: Writes,
    /// The devices that were [learned](Self::learn), with the evidence for their kinds, by node ID or address.
    learned: BTreeMap<u8, (Node, Evidence)>,
}

impl Explainer {
    /// Creates an explainer for the given devices.
    #[must_use]
    pub fn new(nodes: Vec<Node>) -> Self {
        Self { nodes, ..Self::default() }
    }

    /// Records a frame, after the frame itself has been explained. Later segments of an SDO block transfer, the answer to
    /// a node ID write, and PDOs with a changed mapping can then be explained.
    pub fn observe(&mut self, frame: &Frame) {
        self.blocks.observe(frame);
        self.mappings.observe(frame);
        self.writes.observe(frame);
    }

    /// Explains a frame. `from` is the name of the sender, if known. The sender is then not derived from the
    /// identifier, so a client is not mistaken for the device whose identifier the client uses.
    #[must_use]
    pub fn explain(&self, frame: &Frame, from: Option<&str>) -> String {
        self.meaning(frame, &self.context(from)).unwrap_or_else(|| "unknown".to_owned())
    }

    /// Explains a frame, as [`explain`](Self::explain) does, and selects its highlight.
    #[must_use]
    pub fn explain_and_mark(&self, frame: &Frame, from: Option<&str>) -> (String, Mark) {
        let context = self.context(from);
        match self.meaning(frame, &context) {
            Some(text) if text.starts_with(POSING) => (text, Mark::Impersonation),
            Some(text) => (text, if tells_fault(frame) { Mark::Fault } else { Mark::Plain }),
            None => ("unknown".to_owned(), Mark::Unknown),
        }
    }

    fn context<'a>(&'a self, from: Option<&str>) -> Context<'a> {
        let sender = from.and_then(|name| self.nodes.iter().find(|node| node.name == name));
        Context { known: self, sender, from_client: from.is_some() && sender.is_none() }
    }

    fn meaning(&self, frame: &Frame, context: &Context<'_>) -> Option<String> {
        if frame.is_remote() {
            Some(format!("remote frame, length {}", frame.len()))
        } else {
            match frame.id() {
                Id::Standard(id) => canopen::explain(id, frame, context),
                Id::Extended(id) => uds::explain(id.as_raw(), frame.data(), context)
                    .or_else(|| isobus::explain(id.as_raw(), frame, context)),
            }
        }
    }
}

/// Explains an error frame that destroyed `frame`.
#[must_use]
pub fn explain_error(error: BusError, frame: &Frame, from: &str) -> String {
    let why = match error {
        BusError::Acknowledgement => "no acknowledgement of",
        BusError::Bit => "bit error in",
        BusError::Stuff => "stuff error in",
    };
    format!("error frame: {why} {frame} from {from}")
}

/// Explains the effect of a communication fault on `frame`.
#[must_use]
pub fn explain_fault(fault: &str, frame: &Frame, effect: &FaultEffect, from: &str) -> String {
    match effect {
        FaultEffect::Inserted => format!("fault {fault}: {frame} inserted"),
        effect => format!("fault {fault}: {frame} of {from} {effect}"),
    }
}

/// The beginning of an explanation if a client uses a device's identifier.
const POSING: &str = "client, posing as ";

struct Context<'a> {
    known: &'a Explainer,
    /// The device that sent the frame, if known.
    sender: Option<&'a Node>,
    from_client: bool,
}

impl Context<'_> {
    fn node(&self, id: u8) -> Option<&Node> {
        let Explainer { nodes, learned, .. } = self.known;
        nodes.iter().find(|node| node.node_id == Some(id)).or_else(|| learned.get(&id).map(|(node, _)| node))
    }

    /// Returns the name of the device with a node ID, or the text `node 0x…` if no device has the node ID.
    fn name(&self, id: u8) -> String {
        self.node(id).map_or_else(|| format!("node 0x{id:02X}"), |node| node.name.clone())
    }

    /// Returns the sender's name for a frame whose identifier contains this node ID.
    fn sender(&self, id: u8) -> String {
        self.sender_or(id, || self.name(id))
    }

    /// Returns the sender's name for a frame whose identifier contains this node ID: the sending device, or a client
    /// that uses the node ID of a device. In all other cases, `otherwise` provides the name.
    fn sender_or(&self, id: u8, otherwise: impl FnOnce() -> String) -> String {
        match (self.sender, self.impersonated(id)) {
            (Some(sender), _) => sender.name.clone(),
            (None, Some(node)) => format!("{POSING}{}", node.name),
            (None, None) => otherwise(),
        }
    }

    /// Returns the device with this node ID if a client sent the frame.
    fn impersonated(&self, id: u8) -> Option<&Node> {
        self.node(id).filter(|_| self.from_client)
    }

    /// Returns the sender of a command: the name of the sending device, or the master.
    fn commander(&self) -> &str {
        self.sender.map_or("master", |sender| &sender.name)
    }

    /// Returns the kind of the sending device or, if the sender is unknown, of the device with this node ID.
    fn kind(&self, id: u8) -> Option<Kind> {
        self.sender.or_else(|| self.node(id)).map(|node| node.kind)
    }
}

/// Formats bytes in hex, separated by spaces.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// Formats bytes as a quoted string if all are printable, otherwise in hex.
fn text_or_hex(bytes: &[u8]) -> String {
    let printable = !bytes.is_empty() && bytes.iter().all(|byte| (b' '..=b'~').contains(byte));
    if printable { format!("\"{}\"", String::from_utf8_lossy(bytes)) } else { hex(bytes) }
}

#[cfg(test)]
mod tests;
