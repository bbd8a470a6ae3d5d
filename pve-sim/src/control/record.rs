//! The frames that were on the bus, the last ones of which are kept.

use std::collections::VecDeque;
use std::sync::Arc;

use protocol_core::frame::{Frame, Id};
use protocol_core::time::Instant;
use serde::Serialize;
use utoipa::ToSchema;

use hal_sim::explain::Explainer;
use hal_sim::log::write_hex;

/// The most frames and errors that are kept: a second of a bus under full load, and minutes of a usual one.
pub(crate) const KEPT: usize = 4096;

/// A frame that was on the bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct FrameRecord {
    /// Its end, in microseconds of virtual time.
    pub t_us: u64,
    /// The identifier.
    #[schema(maximum = 536870911)]
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// The data, in hex.
    pub data: String,
    /// Who sent it: a device by its name, `http`, or the gateway of other clients.
    pub from: String,
    /// What it means.
    pub meaning: String,
}

/// An error of the bus: the first error frame of a frame that is being destroyed, a change of an error mode, or frames
/// that were dropped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct BusTrouble {
    /// When, in microseconds of virtual time.
    pub t_us: u64,
    /// Whose frame was destroyed, or who changed its error mode.
    pub from: String,
    /// The meaning, as in the trace.
    pub meaning: String,
}

/// An entry of the trace.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(untagged)]
pub(crate) enum TraceRecord {
    /// A frame.
    Frame(FrameRecord),
    /// An error of the bus: an entry without `id`.
    Error(BusTrouble),
}

/// A frame with its end and its sender.
#[derive(Clone, Debug)]
pub(crate) struct Passed {
    pub(crate) at: Instant,
    pub(crate) frame: Frame,
    pub(crate) from: Arc<str>,
}

/// An entry of the record: a frame or an error of the bus.
#[derive(Clone, Debug)]
enum Kept {
    Frame(Passed),
    Error(BusTrouble),
}

/// The last frames and errors, and what explains them: that is left to others than the world.
#[derive(Debug)]
pub struct Excerpt {
    kept: Vec<Kept>,
    explainer: Explainer,
}

impl Excerpt {
    /// Returns the records, oldest first.
    pub(crate) fn records(&self) -> Vec<TraceRecord> {
        let meaning = |passed: &Passed| self.explainer.explain(&passed.frame, Some(&passed.from));
        let record = |kept: &Kept| match kept {
            Kept::Frame(passed) => TraceRecord::Frame(passed.record(meaning(passed))),
            Kept::Error(trouble) => TraceRecord::Error(trouble.clone()),
        };
        self.kept.iter().map(record).collect()
    }
}

/// The last frames and errors.
#[derive(Debug, Default)]
pub(crate) struct Frames(VecDeque<Kept>);

impl Frames {
    /// Keeps a frame.
    pub(crate) fn keep(&mut self, passed: Passed) {
        self.push(Kept::Frame(passed));
    }

    /// Keeps an error of the bus.
    pub(crate) fn keep_error(&mut self, trouble: BusTrouble) {
        self.push(Kept::Error(trouble));
    }

    /// Returns the last entries, with what explains them.
    pub(crate) fn last(&self, limit: usize, explainer: &Explainer) -> Excerpt {
        let kept = self.0.iter().skip(self.0.len().saturating_sub(limit)).cloned().collect();
        Excerpt { kept, explainer: explainer.clone() }
    }

    /// Lets the oldest entry go when there are too many.
    fn push(&mut self, kept: Kept) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(kept);
    }
}

impl Passed {
    /// Returns the record of the frame.
    pub(crate) fn record(&self, meaning: String) -> FrameRecord {
        let mut data = String::new();
        write_hex(&mut data, self.frame.data());
        let (id, extended) = raw(self.frame.id());
        FrameRecord { t_us: self.at.as_micros(), id, extended, data, from: self.from.to_string(), meaning }
    }
}

/// Returns the number of an identifier, and whether it has 29 bits.
pub(crate) fn raw(id: Id) -> (u32, bool) {
    match id {
        Id::Standard(id) => (id.as_raw().into(), false),
        Id::Extended(id) => (id.as_raw(), true),
    }
}
