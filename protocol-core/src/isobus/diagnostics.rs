//! The diagnostic messages DM1 and DM2 (SAE J1939-73 5.7.1 and 5.7.2; SPEC 5).

use super::Outcome;
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::dm::{self, Trouble};
use crate::wire::j1939_id::{Address, J1939Id, Pgn, Priority};

/// The period of DM1 while a trouble code is active.
pub const PERIOD: Duration = Duration::from_millis(1000);

/// The DM1 message. It carries at most one active trouble code.
#[derive(Clone, Debug)]
pub struct Dm1 {
    active: Option<Trouble>,
    /// The time of the last change that no DM1 with the present state has reported yet.
    changed: Option<Instant>,
    /// A momentary trouble code, which was set and cleared at the time of the last change.
    passing: Option<Trouble>,
    /// The time of the next periodic DM1.
    next: Instant,
    /// The trouble code of the last encoded DM1.
    rendered: Option<Trouble>,
}

impl Dm1 {
    /// Creates a DM1 without an active trouble code. No DM1 is due.
    #[must_use]
    pub const fn new() -> Self {
        Self { active: None, changed: None, passing: None, next: NEVER, rendered: None }
    }

    /// Sets the active trouble code. Every change makes DM1 pending, even if only the occurrence count changes.
    ///
    /// `at` is the present time, or [`NEVER`] during bus-off. A code that is set and cleared at the same time is
    /// reported only by a DM1 that is encoded at that time.
    #[must_use]
    pub fn set(&mut self, active: Option<Trouble>, at: Instant) -> Outcome {
        if active == self.active {
            return Outcome::Nothing;
        }
        self.passing = self.active.filter(|_| self.changed == Some(at));
        self.active = active;
        self.changed = Some(at);
        self.next = NEVER;
        Outcome::Pending
    }

    /// Makes the periodic DM1 pending when it is due.
    #[must_use]
    pub fn poll(&mut self, now: Instant) -> Outcome {
        if now < self.next {
            return Outcome::Nothing;
        }
        self.next = next_in_grid(self.next, PERIOD, now);
        Outcome::Pending
    }

    /// Encodes DM1. It carries the momentary code if one was set at `now`, otherwise the present state.
    #[must_use]
    pub fn render(&mut self, source: Address, now: Instant) -> Frame {
        if let Some(passing) = self.passing.take().filter(|_| self.changed == Some(now)) {
            self.rendered = Some(passing);
            // If the bus delays this message by a period, a DM1 with the present state replaces it.
            self.next = delayed(now, PERIOD);
        } else {
            if self.changed.take().is_some() {
                self.next = if self.active.is_some() { delayed(now, PERIOD) } else { NEVER };
            }
            self.rendered = self.active;
        }
        single(Pgn::DM1, self.rendered, source)
    }

    /// Records that DM1 was sent. After a momentary code, a DM1 with the present state becomes pending.
    #[must_use]
    pub const fn sent(&self) -> Outcome {
        if self.changed.is_some() { Outcome::Pending } else { Outcome::Nothing }
    }

    /// Returns the trouble code of the last encoded DM1.
    #[must_use]
    pub const fn rendered(&self) -> Option<Trouble> {
        self.rendered
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.next
    }
}

impl Default for Dm1 {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns the time one `period` after `due`. After a pause longer than a period, returns the time one `period` after
/// `now`, so that missed messages are not sent.
pub(super) fn next_in_grid(due: Instant, period: Duration, now: Instant) -> Instant {
    let planned = delayed(due, period);
    if planned > now { planned } else { delayed(now, period) }
}

/// Encodes a message with at most one trouble code as a single frame.
pub(super) fn single(pgn: Pgn, trouble: Option<Trouble>, source: Address) -> Frame {
    Frame::full(id(pgn, source).id(), dm::single(trouble))
}

#[inline]
pub(super) const fn id(pgn: Pgn, source: Address) -> J1939Id {
    J1939Id::global(Priority::DEFAULT, pgn, source)
}
