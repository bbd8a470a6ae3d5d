//! What waits to be written to the memory, one record at a time, and when the fault log is due (SPEC 4.5, 6).

use heapless::Deque;

use crate::memory::RecordKey;
use crate::time::{Duration, Instant, NEVER, after};

/// A change of the fault log waits so long for more of its kind (A): it is written within one second.
pub(super) const FAULT_LOG_DELAY: Duration = Duration::from_millis(500);

/// Between two writes of the fault log lies at least so much (A).
pub(super) const FAULT_LOG_INTERVAL: Duration = Duration::from_secs(10);

/// More jobs than can wait at once: one of each kind, and those of clients that gave up and asked again.
const JOBS: usize = 16;

/// One write.
pub(super) trait Job: Copy + PartialEq {
    /// The record that is written.
    fn key(self) -> RecordKey;
}

/// The jobs, in order.
#[derive(Debug)]
pub(super) struct Storage<J> {
    waiting: Deque<J, JOBS>,
    in_flight: Option<J>,
}

impl<J: Job> Storage<J> {
    /// Nothing to be written.
    pub(super) const fn new() -> Self {
        Self { waiting: Deque::new(), in_flight: None }
    }

    /// Appends a job; `false` when there are too many.
    #[must_use]
    pub(super) fn ask(&mut self, job: J) -> bool {
        self.waiting.iter().any(|waiting| *waiting == job) || self.waiting.push_back(job).is_ok()
    }

    /// The next job to begin; none while one is in flight.
    pub(super) fn begin(&mut self) -> Option<J> {
        if self.in_flight.is_some() {
            return None;
        }
        self.in_flight = self.waiting.pop_front();
        self.in_flight
    }

    /// The job in flight.
    pub(super) const fn in_flight_mut(&mut self) -> Option<&mut J> {
        self.in_flight.as_mut()
    }

    /// The job in flight has ended.
    pub(super) fn end(&mut self, key: RecordKey) -> Option<J> {
        self.in_flight.take_if(|job| job.key() == key)
    }

    /// Whether nothing waits and nothing is in flight.
    pub(super) fn is_idle(&self) -> bool {
        self.in_flight.is_none() && self.waiting.is_empty()
    }
}

/// When the fault log is to be written.
#[derive(Debug)]
pub(super) struct FaultLogClock {
    /// [`NEVER`] while the memory holds what there is.
    due: Instant,
    last_write: Option<Instant>,
}

impl FaultLogClock {
    pub(super) const fn new() -> Self {
        Self { due: NEVER, last_write: None }
    }

    /// A counter has changed.
    pub(super) fn changed(&mut self, now: Instant) {
        if !self.is_dirty() {
            let soon = after(now, FAULT_LOG_DELAY);
            self.due = self.last_write.map_or(soon, |last| soon.max(after(last, FAULT_LOG_INTERVAL)));
        }
    }

    /// When the log is due.
    #[inline]
    pub(super) const fn due(&self) -> Instant {
        self.due
    }

    /// Whether the memory lags behind.
    pub(super) fn is_dirty(&self) -> bool {
        self.due != NEVER
    }

    /// The log is being written as it is now.
    pub(super) const fn begun(&mut self) {
        self.due = NEVER;
    }

    /// The write has ended.
    pub(super) fn ended(&mut self, stored: bool, now: Instant) {
        self.last_write = Some(now);
        if self.is_dirty() || !stored {
            self.due = NEVER;
            self.changed(now);
        }
    }
}
