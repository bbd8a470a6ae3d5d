//! The queue of writes to the memory: one record at a time, in the order in which they were asked for (SPEC 4.5, 6).

use heapless::Vec;

use crate::memory::RecordKey;

/// The number of kinds of write that a device can have. Equal kinds share a place, so the queue cannot overflow.
const KINDS: usize = 12;

/// One write. The record is encoded when the write begins, so a job names a record and holds only what differs.
pub trait Job: Copy {
    /// Returns the record that the job writes.
    fn key(self) -> RecordKey;

    /// Returns the job that does for both when `newer` is the same kind of write, asked for while this one waits.
    fn merged(self, newer: Self) -> Option<Self>;
}

/// The writes that wait, and the one in flight.
#[derive(Debug)]
pub struct Writes<J> {
    /// The one in flight first, then those that wait, the next one first.
    jobs: Vec<J, { KINDS + 1 }>,
    /// The first one is in flight.
    in_flight: bool,
}

impl<J: Job> Writes<J> {
    /// Returns an empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self { jobs: Vec::new(), in_flight: false }
    }

    /// Appends a write, or merges it into one of its kind that waits. The write in flight is not touched: its record was
    /// encoded before.
    pub fn ask(&mut self, job: J) {
        for waiting in self.jobs.iter_mut().skip(usize::from(self.in_flight)) {
            if let Some(merged) = waiting.merged(job) {
                *waiting = merged;
                return;
            }
        }
        // There is a place for every kind.
        let _ = self.jobs.push(job);
    }

    /// Puts a write before all that wait: the second half of one that must not be parted.
    pub fn ask_first(&mut self, job: J) {
        let _ = self.jobs.insert(usize::from(self.in_flight), job);
    }

    /// Returns the next write and puts it in flight; `None` while one is.
    pub fn begin(&mut self) -> Option<J> {
        let next = self.jobs.first().filter(|_| !self.in_flight)?;
        self.in_flight = true;
        Some(*next)
    }

    /// Returns the write in flight.
    pub fn in_flight_mut(&mut self) -> Option<&mut J> {
        self.jobs.first_mut().filter(|_| self.in_flight)
    }

    /// Ends the write in flight and returns it; `None` when it writes another record than `key`.
    pub fn end(&mut self, key: RecordKey) -> Option<J> {
        self.in_flight_mut().filter(|job| job.key() == key)?;
        self.in_flight = false;
        Some(self.jobs.remove(0))
    }

    /// Returns the writes that wait, the next one first, after the one in flight.
    pub fn iter(&self) -> impl Iterator<Item = &J> {
        self.jobs.iter()
    }

    /// Returns whether nothing waits and nothing is in flight.
    #[inline]
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.jobs.is_empty()
    }
}

impl<J: Job> Default for Writes<J> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Write {
        Save(u8),
        Log,
    }

    impl Job for Write {
        fn key(self) -> RecordKey {
            match self {
                Self::Save(_) => RecordKey::Parameters,
                Self::Log => RecordKey::FaultLog,
            }
        }

        fn merged(self, newer: Self) -> Option<Self> {
            (self.key() == newer.key()).then_some(newer)
        }
    }

    #[test]
    fn writes_of_one_kind_wait_once_and_keep_their_turn() {
        let mut writes = Writes::new();
        for ticket in 0..100 {
            writes.ask(Write::Save(ticket));
            writes.ask(Write::Log);
        }
        assert_eq!(writes.begin(), Some(Write::Save(99)));
        assert_eq!(writes.begin(), None, "one at a time");
        assert_eq!(writes.end(RecordKey::FaultLog), None, "not in flight");
        // The record of the one in flight is older than this request.
        writes.ask(Write::Save(100));
        assert_eq!(writes.end(RecordKey::Parameters), Some(Write::Save(99)));
        assert_eq!(writes.begin(), Some(Write::Log));
        assert_eq!(writes.end(RecordKey::FaultLog), Some(Write::Log));
        assert!(!writes.is_idle());
        assert_eq!(writes.begin(), Some(Write::Save(100)));
        assert_eq!(writes.end(RecordKey::Parameters), Some(Write::Save(100)));
        assert!(writes.is_idle());
    }

    #[test]
    fn the_second_half_of_a_write_comes_before_all_others() {
        let mut writes = Writes::new();
        writes.ask(Write::Save(1));
        writes.ask_first(Write::Log);
        assert_eq!(writes.begin(), Some(Write::Log));
    }
}
