//! Which device is next due, and when.

use std::collections::BTreeSet;

use protocol_core::time::{Instant, NEVER};

/// The due times of all devices, in the order of time, then of the devices' numbers.
#[derive(Debug, Default)]
pub(super) struct Agenda {
    queue: BTreeSet<(Instant, usize)>,
    /// When each device is due, by its number.
    due: Vec<Instant>,
}

impl Agenda {
    /// Room for one more device, which is not due.
    pub(super) fn add(&mut self) {
        self.due.push(NEVER);
    }

    #[inline]
    pub(super) fn set(&mut self, node: usize, due: Instant) {
        if self.due[node] != due {
            self.reschedule(node, due);
        }
    }

    fn reschedule(&mut self, node: usize, due: Instant) {
        let before = std::mem::replace(&mut self.due[node], due);
        if before != NEVER {
            self.queue.remove(&(before, node));
        }
        if due != NEVER {
            self.queue.insert((due, node));
        }
    }

    /// When the next device is due.
    pub(super) fn next(&self) -> Instant {
        self.queue.first().map_or(NEVER, |(due, _)| *due)
    }

    /// The next device that is due by `now`.
    pub(super) fn due_by(&self, now: Instant) -> Option<usize> {
        self.queue.first().filter(|(due, _)| *due <= now).map(|(_, node)| *node)
    }
}
