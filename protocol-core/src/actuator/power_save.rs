//! Power save, which switches off the solenoids of a blocked valve (SPEC 2).

use crate::time::{Duration, Instant, NEVER, delayed};

/// The time for which set-point and spool must both be neutral before the solenoids switch off.
pub const POWER_SAVE_DELAY: Duration = Duration::from_millis(200);

/// The state of power save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PowerSave {
    /// The set-point is not neutral.
    Off,
    /// The set-point is neutral, but the spool is not. An undisturbed spool reaches neutral at this time.
    Returning(Instant),
    /// The valve is blocked. Power save begins at this time or when the spool comes to rest, whichever is later.
    Waiting(Instant),
    /// The solenoids are off.
    On,
}

impl PowerSave {
    /// Updates the state. `set_point` and `spool` are true if set-point and spool are neutral; `rests` is the time at
    /// which the spool comes to rest. The delay begins once both are neutral (R).
    pub(super) fn update(&mut self, set_point: bool, spool: bool, rests: Instant, now: Instant) {
        let wait = |due: Instant| if due.max(rests) <= now { Self::On } else { Self::Waiting(due) };
        *self = match *self {
            _ if !set_point => Self::Off,
            _ if !spool => Self::Returning(NEVER),
            Self::Off => Self::Waiting(delayed(now, POWER_SAVE_DELAY)),
            // At a late call the spool may have reached neutral some time ago.
            Self::Returning(back) => wait(delayed(back.min(now), POWER_SAVE_DELAY)),
            Self::Waiting(due) => wait(due),
            Self::On => Self::On,
        };
    }

    /// Records the time at which a returning spool reaches neutral. `back` computes this time, and is called only in
    /// the state [`Returning`](Self::Returning).
    pub(super) fn note_return(&mut self, back: impl FnOnce() -> Instant) {
        if let Self::Returning(expected) = self {
            *expected = back();
        }
    }

    /// Returns the time of the next state change; `rests` is the time at which the spool comes to rest.
    pub(super) fn due(self, rests: Instant) -> Instant {
        match self {
            Self::Returning(back) => back,
            Self::Waiting(due) => due.max(rests),
            Self::Off | Self::On => NEVER,
        }
    }
}
