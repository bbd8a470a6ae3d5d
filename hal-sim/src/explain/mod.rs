//! What a frame means, in one short line: for the trace.
//!
//! A frame is explained by itself and the table of the devices on the bus, so a line is right wherever the trace
//! begins. Two frames need those before them, which are remembered: a segment of an SDO block transfer does not tell
//! that it is one, and the answer to a write of the node ID by UDS not whose it is. PDOs are read by the default mapping
//! and the default identifiers (SPEC 4.1).
//!
//! ```text
//! canopen   NMT, SYNC, EMCY, PDOs, boot-up and heartbeat        object   objects and their values
//! sdo       SDO requests and answers                            lss      LSS requests and answers
//! block     SDO block transfers under way
//! isobus    address claim, requests, transport, AVC, AVEF       diagnostics   faults, DM1, DM2
//! uds       UDS lite                                            valve    control word, status word, stroke
//! recorded  what a recording tells of devices that nobody has named, and its error frames
//! highlight    whether a frame is of a cycle, is trouble, or comes from somebody else than it seems
//! ```
//!
//! Imports run one way: `canopen` → `sdo` → `object` → `valve`.

mod block;
mod canopen;
mod diagnostics;
mod highlight;
mod isobus;
mod lss;
mod object;
mod recorded;
mod sdo;
mod uds;
mod valve;

pub use diagnostics::fault;
pub use highlight::{Mark, is_cyclic};
pub use isobus::state as valve_state;
pub use recorded::explain_error_frame;

use std::collections::BTreeMap;

use protocol_core::frame::{Frame, Id};

use self::block::Blocks;
use self::recorded::Evidence;
use self::uds::Writes;
use crate::Kind;
use crate::bus::BusError;

/// A device as the explanations know it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Node {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Its node ID, or its address, now.
    pub node_id: Option<u8>,
}

/// Explains frames by the devices that are on the bus.
#[derive(Clone, Debug, Default)]
pub struct Explainer {
    nodes: Vec<Node>,
    blocks: Blocks,
    writes: Writes,
    /// The number of nodes that were given; the others were [learned](Self::learn).
    given: usize,
    /// What those are known by.
    learned: BTreeMap<u8, Evidence>,
}

impl Explainer {
    /// Returns an explainer for these devices.
    #[must_use]
    pub fn new(nodes: Vec<Node>) -> Self {
        Self { given: nodes.len(), nodes, ..Self::default() }
    }

    /// Adds a device.
    pub fn add(&mut self, node: Node) {
        self.nodes.insert(self.given, node);
        self.given += 1;
    }

    /// Returns the devices; their node IDs change.
    pub fn nodes_mut(&mut self) -> &mut [Node] {
        &mut self.nodes
    }

    /// Takes notice of a frame on the bus, after its own explanation: it decides what later segments of an SDO block
    /// transfer are taken for, and whose an answer to a write of the node ID is.
    pub fn observe(&mut self, frame: &Frame) {
        self.blocks.observe(frame);
        self.writes.observe(frame);
    }

    /// Returns what a frame means. `from` is the name of its sender, where that is known: a device is then called by
    /// its name whatever identifier it sends under, and a client that uses the identifier of a device is not taken for
    /// it.
    #[must_use]
    pub fn explain(&self, frame: &Frame, from: Option<&str>) -> String {
        self.meaning(frame, &self.context(from)).unwrap_or_else(|| "unknown".to_owned())
    }

    /// Returns what a frame means, as [`explain`](Self::explain), and what is remarkable about it.
    #[must_use]
    pub fn explain_and_mark(&self, frame: &Frame, from: Option<&str>) -> (String, Mark) {
        let context = self.context(from);
        match self.meaning(frame, &context) {
            Some(text) => (text, highlight::mark(frame, &context)),
            None => ("unknown".to_owned(), Mark::Unknown),
        }
    }

    fn context<'a>(&'a self, from: Option<&str>) -> Context<'a> {
        let sender = from.and_then(|name| self.nodes.iter().find(|node| node.name == name));
        let (nodes, blocks, writes) = (&self.nodes, &self.blocks, &self.writes);
        Context { nodes, blocks, writes, sender, from_client: from.is_some() && sender.is_none() }
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

/// Returns what an error frame means that destroyed `frame`.
#[must_use]
pub fn explain_error(error: BusError, frame: &Frame, from: &str) -> String {
    let why = match error {
        BusError::Acknowledgement => "nobody acknowledged",
        BusError::Bit => "bit error in",
        BusError::Stuff => "stuff error in",
    };
    format!("error frame: {why} {frame} of {from}")
}

/// What an explanation may look at beside the frame.
struct Context<'a> {
    nodes: &'a [Node],
    blocks: &'a Blocks,
    writes: &'a Writes,
    /// The device that sent the frame.
    sender: Option<&'a Node>,
    /// Whether a client sent it, and no device.
    from_client: bool,
}

impl Context<'_> {
    /// Returns the device of a node ID.
    fn node(&self, id: u8) -> Option<&Node> {
        self.nodes.iter().find(|node| node.node_id == Some(id))
    }

    /// Returns the name of the device of a node ID, or what to call one that is not known.
    fn name(&self, id: u8) -> String {
        self.node(id).map_or_else(|| format!("node 0x{id:02X}"), |node| node.name.clone())
    }

    /// Returns the name of the sender of a frame that belongs to a node ID.
    fn sender(&self, id: u8) -> String {
        self.sender_or(id, || self.name(id))
    }

    /// Returns the name of the sender of a frame that belongs to a node ID; `otherwise` when no device has that.
    fn sender_or(&self, id: u8, otherwise: impl FnOnce() -> String) -> String {
        match (self.sender, self.impersonated(id)) {
            (Some(sender), _) => sender.name.clone(),
            (None, Some(node)) => format!("client as {}", node.name),
            (None, None) => otherwise(),
        }
    }

    /// Returns the device whose node ID a client uses for a frame of its own.
    fn impersonated(&self, id: u8) -> Option<&Node> {
        self.node(id).filter(|_| self.from_client)
    }

    /// Returns who tells a device what to do: another device by its name, or the master.
    fn commander(&self) -> &str {
        self.sender.map_or("master", |sender| &sender.name)
    }

    /// Returns the kind of the device that a frame of a node ID is about.
    fn kind(&self, id: u8) -> Option<Kind> {
        self.sender.or_else(|| self.node(id)).map(|node| node.kind)
    }
}

/// Bytes in hex, with blanks between them.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// Bytes as a quoted text when they are one, else in hex.
fn text_or_hex(bytes: &[u8]) -> String {
    let printable = !bytes.is_empty() && bytes.iter().all(|byte| (b' '..=b'~').contains(byte));
    if printable { format!("\"{}\"", String::from_utf8_lossy(bytes)) } else { hex(bytes) }
}

#[cfg(test)]
mod tests;
