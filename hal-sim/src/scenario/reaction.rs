//! Rules (`reactions`) that act on a frame or its absence, independently of the steps.

use protocol_core::time::{Duration, Instant, NEVER, after};

use super::OWN;
use crate::bus::FaultEffect;
use crate::simulation::{Command, Happened};
use crate::state::Pattern;
use crate::world::EventKind;

#[derive(Debug)]
pub(super) struct Reaction {
    pub(super) trigger: Trigger,
    pub(super) act: Command,
    /// The time before which the rule ignores frames.
    pub(super) from: Duration,
    /// True if the rule acts each time instead of once.
    pub(super) again: bool,
}

/// The trigger of a rule.
#[derive(Debug)]
pub(super) enum Trigger {
    /// A frame from a device.
    On(Pattern),
    /// No frame from a device for this time. The first such frame starts the supervision.
    Missing(Pattern, Duration),
}

/// The rules of a run.
#[derive(Clone)]
pub(super) struct Reactions<'a> {
    rules: Vec<Rule<'a>>,
    /// True if a fault hides the next frame from the master.
    is_lost: bool,
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
        Self { rules: reactions.iter().map(rule).collect(), is_lost: false }
    }

    /// Observes an event. Ignores frames from the master, and frames that a fault hides from the master.
    pub(super) fn observe(&mut self, happened: &Happened) {
        if self.rules.is_empty() {
            return;
        }
        match &happened.event.what {
            // The event of a loss precedes the event of the lost frame.
            EventKind::Fault { effect: FaultEffect::Lost(receivers), .. } => {
                self.is_lost |= receivers.is_empty() || receivers.iter().any(|name| **name == *OWN);
            }
            EventKind::Frame { frame, .. } => {
                let is_lost = std::mem::take(&mut self.is_lost);
                if is_lost || *happened.event.who == *OWN {
                    return;
                }
                for rule in self.rules.iter_mut().filter(|rule| !rule.is_spent) {
                    let Reaction { trigger, from, .. } = rule.reaction;
                    if happened.event.at < after(Instant::from_ticks(0), *from) {
                        continue;
                    }
                    match trigger {
                        Trigger::On(pattern) if pattern.matches(frame) => rule.act(),
                        Trigger::Missing(pattern, span) if pattern.matches(frame) => {
                            rule.due = after(happened.event.at, *span);
                        }
                        _ => {}
                    }
                }
            }
            _ => {}
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
