//! Rules (`reactions`) that act on a frame or its absence, independently of the steps.

use protocol_core::time::{Duration, Instant, NEVER, after};

use crate::simulation::{Command, Happened};
use crate::state::Pattern;

#[derive(Debug)]
pub(super) struct Reaction {
    pub(super) frame: Pattern,
    /// If given, the rule acts when no such frame from a device has come for this time; the first such frame starts the
    /// supervision. Otherwise, the rule acts on such a frame from a device.
    pub(super) missing: Option<Duration>,
    pub(super) act: Command,
    /// The time before which the rule ignores frames.
    pub(super) from: Instant,
    /// True if the rule acts each time instead of once.
    pub(super) again: bool,
}

/// The rules of a run.
#[derive(Clone)]
pub(super) struct Reactions<'a> {
    rules: Vec<Rule<'a>>,
}

#[derive(Clone)]
struct Rule<'a> {
    reaction: &'a Reaction,
    /// The instant at which a frame has been missing for too long; [`NEVER`] before the first frame.
    due: Instant,
    /// True if the rule must act now.
    acts: bool,
    is_spent: bool,
}

impl<'a> Reactions<'a> {
    pub(super) fn new(reactions: &'a [Reaction]) -> Self {
        let rule = |reaction| Rule { reaction, due: NEVER, acts: false, is_spent: false };
        Self { rules: reactions.iter().map(rule).collect() }
    }

    /// Observes an event. Ignores everything except frames that the master receives.
    pub(super) fn observe(&mut self, happened: &Happened) {
        let Some(frame) = happened.event.frame().filter(|_| happened.is_received) else { return };
        for rule in self.rules.iter_mut().filter(|rule| !rule.is_spent) {
            let Reaction { frame: pattern, missing, from, .. } = rule.reaction;
            if happened.event.at < *from || !pattern.matches(frame) {
                continue;
            }
            match missing {
                Some(span) => rule.due = after(happened.event.at, *span),
                None => rule.act(),
            }
        }
    }

    /// Returns the next instant at which a rule acts on a missing frame.
    pub(super) fn due(&self) -> Instant {
        self.rules.iter().map(|rule| rule.due).min().unwrap_or(NEVER)
    }

    /// Returns the actions due by now, in the order of the rules.
    pub(super) fn take_acts(&mut self, now: Instant) -> Vec<&'a Command> {
        let mut acts = Vec::new();
        for rule in &mut self.rules {
            if rule.due <= now {
                rule.act();
            }
            if std::mem::take(&mut rule.acts) {
                acts.push(&rule.reaction.act);
            }
        }
        acts
    }
}

impl Rule<'_> {
    fn act(&mut self) {
        (self.acts, self.due, self.is_spent) = (true, NEVER, !self.reaction.again);
    }
}
