//! The fault register: active faults, changes and occurrence counters (SPEC 2).

use super::counters::Counters;
use super::fault::{Fault, FaultSet, SPOOL_FAULTS};

/// The fault changes since the last [`Valve::take_changes`](super::Valve::take_changes).
///
/// The protocol reports the activations first, each set in order of priority. A fault in both sets became active and
/// then cleared. A fault that cleared and became active again is only in `activated`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// The faults that became active.
    pub activated: FaultSet,
    /// The faults that cleared.
    pub cleared: FaultSet,
}

impl Changes {
    /// Returns whether nothing has changed.
    #[inline]
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.activated.is_empty() && self.cleared.is_empty()
    }
}

/// The active faults, their changes, and the occurrence counters.
#[derive(Clone, Debug)]
pub(super) struct FaultRegister {
    pub(super) active: FaultSet,
    pub(super) changes: Changes,
    pub(super) counters: Counters,
    pub(super) counters_changed: bool,
    shared_spool_counter: bool,
}

impl FaultRegister {
    pub(super) const fn new(counters: Counters, shared_spool_counter: bool) -> Self {
        let changes = Changes { activated: FaultSet::EMPTY, cleared: FaultSet::EMPTY };
        Self { active: FaultSet::EMPTY, changes, counters, counters_changed: false, shared_spool_counter }
    }

    pub(super) fn set(&mut self, fault: Fault, active: bool) {
        if active {
            self.activate(fault);
        } else {
            self.clear(fault);
        }
    }

    /// Activates and counts a fault, unless it is already active.
    pub(super) fn activate(&mut self, fault: Fault) {
        if self.active.contains(fault) {
            return;
        }
        self.active.insert(fault);
        self.changes.activated.insert(fault);
        self.changes.cleared.remove(fault);
        let together =
            if self.shared_spool_counter && fault.is_of_spool() { SPOOL_FAULTS } else { FaultSet::of(fault) };
        for counted in together {
            self.counters_changed |= self.counters.count(counted);
        }
    }

    pub(super) fn clear(&mut self, fault: Fault) {
        if self.active.contains(fault) {
            self.active.remove(fault);
            self.changes.cleared.insert(fault);
        }
    }
}
