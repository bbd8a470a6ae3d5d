//! The occurrence counters of the faults (SPEC 2).

use super::fault::{Fault, FaultSet};

/// The maximum value of a counter.
pub const COUNTER_MAX: u8 = 127;

/// The occurrence counters of all faults, each 0–127.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters([u8; Fault::ALL.len()]);

impl Counters {
    /// All counters at 0.
    pub const NONE: Self = Self([0; Fault::ALL.len()]);

    /// Decodes stored bytes, in order of priority. A byte above 127 becomes 127.
    #[must_use]
    pub fn from_bytes(bytes: [u8; Fault::ALL.len()]) -> Self {
        Self(bytes.map(|count| count.min(COUNTER_MAX)))
    }

    /// Encodes the counters, in order of priority.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; Fault::ALL.len()] {
        self.0
    }

    /// Returns the number of occurrences of a fault, including the present occurrence (R: the manual says
    /// "previously").
    #[must_use]
    pub fn get(&self, fault: Fault) -> u8 {
        self.0.get(fault.index()).copied().unwrap_or(0)
    }

    /// Returns a copy in which the counters of `faults` are 0.
    #[must_use]
    pub fn without(mut self, faults: FaultSet) -> Self {
        self.clear(faults);
        self
    }

    /// Returns the sums of the counters, limited to 127.
    #[must_use]
    pub fn plus(mut self, other: Self) -> Self {
        for (count, more) in self.0.iter_mut().zip(other.0) {
            *count = count.saturating_add(more).min(COUNTER_MAX);
        }
        self
    }

    /// Sets the counters of `faults` to 0.
    pub(super) fn clear(&mut self, faults: FaultSet) {
        for fault in faults {
            self.set(fault, 0);
        }
    }

    /// Increments the counter of a fault, up to 127. Returns whether the counter changed.
    pub(super) fn count(&mut self, fault: Fault) -> bool {
        self.set(fault, self.get(fault).saturating_add(1).min(COUNTER_MAX))
    }

    fn set(&mut self, fault: Fault, count: u8) -> bool {
        self.0.get_mut(fault.index()).is_some_and(|slot| core::mem::replace(slot, count) != count)
    }
}
