//! The schedule of the fault log (SPEC 6). The log is written within a second of its first change, then at most every
//! ten seconds. After a clearing, the next change counts as the first.

use crate::time::{Duration, Instant, NEVER, delayed};

/// The time for which a changed fault log waits for further changes (A).
pub const FAULT_LOG_DELAY: Duration = Duration::from_millis(500);

/// The minimum time between two writes of the fault log (A).
pub const FAULT_LOG_INTERVAL: Duration = Duration::from_secs(10);

/// The schedule of fault log writes.
#[derive(Clone, Debug)]
pub struct FaultLogClock {
    /// The due time of the next write; [`NEVER`] once the present counters are stored or being written.
    due: Instant,
    /// The earliest time of the next write.
    earliest: Instant,
}

impl FaultLogClock {
    /// Creates the schedule for a fault log that needs no write.
    #[must_use]
    pub const fn new() -> Self {
        Self { due: NEVER, earliest: Instant::MIN }
    }

    /// Records a change of a counter.
    pub fn changed(&mut self, now: Instant) {
        if !self.is_dirty() {
            self.due = delayed(now, FAULT_LOG_DELAY).max(self.earliest);
        }
    }

    /// Returns the due time of the next write; [`NEVER`] if none is needed.
    #[inline]
    #[must_use]
    pub const fn due(&self) -> Instant {
        self.due
    }

    /// Returns whether a write of the present counters is needed and has not begun.
    #[must_use]
    pub fn is_dirty(&self) -> bool {
        self.due != NEVER
    }

    /// Records that a write of the present counters has begun.
    pub const fn begun(&mut self) {
        self.due = NEVER;
    }

    /// Records that a write has begun which clears counters. The next change counts as the first.
    pub const fn clearing(&mut self) {
        *self = Self::new();
    }

    /// Records the end of a write that is not a successful clearing. A failed write is repeated after
    /// [`FAULT_LOG_INTERVAL`].
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
