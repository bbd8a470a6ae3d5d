//! Verdicts on cells, and the observations behind them.

use protocol_core::time::Duration;
use serde::{Deserialize, Serialize};

/// The verdict on a cell, from the best to the worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The fault had no effect on a device, and nothing was detected.
    NoEffect,
    /// Detected and safe, both within their limits.
    Safe,
    /// Detected and safe, but at least one limit is exceeded.
    Late,
    /// Safe within the limit, but not detected.
    SafeUndetected,
    /// Detected, but not safe within the observation.
    NotSafe,
    /// Not detected, and not safe within the limit.
    Undetected,
    /// The controller ended, panicked or failed before the verdict.
    Hung,
    /// A fault changed nothing, so the cell proves nothing.
    NotInjected,
}

/// The limits of the oracles; `None` if the plan lacks the oracle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The longest accepted time from the fault to its detection.
    pub detected: Option<Duration>,
    /// The longest accepted time from the fault to the safe state.
    pub safe: Option<Duration>,
}

/// The observations of a cell. Times count from the fault, or from the last of several faults; `None` if the oracle was
/// not met within the observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observed {
    /// The number of frames that a communication fault affected; for a plant or power fault, 1 if the plant or the power
    /// changed. The smallest of these numbers for several faults.
    pub struck: u64,
    /// True if the controller was alive at the end of the cell.
    pub is_alive: bool,
    /// True if, after the injection, the state of a device differed from the golden run or, with an inexact controller,
    /// also from its state before the fault.
    pub had_effect: bool,
    /// The time to the detection.
    pub detected: Option<Duration>,
    /// The time to the safe state.
    pub safe: Option<Duration>,
}

impl Verdict {
    /// All verdicts, from the best to the worst.
    pub const ALL: [Self; 8] = [
        Self::NoEffect,
        Self::Safe,
        Self::Late,
        Self::SafeUndetected,
        Self::NotSafe,
        Self::Undetected,
        Self::Hung,
        Self::NotInjected,
    ];

    /// Returns the verdict on a cell. A missing oracle counts as fulfilled.
    #[must_use]
    pub fn of(observed: &Observed, limits: &Limits) -> Self {
        let Observed { struck, is_alive, had_effect, detected, safe } = *observed;
        if struck == 0 {
            return Self::NotInjected;
        }
        if !is_alive {
            return Self::Hung;
        }
        if !had_effect && detected.is_none() {
            return Self::NoEffect;
        }
        // (fulfilled, fulfilled within the limit)
        let judged = |limit: Option<Duration>, held: Option<Duration>| match limit {
            None => (true, true),
            Some(limit) => (held.is_some(), held.is_some_and(|held| held <= limit)),
        };
        match (judged(limits.detected, detected), judged(limits.safe, safe)) {
            ((_, true), (_, true)) => Self::Safe,
            ((true, _), (true, _)) => Self::Late,
            ((true, _), (false, _)) => Self::NotSafe,
            ((false, _), (_, true)) => Self::SafeUndetected,
            ((false, _), (_, false)) => Self::Undetected,
        }
    }

    /// Returns a key that orders cells by severity: by verdict, then by reaction time in microseconds. A missing reaction
    /// is the worst, except with the verdict [`NoEffect`](Self::NoEffect).
    #[must_use]
    pub fn severity(self, reaction_us: Option<u64>) -> (Self, bool, u64) {
        (self, reaction_us.is_none() && self != Self::NoEffect, reaction_us.unwrap_or(0))
    }

    /// Returns whether the verdict is a pass: [`NoEffect`](Self::NoEffect) or [`Safe`](Self::Safe).
    #[must_use]
    pub const fn passed(self) -> bool {
        matches!(self, Self::NoEffect | Self::Safe)
    }

    /// Returns the verdict's word in results.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::NoEffect => "no-effect",
            Self::Safe => "safe",
            Self::Late => "late",
            Self::SafeUndetected => "safe-undetected",
            Self::NotSafe => "not-safe",
            Self::Undetected => "undetected",
            Self::Hung => "hung",
            Self::NotInjected => "not-injected",
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.word())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits =
        Limits { detected: Some(Duration::from_millis(100)), safe: Some(Duration::from_millis(200)) };

    fn verdict(detected: Option<u64>, safe: Option<u64>, limits: Limits) -> Verdict {
        let ms = |time: Option<u64>| time.map(Duration::from_millis);
        let observed = Observed { struck: 1, is_alive: true, had_effect: true, detected: ms(detected), safe: ms(safe) };
        Verdict::of(&observed, &limits)
    }

    #[test]
    fn the_limits_are_inclusive() {
        for (detected, safe, wanted) in [
            (Some(100), Some(200), Verdict::Safe),
            (Some(101), Some(0), Verdict::Late),
            (Some(0), Some(201), Verdict::Late),
            (Some(100), None, Verdict::NotSafe),
            (None, Some(200), Verdict::SafeUndetected),
            (None, Some(201), Verdict::Undetected),
            (None, None, Verdict::Undetected),
        ] {
            assert_eq!(verdict(detected, safe, LIMITS), wanted, "{detected:?} {safe:?}");
        }
    }

    #[test]
    fn a_missing_oracle_counts_as_fulfilled() {
        let alone = |limits| [Some(100), Some(300), None].map(|time| verdict(time, time, limits));
        let (no_detected, no_safe) = (Limits { detected: None, ..LIMITS }, Limits { safe: None, ..LIMITS });
        assert_eq!(alone(no_detected), [Verdict::Safe, Verdict::Late, Verdict::NotSafe]);
        assert_eq!(alone(no_safe), [Verdict::Safe, Verdict::Late, Verdict::SafeUndetected]);
    }

    #[test]
    fn a_fault_that_did_not_act_never_passes() {
        let nothing = Observed { struck: 0, is_alive: true, had_effect: false, detected: None, safe: None };
        assert_eq!(Verdict::of(&nothing, &LIMITS), Verdict::NotInjected);
        let injected = Observed { struck: 1, ..nothing };
        assert_eq!(Verdict::of(&injected, &LIMITS), Verdict::NoEffect);
        assert_eq!(Verdict::of(&Observed { is_alive: false, ..injected }, &LIMITS), Verdict::Hung);
        let detected = Observed { detected: Some(Duration::from_millis(1)), ..injected };
        assert_ne!(Verdict::of(&detected, &LIMITS), Verdict::NoEffect);
        let passed: Vec<&str> = Verdict::ALL.into_iter().filter(|it| it.passed()).map(Verdict::word).collect();
        assert_eq!(passed, ["no-effect", "safe"]);
        assert!(Verdict::ALL.is_sorted());
    }

    #[test]
    fn the_word_is_the_word_of_results() {
        for verdict in Verdict::ALL {
            assert_eq!(serde_json::to_value(verdict).ok(), Some(verdict.word().into()));
        }
    }
}
