//! What was on the bus, told on stdout and in the log.

use std::collections::HashMap;
use std::sync::Arc;

use protocol_core::device::Device;

use super::errors::Errors;
use super::log::Log;
use super::printer::Printer;
use crate::explain::Explainer;
use crate::trace::{ErrorClass, Timestamp, write_error, write_frame};
use crate::world::{Event, EventKind, NodeId, World};

/// How many bytes of lines are kept before they are printed in any case.
const BATCH: usize = 32 * 1024;

/// The trace of a run.
pub(super) struct Trace {
    /// The name of the bus in it.
    bus: String,
    /// The wall time of virtual instant 0.
    start: Timestamp,
    explainer: Explainer,
    /// The place of each device in the explainer.
    places: HashMap<Arc<str>, (NodeId, usize)>,
    errors: Errors,
    printer: Printer,
    log: Option<Log>,
    /// The line that is being written, to be used again.
    line: String,
    /// The lines that are not printed yet.
    lines: String,
}

impl Trace {
    /// A trace of the devices that the explainer knows, in a world that starts at this wall time.
    pub(super) fn new(bus: &str, start: Timestamp, explainer: Explainer, printer: Printer, log: Option<Log>) -> Self {
        Self {
            bus: bus.to_owned(),
            start,
            explainer,
            places: HashMap::new(),
            errors: Errors::default(),
            printer,
            log,
            line: String::new(),
            lines: String::new(),
        }
    }

    /// The time of an event, as it is told everywhere.
    pub(super) fn time(&self, event: &Event) -> Timestamp {
        self.start.at(event.at)
    }

    /// Learns the node IDs that the devices have now. They are the explainer's devices, in the same order.
    pub(super) fn learn(&mut self, world: &World) {
        for (place, id) in world.devices().enumerate() {
            self.places.insert(world.name(id).into(), (id, place));
            self.look_at(id, place, world);
        }
    }

    /// Tells of an event; returns what of errors was told.
    pub(super) fn tell(&mut self, event: &Event, world: &World) -> Option<ErrorClass> {
        let at = self.time(event);
        let told = self.errors.note(event, at);
        self.line.clear();
        let meaning = match (&event.what, &told) {
            (EventKind::Frame { frame, .. }, _) => {
                write_frame(&mut self.line, at, &self.bus, frame);
                // By the node IDs before the frame: it may be what changes them.
                self.explainer.explain(frame, Some(&event.who))
            }
            (_, Some((class, text))) => {
                write_error(&mut self.line, at, &self.bus, *class);
                text.clone()
            }
            (_, None) => return None,
        };
        self.log(Log::write);
        self.lines.push_str(&self.line);
        self.lines.push_str("  ");
        self.lines.push_str(&meaning);
        self.lines.push('\n');
        if self.lines.len() >= BATCH {
            self.print();
        }
        // A device that has another node ID tells so by a frame of its own: boot-up, or a claim.
        if let Some((id, place)) = self.places.get(&event.who).copied() {
            self.look_at(id, place, world);
        }
        told.map(|(class, _)| class)
    }

    /// Hands everything to those who read it.
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

    /// Hands everything out, and waits until it is printed, or nobody reads it.
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
