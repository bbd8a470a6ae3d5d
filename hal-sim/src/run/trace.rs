//! The trace of a run, on stdout and in the log.

use std::collections::HashMap;
use std::sync::Arc;

use protocol_core::device::Device;

use super::log::Log;
use super::printer::Printer;
use crate::explain::Explainer;
use crate::trace::{ErrorClass, Timestamp, write_error, write_frame};
use crate::world::{Event, EventKind, NodeId, World};

/// Lines are printed at the latest when they have so many bytes.
const BATCH: usize = 32 * 1024;

/// The trace of a run.
pub(super) struct Trace {
    /// The name of the bus.
    bus: String,
    explainer: Explainer,
    /// The place of each device in the explainer.
    places: HashMap<Arc<str>, (NodeId, usize)>,
    printer: Printer,
    log: Option<Log>,
    /// The current line; the allocation is used again.
    line: String,
    /// Lines that are not printed yet.
    lines: String,
}

impl Trace {
    /// A trace of the devices that the explainer knows.
    pub(super) fn new(bus: &str, explainer: Explainer, printer: Printer, log: Option<Log>) -> Self {
        Self {
            bus: bus.to_owned(),
            explainer,
            places: HashMap::new(),
            printer,
            log,
            line: String::new(),
            lines: String::new(),
        }
    }

    /// Learns the present node IDs of all devices: those of the explainer, in the same order.
    pub(super) fn learn(&mut self, world: &World) {
        for (place, id) in world.devices().enumerate() {
            self.places.insert(world.name(id).into(), (id, place));
            self.look_at(id, place, world);
        }
    }

    /// Writes the line of a frame, or of an error that is told.
    pub(super) fn tell(&mut self, event: &Event, at: Timestamp, error: Option<(ErrorClass, String)>, world: &World) {
        self.line.clear();
        let meaning = match (&event.what, error) {
            (EventKind::Frame { frame, .. }, _) => {
                write_frame(&mut self.line, at, &self.bus, frame);
                // With the node IDs before the frame: the frame may change them.
                self.explainer.explain(frame, Some(&event.who))
            }
            (_, Some((class, text))) => {
                write_error(&mut self.line, at, &self.bus, class);
                text
            }
            (_, None) => return,
        };
        self.log(Log::write);
        self.lines.push_str(&self.line);
        self.lines.push_str("  ");
        self.lines.push_str(&meaning);
        self.lines.push('\n');
        if self.lines.len() >= BATCH {
            self.print();
        }
        // A device with a new node ID sends a frame of its own: boot-up, or a claim.
        if let Some((id, place)) = self.places.get(&event.who).copied() {
            self.look_at(id, place, world);
        }
    }

    /// Hands all lines to their readers.
    pub(super) fn hand_out(&mut self) {
        self.log(|log, _| log.flush());
        if !self.lines.is_empty() {
            self.print();
        }
    }

    /// Prints a line for the user.
    pub(super) fn warn(&self, line: String) {
        self.printer.warn(line);
    }

    /// Hands all lines out, and waits until they are printed or nobody reads them.
    pub(super) fn finish(mut self) {
        self.hand_out();
        self.printer.finish();
    }

    fn look_at(&mut self, id: NodeId, place: usize, world: &World) {
        if let Some(node) = self.explainer.nodes_mut().get_mut(place) {
            node.node_id = world.device(id).and_then(Device::node_id);
        }
    }

    fn print(&mut self) {
        let room = String::with_capacity(self.lines.len());
        self.printer.trace(std::mem::replace(&mut self.lines, room));
    }

    fn log(&mut self, act: impl FnOnce(&mut Log, &str) -> Result<(), String>) {
        if let Some(log) = &mut self.log
            && let Err(complaint) = act(log, &self.line)
        {
            self.printer.warn(complaint);
            self.log = None;
        }
    }
}
