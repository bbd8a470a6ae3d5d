//! The load of the bus in the last second.

use super::clock::Nanos;

/// The number of equal parts into which a second is divided.
const PARTS: usize = 100;
const SECOND: Nanos = 1_000_000_000;
const PART: Nanos = SECOND / PARTS as Nanos;

/// The busy time in each part of the last second.
#[derive(Clone, Debug)]
pub(super) struct Load {
    busy: [Nanos; PARTS],
    /// The index of the latest part, counted from the start of the world.
    latest: u64,
}

impl Default for Load {
    fn default() -> Self {
        Self { busy: [0; PARTS], latest: 0 }
    }
}

impl Load {
    /// Adds a busy time of `time` that ends at `end`.
    pub(super) fn add(&mut self, time: Nanos, end: Nanos) {
        let part = end / PART;
        for skipped in (self.latest + 1..=part).take(PARTS) {
            self.busy[index(skipped)] = 0;
        }
        self.latest = part;
        self.busy[index(part)] += time;
    }

    /// Returns the load in the second before `now`, in percent.
    pub(super) fn percent(&self, now: Nanos) -> u8 {
        let oldest = (now / PART + 1).saturating_sub(PARTS as u64);
        let known = (self.latest + 1).saturating_sub(PARTS as u64);
        let busy: Nanos = (oldest.max(known)..=self.latest).map(|part| self.busy[index(part)]).sum();
        u8::try_from(busy * 100 / SECOND).unwrap_or(u8::MAX).min(100)
    }
}

const fn index(part: u64) -> usize {
    (part % PARTS as u64) as usize
}
