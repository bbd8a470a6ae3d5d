//! Power save: the solenoids rest while the valve is blocked (SPEC 2).

use crate::time::{Duration, Instant, NEVER, delayed};

/// How long the valve must be blocked.
pub const POWER_SAVE_DELAY: Duration = Duration::from_millis(200);

/// Whether the solenoids are spared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PowerSave {
    /// The valve is not blocked.
    Off,
    /// It is blocked; power save begins then, or when the spool has come to rest in neutral.
    Waiting(Instant),
    /// The solenoids are off.
    On,
}

impl PowerSave {
    /// Takes whether the valve is blocked, whether the spool is in neutral, and since when it rests, or will.
    pub(super) fn update(&mut self, blocked: bool, in_neutral: bool, rests: Instant, now: Instant) {
        *self = match *self {
            _ if !blocked => Self::Off,
            Self::Waiting(due) if in_neutral && due.max(rests) <= now => Self::On,
            Self::Off => Self::Waiting(delayed(now, POWER_SAVE_DELAY)),
            Self::On if !in_neutral => Self::Waiting(delayed(now, POWER_SAVE_DELAY)),
            unchanged => unchanged,
        };
    }

    /// Returns when it begins, if the spool comes to rest in neutral at `rests`.
    pub(super) fn due(self, rests: Instant) -> Instant {
        match self {
            Self::Waiting(due) => due.max(rests),
            Self::Off | Self::On => NEVER,
        }
    }
}
