//! The restore flag: the execution of a "load" at a start, and the "load" that a client demands (SPEC 4.5, 6).
//!
//! A start that finds the restore flag set executes a "load": the valve uses the defaults, stores them, and then clears
//! the flag. A "save" before the end of this "load" stores its parameters instead of the defaults. The "save" is
//! answered only after the flag is cleared, because otherwise the next start would overwrite the saved parameters.
//!
//! A client's "load" sets the flag for the next start. A later "save" leaves the flag set (R). Once the defaults or
//! newer parameters are stored, a write that sets the flag also completes the executed "load".

use crate::time::{Duration, Instant, NEVER, delayed};

/// The delay after which a failed write of an executed "load" is repeated (A).
const RETRY: Duration = Duration::from_secs(10);

/// The progress of the "load" that this start executes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Executed {
    /// No "load" was executed, or all its writes are done.
    Done,
    /// The flag is set. The stored parameters are older than the "load".
    DefaultsUnstored,
    /// The flag is set. The stored parameters are newer than the "load".
    FlagUncleared,
}

/// The "load" that a client demands for the next start. While there is a demand, a write of the flag sets the flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Demanded {
    /// No demand, or a demand that could not be stored.
    No,
    /// The write of the flag is queued or in progress.
    Unstored,
    /// The memory holds the flag, and the client has its positive answer.
    Stored,
}

/// The progress of the executed "load", and the demanded "load".
#[derive(Clone, Debug)]
pub(super) struct Load {
    pub(super) executed: Executed,
    demanded: Demanded,
    retry_at: Instant,
}

impl Load {
    /// Creates the state of a memory whose flag is not set.
    pub(super) const fn new() -> Self {
        Self { executed: Executed::Done, demanded: Demanded::No, retry_at: NEVER }
    }

    /// Creates the state at a start. `executes` is true if the start executes a "load".
    pub(super) const fn found(executes: bool) -> Self {
        let executed = if executes { Executed::DefaultsUnstored } else { Executed::Done };
        Self { executed, ..Self::new() }
    }

    /// Returns whether the defaults replace the stored parameters, because an executed "load" has not stored the
    /// defaults yet (A).
    pub(super) fn replaces_stored(&self) -> bool {
        self.executed == Executed::DefaultsUnstored
    }

    /// Records that parameters newer than the executed "load" are stored. Returns whether the flag must be cleared.
    pub(super) fn parameters_stored(&mut self) -> bool {
        if self.executed == Executed::DefaultsUnstored {
            self.executed = Executed::FlagUncleared;
        }
        self.executed == Executed::FlagUncleared
    }

    /// Records a client's "load".
    pub(super) fn demand(&mut self) {
        if self.demanded == Demanded::No {
            self.demanded = Demanded::Unstored;
        }
    }

    /// Returns the flag to write. It is set if a client demands a "load".
    pub(super) fn flag(&self) -> bool {
        self.demanded != Demanded::No
    }

    /// Handles the result of a flag write. If `is_last`, no equal write waits, and the result decides a client's
    /// "load".
    pub(super) fn flag_written(&mut self, stored: bool, is_last: bool, now: Instant) {
        if is_last && self.demanded == Demanded::Unstored {
            self.demanded = if stored { Demanded::Stored } else { Demanded::No };
        }
        if !stored {
            self.failed(now);
        } else if self.executed == Executed::FlagUncleared {
            // Before the defaults are stored, only a client's "load" writes the flag. Such a write sets the flag and
            // does not complete the executed "load".
            self.executed = Executed::Done;
            self.retry_at = NEVER;
        }
    }

    /// Schedules a retry after a failed write of the executed "load".
    pub(super) fn failed(&mut self, now: Instant) {
        if self.executed != Executed::Done {
            self.retry_at = delayed(now, RETRY);
        }
    }

    /// Returns the time of the next retry; [`NEVER`] if none is scheduled.
    #[inline]
    pub(super) const fn retry_at(&self) -> Instant {
        self.retry_at
    }

    /// Returns whether a retry is due. A busy memory postpones the retry.
    pub(super) fn retry(&mut self, now: Instant, busy: bool) -> bool {
        let due = now >= self.retry_at;
        if due {
            self.retry_at = if busy { delayed(now, RETRY) } else { NEVER };
        }
        due && !busy
    }
}
