//! The progress of a "load" and its execution in the memory (SPEC 4.5, 6).
//!
//! The start that finds the flag set works with the defaults. It stores them, and then clears the flag. A "save" while
//! the executed "load" is not done takes the place of the defaults. It is acknowledged only when the flag is cleared,
//! or the next start would wipe it. A client's "load" sets the flag for the next start, and a "save" after it leaves
//! the flag set (R). Once the defaults are stored, the executed "load" has nothing left to clear.

use crate::time::{Duration, Instant, NEVER, delayed};

/// The time after which a write of an executed "load" that failed is tried again (A).
const RETRY: Duration = Duration::from_secs(10);

/// The executed "load" in the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Executed {
    /// The flag does not stand for it.
    Done,
    /// The flag is set, and the stored parameters are those from before it.
    DefaultsUnstored,
    /// The flag is set, the stored parameters are newer.
    FlagUncleared,
}

/// The restore flag: what it stands for, and what it is to become.
#[derive(Clone, Debug)]
pub(super) struct Load {
    pub(super) executed: Executed,
    /// A client has asked for the next start to load the defaults: what the flag is written as.
    pub(super) asked: bool,
    /// The memory holds the flag for a client that was told so: what is asked for when a later write fails.
    pub(super) acknowledged: bool,
    /// A "save" is stored and waits for the flag to be cleared.
    pub(super) save_waits: bool,
    retry_at: Instant,
}

impl Load {
    /// Returns the state of a memory whose flag is not set.
    pub(super) const fn new() -> Self {
        Self { executed: Executed::Done, asked: false, acknowledged: false, save_waits: false, retry_at: NEVER }
    }

    /// Returns the state at a start that executes a "load", or has none to execute.
    pub(super) const fn found(executes: bool) -> Self {
        let executed = if executes { Executed::DefaultsUnstored } else { Executed::Done };
        Self { executed, ..Self::new() }
    }

    /// Returns whether the defaults are in force, because those of an executed "load" are not stored yet (A).
    pub(super) fn replaces_stored(&self) -> bool {
        self.executed == Executed::DefaultsUnstored
    }

    /// Notes that parameters are stored which are newer than the executed load. Returns whether the flag is still set.
    pub(super) fn parameters_stored(&mut self) -> bool {
        if self.executed == Executed::DefaultsUnstored {
            self.executed = Executed::FlagUncleared;
        }
        self.executed == Executed::FlagUncleared
    }

    /// Notes that the flag was written, as it is asked for unless another write of it waits. While the defaults are not
    /// stored, it was set again for a client.
    pub(super) fn flag_stored(&mut self, is_last: bool) {
        if is_last {
            self.acknowledged = self.asked;
        }
        if self.executed == Executed::FlagUncleared {
            self.executed = Executed::Done;
            self.retry_at = NEVER;
        }
    }

    /// Notes that a write of the executed load has failed: it is tried again.
    pub(super) fn failed(&mut self, now: Instant) {
        if self.executed != Executed::Done {
            self.retry_at = delayed(now, RETRY);
        }
    }

    /// Returns when a write is to be tried again.
    #[inline]
    pub(super) const fn retry_at(&self) -> Instant {
        self.retry_at
    }

    /// Takes note that the time for it has come; while the memory is busy it is put off.
    pub(super) fn retry(&mut self, now: Instant, busy: bool) -> bool {
        let due = now >= self.retry_at;
        if due {
            self.retry_at = if busy { delayed(now, RETRY) } else { NEVER };
        }
        due && !busy
    }
}
