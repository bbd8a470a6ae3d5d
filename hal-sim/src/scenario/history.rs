//! What happened on the bus of a scenario, the last of which is kept: for expectations, and to be shown when one fails.

use std::collections::VecDeque;
use std::sync::Arc;

use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use crate::explain::Explainer;
use crate::trace::{Errors, Layout};
use crate::world::{Event, EventKind, NodeId, World};

/// The most events that are kept: a second of a bus under full load.
const KEPT: usize = 4096;

/// The most events that an excerpt shows, repeats of cyclic frames included.
const SHOWN: usize = 256;

/// The most lines of an excerpt.
const LINES: usize = 12;

/// The last events of a bus, by their numbers from the start.
pub(super) struct History {
    /// The name of the controller that sends the scenario's own frames.
    own: &'static str,
    /// What explains the oldest event that is kept.
    explainer: Explainer,
    nodes: Vec<NodeId>,
    errors: Errors,
    /// The number of the oldest event that is kept.
    first: u64,
    entries: VecDeque<Entry>,
    trace: Option<Trace>,
}

/// All that happened, laid out as it does.
struct Trace {
    /// What explains the next event.
    explainer: Explainer,
    layout: Layout,
    text: String,
}

/// An event.
struct Entry {
    at: Instant,
    who: Arc<str>,
    what: Kept,
    /// The device that sent it, by its place, with its node ID after that.
    device: Option<(usize, Option<u8>)>,
}

enum Kept {
    Frame(Frame),
    /// An error that is told.
    Error(String),
}

/// A frame of somebody else than the scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Heard {
    /// The number of the event.
    pub(super) number: u64,
    /// The end of the frame.
    pub(super) at: Instant,
    pub(super) frame: Frame,
}

impl History {
    /// Returns an empty history of the devices that the explainer knows; `traced`: it keeps all as a text.
    pub(super) fn new(own: &'static str, mut explainer: Explainer, traced: bool, world: &World) -> Self {
        let nodes: Vec<NodeId> = world.devices().collect();
        for (node, id) in explainer.nodes_mut().iter_mut().zip(&nodes) {
            node.node_id = world.device(*id).and_then(|device| device.node_id());
        }
        let layout = || Layout::new(false, false);
        let trace = traced.then(|| Trace { explainer: explainer.clone(), layout: layout(), text: String::new() });
        Self { own, explainer, nodes, errors: Errors::default(), first: 0, entries: VecDeque::new(), trace }
    }

    /// Takes note of an event.
    pub(super) fn keep(&mut self, event: &Event, world: &World) {
        let told = self.errors.note(event);
        let what = match (&event.what, told) {
            (EventKind::Frame { frame, .. }, _) => Kept::Frame(*frame),
            (_, Some((_, text))) => Kept::Error(text),
            (_, None) => return,
        };
        let place = self.nodes.iter().position(|node| world.name(*node) == &*event.who);
        let device = place.map(|place| (place, world.device(self.nodes[place]).and_then(|device| device.node_id())));
        if self.entries.len() == KEPT
            && let Some(oldest) = self.entries.pop_front()
        {
            oldest.teach(&mut self.explainer);
            self.first += 1;
        }
        let entry = Entry { at: event.at, who: Arc::clone(&event.who), what, device };
        if let Some(Trace { explainer, layout, text }) = &mut self.trace {
            entry.lay_out(text, layout, explainer);
            entry.teach(explainer);
        }
        self.entries.push_back(entry);
    }

    /// Adds a note to the text of all that happens.
    pub(super) fn note(&mut self, note: &str) {
        if let Some(Trace { layout, text, .. }) = &mut self.trace {
            layout.finish(text);
            for line in note.lines() {
                text.push_str("-- ");
                text.push_str(line);
                text.push('\n');
            }
        }
    }

    /// Returns the text of all that happened; empty when none was kept.
    pub(super) fn finish(self) -> String {
        self.trace.map_or_else(String::new, |Trace { mut layout, mut text, .. }| {
            layout.finish(&mut text);
            text
        })
    }

    /// Returns the number that the next event gets.
    pub(super) fn next(&self) -> u64 {
        self.first + self.entries.len() as u64
    }

    /// Returns the frames of others from the event of that number on, as far as they are kept.
    pub(super) fn heard_since(&self, number: u64) -> impl Iterator<Item = Heard> {
        let skipped = self.place(number);
        let numbered = (self.first + skipped as u64..).zip(self.entries.range(skipped..));
        numbered.filter_map(|(number, entry)| match entry.what {
            Kept::Frame(frame) if &*entry.who != self.own => Some(Heard { number, at: entry.at, frame }),
            _ => None,
        })
    }

    /// Returns the place of the event of a number among those that are kept.
    fn place(&self, number: u64) -> usize {
        usize::try_from(number.saturating_sub(self.first)).unwrap_or(usize::MAX).min(self.entries.len())
    }

    /// Returns what a frame means that a device sends, with the node IDs of now.
    pub(super) fn explain(&self, frame: &Frame) -> String {
        let mut explainer = self.explainer.clone();
        self.entries.iter().for_each(|entry| entry.teach(&mut explainer));
        explainer.explain(frame, None)
    }

    /// Returns the errors of the bus, the first ones that are kept, laid out as the trace does: a line each.
    pub(super) fn errors(&self) -> Vec<String> {
        let (mut layout, mut text) = (Layout::new(false, false), String::new());
        for entry in self.entries.iter().filter(|entry| matches!(entry.what, Kept::Error(_))).take(LINES) {
            entry.lay_out(&mut text, &mut layout, &self.explainer);
        }
        layout.finish(&mut text);
        text.lines().map(str::to_owned).collect()
    }

    /// Returns the last events from one number up to another, laid out as the trace does: a line each.
    pub(super) fn excerpt(&self, from: u64, until: u64) -> Vec<String> {
        let end = self.place(until);
        let begin = self.place(from).max(end.saturating_sub(SHOWN));
        let mut explainer = self.explainer.clone();
        let (mut layout, mut text) = (Layout::new(false, false), String::new());
        for (place, entry) in self.entries.iter().take(end).enumerate() {
            if place >= begin {
                entry.lay_out(&mut text, &mut layout, &explainer);
            }
            entry.teach(&mut explainer);
        }
        layout.finish(&mut text);
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(LINES)..].iter().map(ToString::to_string).collect()
    }
}

impl Entry {
    /// Writes the event.
    fn lay_out(&self, text: &mut String, layout: &mut Layout, explainer: &Explainer) {
        match &self.what {
            Kept::Frame(frame) => {
                let meaning = || explainer.explain_and_mark(frame, Some(&self.who));
                layout.frame(text, (self.at, &self.who, frame), self.device.is_some(), meaning);
            }
            Kept::Error(error) => layout.error(text, self.at, error),
        }
    }

    /// Lets an explainer know what happened.
    fn teach(&self, explainer: &mut Explainer) {
        if let Kept::Frame(frame) = &self.what {
            explainer.observe(frame);
        }
        if let Some((place, node_id)) = self.device
            && let Some(node) = explainer.nodes_mut().get_mut(place)
        {
            node.node_id = node_id;
        }
    }
}
