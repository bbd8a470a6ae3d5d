//! The history of the bus: the latest events, and the explainer state needed to explain them.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

use protocol_core::frame::Frame;
use protocol_core::time::Instant;
use serde::Serialize;
use utoipa::ToSchema;

use crate::Kind;
use crate::bus::FaultEffect;
use crate::explain::{Explainer, Node};
use crate::log::{ErrorClass, write_hex};
use crate::state::raw;
use crate::trace::{Errors, Layout};
use crate::world::{Event, EventKind, NodeId, World};

/// The capacity of the history in frames and errors: one second of a fully loaded bus, or minutes of a typical bus.
pub const KEPT: usize = 4096;

/// The maximum number of history entries considered for an excerpt, including repeated cyclic frames.
const SHOWN: usize = 256;

/// The maximum number of lines in an excerpt.
const LINES: usize = 12;

/// A frame that was on the bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct FrameRecord {
    /// The end of the frame, in microseconds of virtual time.
    pub t_us: u64,
    /// The identifier.
    #[schema(maximum = 536870911)]
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// The data, in hex.
    pub data: String,
    /// The sender: the name of a device, `http`, or the gateway of other clients.
    pub from: String,
    /// The meaning of the frame.
    pub meaning: String,
}

/// An error of the bus: the first error frame of a destroyed frame, a change of an error mode, the effect of a
/// communication fault, or dropped frames.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BusTrouble {
    /// The instant, in microseconds of virtual time.
    pub t_us: u64,
    /// The sender of the destroyed, affected or dropped frame, or the controller whose error mode changed.
    pub from: String,
    /// The meaning, as in the trace.
    pub meaning: String,
}

/// An entry of the trace.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum TraceRecord {
    /// A frame.
    Frame(FrameRecord),
    /// An error of the bus: an entry without `id`.
    Error(BusTrouble),
}

/// A recorded bus event.
#[derive(Clone, Debug)]
pub struct Happened {
    /// The event.
    pub event: Event,
    /// The message for an event reported to users, with the error class of a bus error (a communication fault has
    /// none). `None` if the event is not reported.
    pub error: Option<(Option<ErrorClass>, String)>,
    /// The index of the sending device, with its node ID after the event; `None` for any other sender.
    device: Option<(usize, Option<u8>)>,
    /// True if the command sender received the frame of the event.
    pub is_received: bool,
}

/// The latest events of a bus. Events are numbered from the start of the simulation.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// The name of the command sender: the controller that sends the frames of commands.
    own: String,
    /// True if a communication fault keeps the next frame from the command sender.
    is_lost: bool,
    /// The devices by name, each with its index in the explainer.
    places: HashMap<Arc<str>, (NodeId, usize)>,
    errors: Errors,
    /// The state of the explainer before the oldest recorded entry.
    oldest: Explainer,
    /// The state of the explainer before the latest entry.
    latest: Explainer,
    /// The number of the oldest recorded entry.
    first: u64,
    entries: VecDeque<Happened>,
}

/// A frame that was on the bus and was not sent by a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// The number of the event.
    pub number: u64,
    /// The end of the frame.
    pub at: Instant,
    /// The frame.
    pub frame: Frame,
}

/// A copy of the latest frames and errors, with an explainer, for use in another thread.
#[derive(Clone, Debug)]
pub struct Excerpt {
    entries: Vec<Happened>,
    /// The number of leading entries that only prepare the explainer.
    skipped: usize,
    explainer: Explainer,
}

impl Excerpt {
    /// Explains the entries. Returns the records, oldest first.
    #[must_use]
    pub fn records(mut self) -> Vec<TraceRecord> {
        let mut records = Vec::new();
        for (place, entry) in self.entries.iter().enumerate() {
            if place >= self.skipped {
                records.extend(entry.record(&self.explainer));
            }
            entry.teach(&mut self.explainer);
        }
        records
    }
}

impl History {
    /// Adds a device to the explainer.
    pub(super) fn add_device(&mut self, name: &str, kind: Kind, node: NodeId) {
        self.places.insert(name.into(), (node, self.places.len()));
        for explainer in [&mut self.oldest, &mut self.latest] {
            explainer.nodes.push(Node { name: name.to_owned(), kind, node_id: None });
        }
    }

    /// Sets the name of the command sender.
    pub(super) fn set_own(&mut self, name: &str) {
        name.clone_into(&mut self.own);
    }

    /// Sets the initial node IDs of the devices in the explainer.
    pub(super) fn learn(&mut self, world: &World) {
        for (node, place) in self.places.values() {
            for explainer in [&mut self.oldest, &mut self.latest] {
                explainer.nodes[*place].node_id = world.device(*node).and_then(|device| device.node_id());
            }
        }
    }

    /// Records a frame or a reported error. Returns the event with its message, if any.
    pub(super) fn keep(&mut self, event: Event, world: &World) -> Happened {
        let error = self.errors.note(&event);
        let is_received = self.receives(&event);
        let node_id = |node| world.device(node).and_then(|device| device.node_id());
        let device = self.places.get(&event.who).map(|(node, place)| (*place, node_id(*node)));
        let happened = Happened { event, error, device, is_received };
        if happened.event.frame().is_some() || happened.error.is_some() {
            self.push(happened.clone());
        }
        happened
    }

    /// Returns whether an event is a frame that the command sender receives. The event of a fault that loses a frame
    /// precedes the event of this frame.
    fn receives(&mut self, event: &Event) -> bool {
        match &event.what {
            EventKind::Fault { effect: FaultEffect::Lost(receivers), .. } => {
                self.is_lost |= receivers.is_empty() || receivers.iter().any(|name| **name == *self.own);
                false
            }
            EventKind::Frame { .. } => !std::mem::take(&mut self.is_lost) && *event.who != *self.own,
            _ => false,
        }
    }

    fn push(&mut self, entry: Happened) {
        if let Some(before) = self.entries.back() {
            before.teach(&mut self.latest);
        }
        if self.entries.len() == KEPT
            && let Some(oldest) = self.entries.pop_front()
        {
            oldest.teach(&mut self.oldest);
            self.first += 1;
        }
        self.entries.push_back(entry);
    }

    /// Returns the explainer for the latest event, in the state before this event, because the event may change node
    /// IDs.
    pub const fn explainer(&self) -> &Explainer {
        &self.latest
    }

    /// Returns the number of the next event.
    #[must_use]
    pub fn next(&self) -> u64 {
        self.first + self.entries.len() as u64
    }

    /// Returns the latest frames and errors, up to `limit`.
    #[must_use]
    pub fn last(&self, limit: usize) -> Excerpt {
        Excerpt {
            entries: self.entries.iter().cloned().collect(),
            skipped: self.entries.len().saturating_sub(limit),
            explainer: self.oldest.clone(),
        }
    }

    /// Returns the recorded frames from event `number` onwards, except frames of commands.
    pub fn heard_since(&self, number: u64) -> impl Iterator<Item = Heard> {
        self.frames_since(number, None)
    }

    /// Returns the recorded frames from event `number` onwards. With `since`, returns the frames after this instant,
    /// including frames of commands but not frames that faults insert.
    pub fn frames_since(&self, number: u64, since: Option<Instant>) -> impl Iterator<Item = Heard> {
        let skipped = self.place(number);
        let numbered = (self.first + skipped as u64..).zip(self.entries.range(skipped..));
        numbered.filter_map(move |(number, entry)| {
            let (Event { at, who, .. }, frame) = (&entry.event, entry.event.frame()?);
            let is_own = **who == *self.own;
            let counts = since.map_or(!is_own, |since| *at > since && (is_own || entry.device.is_some()));
            counts.then_some(Heard { number, at: *at, frame: *frame })
        })
    }

    /// Returns whether all events after an instant are recorded.
    pub fn has_all_since(&self, since: Instant) -> bool {
        self.first == 0 || self.entries.front().is_some_and(|oldest| oldest.event.at <= since)
    }

    /// Returns the first frame from event `number` onwards that the command sender received, with the number of the
    /// event after it. The frame is explained as if it were sent now.
    pub(super) fn received_since(&self, number: u64) -> Option<(FrameRecord, u64)> {
        let skipped = self.place(number);
        let mut numbered = (self.first + skipped as u64..).zip(self.entries.range(skipped..));
        let (number, entry) = numbered.find(|(_, entry)| entry.is_received)?;
        Some((entry.frame_record(&self.latest)?, number + 1))
    }

    /// Returns the index of an event among the recorded entries; 0 for a dropped event, the number of entries for a
    /// future event.
    fn place(&self, number: u64) -> usize {
        usize::try_from(number.saturating_sub(self.first)).unwrap_or(usize::MAX).min(self.entries.len())
    }

    /// Explains a frame as if a device sent it now.
    #[must_use]
    pub fn explain(&self, frame: &Frame) -> String {
        let mut explainer = self.latest.clone();
        self.entries.back().into_iter().for_each(|entry| entry.teach(&mut explainer));
        explainer.explain(frame, None)
    }

    /// Returns the oldest recorded bus errors, one per line, in trace layout.
    #[must_use]
    pub fn errors(&self) -> Vec<String> {
        let (mut layout, mut text) = (Layout::new(false, false), String::new());
        for entry in self.entries.iter().filter(|entry| entry.event.frame().is_none()).take(LINES) {
            entry.lay_out(&mut text, &mut layout, &self.oldest);
        }
        layout.finish(&mut text);
        text.lines().map(str::to_owned).collect()
    }

    /// Returns the last events with numbers from `from` up to, but not including, `until`, one per line, in trace
    /// layout.
    #[must_use]
    pub fn excerpt(&self, from: u64, until: u64) -> Vec<String> {
        let end = self.place(until);
        let begin = self.place(from).max(end.saturating_sub(SHOWN));
        let mut explainer = self.oldest.clone();
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

impl Happened {
    /// Returns the record of the frame or reported error of the event, if any. `explainer` explains the frame.
    #[must_use]
    pub fn record(&self, explainer: &Explainer) -> Option<TraceRecord> {
        let Event { at, who, .. } = &self.event;
        let error = |(_, meaning): &(_, String)| {
            TraceRecord::Error(BusTrouble { t_us: at.as_micros(), from: who.to_string(), meaning: meaning.clone() })
        };
        self.frame_record(explainer).map(TraceRecord::Frame).or_else(|| self.error.as_ref().map(error))
    }

    /// Returns the record of the frame of the event, if any, with its explanation.
    pub(super) fn frame_record(&self, explainer: &Explainer) -> Option<FrameRecord> {
        let Event { at, who, .. } = &self.event;
        let frame = self.event.frame()?;
        let mut data = String::new();
        write_hex(&mut data, frame.data());
        let (id, extended) = raw(frame.id());
        let meaning = explainer.explain(frame, Some(who));
        Some(FrameRecord { t_us: at.as_micros(), id, extended, data, from: who.to_string(), meaning })
    }

    /// Writes the event in trace layout.
    pub fn lay_out(&self, text: &mut String, layout: &mut Layout, explainer: &Explainer) {
        let Event { at, who, .. } = &self.event;
        match (self.event.frame(), &self.error) {
            (Some(frame), _) => {
                let meaning = || explainer.explain_and_mark(frame, Some(who));
                layout.frame(text, (*at, who, frame), self.device.is_some(), meaning);
            }
            (None, Some((_, error))) => layout.error(text, *at, error),
            (None, None) => {}
        }
    }

    /// Updates an explainer with the event.
    fn teach(&self, explainer: &mut Explainer) {
        if let Some(frame) = self.event.frame() {
            explainer.observe(frame);
        }
        if let Some((place, node_id)) = self.device
            && let Some(node) = explainer.nodes.get_mut(place)
        {
            node.node_id = node_id;
        }
    }
}
