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

/// A client's "load" for the next start: unless there is none, the flag is written as set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Demanded {
    /// None, or one that could not be stored.
    No,
    /// Its write waits or is in flight.
    Unstored,
    /// The memory holds the flag, and the client was told so.
    Stored,
}

/// The restore flag: what it stands for, and what it is to become.
#[derive(Clone, Debug)]
pub(super) struct Load {
    pub(super) executed: Executed,
    demanded: Demanded,
    retry_at: Instant,
}

impl Load {
    /// Returns the state of a memory whose flag is not set.
    pub(super) const fn new() -> Self {
        Self { executed: Executed::Done, demanded: Demanded::No, retry_at: NEVER }
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

    /// Notes that a client demands a "load".
    pub(super) fn demand(&mut self) {
        if self.demanded == Demanded::No {
            self.demanded = Demanded::Unstored;
        }
    }

    /// Returns what the flag is to be written as.
    pub(super) fn flag(&self) -> bool {
        self.demanded != Demanded::No
    }

    /// Takes the memory's answer to a write of the flag. The last write settles a client's "load", too.
    pub(super) fn flag_written(&mut self, stored: bool, is_last: bool, now: Instant) {
        if is_last && self.demanded == Demanded::Unstored {
            self.demanded = if stored { Demanded::Stored } else { Demanded::No };
        }
        if !stored {
            self.failed(now);
        } else if self.executed == Executed::FlagUncleared {
            // While the defaults are not stored, the flag was set again for a client.
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
