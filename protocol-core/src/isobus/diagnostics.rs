//! Diagnostic messages: DM1 by itself, DM2 on request (SAE J1939-73 5.7.1 and 5.7.2; SPEC 5).

use super::Outcome;
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::dm::{self, Trouble};
use crate::wire::j1939_id::{Address, J1939Id, Pgn, Priority};

/// The period of DM1 while a trouble code is active.
pub const PERIOD: Duration = Duration::from_millis(1000);

/// DM1: the one active trouble code that the product shows.
#[derive(Clone, Debug)]
pub struct Dm1 {
    active: Option<Trouble>,
    /// The last change since a DM1 was rendered. The next DM1 then restarts the period.
    changed: Option<Instant>,
    /// A code that was active at the instant of that change alone.
    passing: Option<Trouble>,
    /// The instant at which the next repetition is due.
    next: Instant,
    /// The code in the DM1 that was rendered last.
    rendered: Option<Trouble>,
}

impl Dm1 {
    /// Returns a DM1 without an active code, which is not to be sent.
    #[must_use]
    pub const fn new() -> Self {
        Self { active: None, changed: None, passing: None, next: NEVER, rendered: None }
    }

    /// Takes the active code. A change, even of the counter alone, is reported at once.
    ///
    /// `at` is the instant at which a frame can be sent, [`NEVER`] in bus-off. A code that comes and goes at one instant
    /// is reported when the frame can be made at that instant; a later DM1 has the present state alone.
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

    /// Queues the repetition that is due.
    #[must_use]
    pub fn poll(&mut self, now: Instant) -> Outcome {
        if now < self.next {
            return Outcome::Nothing;
        }
        self.next = next_in_grid(self.next, PERIOD, now);
        Outcome::Pending
    }

    /// Renders the message of the present state, or before it that of a code that only passed.
    #[must_use]
    pub fn render(&mut self, source: Address, now: Instant) -> Frame {
        if let Some(passing) = self.passing.take().filter(|_| self.changed == Some(now)) {
            self.rendered = Some(passing);
            // On a bus that does not take this message the present state replaces it then.
            self.next = delayed(now, PERIOD);
        } else {
            if self.changed.take().is_some() {
                self.next = if self.active.is_some() { delayed(now, PERIOD) } else { NEVER };
            }
            self.rendered = self.active;
        }
        single(Pgn::DM1, self.rendered, source)
    }

    /// Notes that the message is on the bus. After a code that only passed, the present state is pending.
    #[must_use]
    pub const fn sent(&self) -> Outcome {
        if self.changed.is_some() { Outcome::Pending } else { Outcome::Nothing }
    }

    /// Returns the code in the DM1 that was rendered last.
    #[must_use]
    pub const fn rendered(&self) -> Option<Trouble> {
        self.rendered
    }

    /// Returns when [`poll`](Self::poll) is next due.
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

/// Returns the next instant of a cycle after `due`. After a pause longer than a period the cycle begins anew at `now`:
/// the bus gets no burst of what was missed.
pub(super) fn next_in_grid(due: Instant, period: Duration, now: Instant) -> Instant {
    let planned = delayed(due, period);
    if planned > now { planned } else { delayed(now, period) }
}

/// Returns the message of one trouble code, or of none, in a single frame.
pub(super) fn single(pgn: Pgn, trouble: Option<Trouble>, source: Address) -> Frame {
    Frame::full(id(pgn, source).id(), dm::single(trouble))
}

/// Returns the identifier of a diagnostic message.
#[inline]
pub(super) const fn id(pgn: Pgn, source: Address) -> J1939Id {
    J1939Id::global(Priority::DEFAULT, pgn, source)
}
