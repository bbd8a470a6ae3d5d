//! The schedule of the fault log (SPEC 6): written within a second of the first change, then at most every ten seconds.
//! The change after a clearing counts as a first one.

use crate::time::{Duration, Instant, NEVER, delayed};

/// The time for which a change of the fault log waits for more changes (A): the log is written within one second.
pub const FAULT_LOG_DELAY: Duration = Duration::from_millis(500);

/// The least time between two writes of the fault log (A).
pub const FAULT_LOG_INTERVAL: Duration = Duration::from_secs(10);

/// The time at which the fault log is due.
#[derive(Clone, Debug)]
pub struct FaultLogClock {
    /// [`NEVER`] while the memory holds the present counters, or is being given them.
    due: Instant,
    /// No write is due before this.
    earliest: Instant,
}

impl FaultLogClock {
    /// Returns the clock of a log that the memory holds.
    #[must_use]
    pub const fn new() -> Self {
        Self { due: NEVER, earliest: Instant::MIN }
    }

    /// Notes that a counter has changed.
    pub fn changed(&mut self, now: Instant) {
        if !self.is_dirty() {
            self.due = delayed(now, FAULT_LOG_DELAY).max(self.earliest);
        }
    }

    /// Returns when the log is due; [`NEVER`] when the memory holds it.
    #[inline]
    #[must_use]
    pub const fn due(&self) -> Instant {
        self.due
    }

    /// Returns whether a counter has changed since the last write began.
    #[must_use]
    pub fn is_dirty(&self) -> bool {
        self.due != NEVER
    }

    /// Notes that the log is being written as it is now.
    pub const fn begun(&mut self) {
        self.due = NEVER;
    }

    /// Notes that the log is being written with cleared counters: the next change is a first one.
    pub const fn clearing(&mut self) {
        *self = Self::new();
    }

    /// Notes that the write has ended; a failed one is due again. A clearing that is stored needs no note.
    pub fn ended(&mut self, stored: bool, now: Instant) {
        self.earliest = delayed(now, FAULT_LOG_INTERVAL);
        if self.is_dirty() || !stored {
            self.due = self.earliest;
        }
    }
}

impl Default for FaultLogClock {
    fn default() -> Self {
        Self::new()
    }
}
