//! Power save: the solenoids rest while the valve is blocked (SPEC 2).

use crate::time::{Duration, Instant, NEVER, delayed};

/// Time that set-point and spool must both be neutral.
pub const POWER_SAVE_DELAY: Duration = Duration::from_millis(200);

/// State of power save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PowerSave {
    /// The set-point is not neutral.
    Off,
    /// The set-point is neutral, the spool is not: it comes back at this instant, if nothing else happens to it.
    Returning(Instant),
    /// The valve is blocked; power save begins at this instant, or when the spool has come to rest.
    Waiting(Instant),
    /// The solenoids are off.
    On,
}

impl PowerSave {
    /// Takes whether the set-point and the spool are neutral, and since when the spool rests, or will. The delay counts
    /// from the instant when both are: that is *blocked* as the manual's introduction defines it (R).
    pub(super) fn update(&mut self, set_point: bool, spool: bool, rests: Instant, now: Instant) {
        let wait = |due: Instant| if due.max(rests) <= now { Self::On } else { Self::Waiting(due) };
        *self = match *self {
            _ if !set_point => Self::Off,
            _ if !spool => Self::Returning(NEVER),
            Self::Off => Self::Waiting(delayed(now, POWER_SAVE_DELAY)),
            // A late look finds a spool that has been there for a while.
            Self::Returning(back) => wait(delayed(back.min(now), POWER_SAVE_DELAY)),
            Self::Waiting(due) => wait(due),
            Self::On => Self::On,
        };
    }

    /// Notes when a spool that is out of neutral comes back.
    pub(super) fn note_return(&mut self, back: impl FnOnce() -> Instant) {
        if let Self::Returning(expected) = self {
            *expected = back();
        }
    }

    /// Returns when the state changes next, if the spool comes to rest at `rests`.
    pub(super) fn due(self, rests: Instant) -> Instant {
        match self {
            Self::Returning(back) => back,
            Self::Waiting(due) => due.max(rests),
            Self::Off | Self::On => NEVER,
        }
    }
}
