//! A strict scenario: each frame of a device is claimed by the step that expects it.

use protocol_core::frame::Id;
use protocol_core::time::{Duration, Instant, after, since};

use super::frames::Frames;
use crate::simulation::{Heard, History};
use crate::state::Pattern;

/// The frames that came, up to the first one that nobody claims.
#[derive(Default)]
pub(super) struct Claims<'a> {
    /// The next event to be looked at.
    next: u64,
    again: Vec<Again<'a>>,
    deviation: Option<Deviation>,
}

/// A frame that comes again and again.
struct Again<'a> {
    pattern: &'a Pattern,
    period: Duration,
    last: Instant,
}

/// A deviation from a strict scenario.
pub(super) enum Deviation {
    /// A frame came that no step expects.
    Unclaimed(Heard),
    /// A frame came again so long after the one before: too early.
    Early(Heard, Duration),
    /// A frame did not come again.
    Missing { pattern: Pattern, period: Duration, last: Instant },
}

impl<'a> Claims<'a> {
    /// Looks at what has come up to now, for the frames that are wanted first.
    pub(super) fn look(&mut self, now: Instant, history: &History, mut wanted: Option<&mut Frames<'_>>) {
        for heard in history.heard_since(self.next) {
            if self.deviation.is_some() || wanted.as_ref().is_some_and(|wanted| wanted.are_all_there()) {
                return;
            }
            self.find_missing(heard.at);
            self.next = heard.number + 1;
            if wanted.as_mut().is_some_and(|wanted| wanted.claim(&heard)) {
                self.end(Some(heard.frame.id()));
            } else if self.deviation.is_none() {
                self.deviation = self.repeat(heard);
            }
        }
        self.next = history.next();
        self.find_missing(now);
    }

    /// Takes a frame as one that comes again, or finds that it is none.
    fn repeat(&mut self, heard: Heard) -> Option<Deviation> {
        let known = self.again.iter_mut().find(|again| again.pattern.matches(&heard.frame));
        let Some(again) = known else { return Some(Deviation::Unclaimed(heard)) };
        let pause = since(heard.at, std::mem::replace(&mut again.last, heard.at));
        (pause < again.period / 2).then_some(Deviation::Early(heard, pause))
    }

    fn find_missing(&mut self, now: Instant) {
        let late = |again: &&Again<'_>| now > after(again.last, again.period + again.period / 2);
        if self.deviation.is_none()
            && let Some(Again { pattern, period, last }) = self.again.iter().find(late)
        {
            self.deviation = Some(Deviation::Missing { pattern: (*pattern).clone(), period: *period, last: *last });
        }
    }

    /// From now on a frame that has just come comes again and again.
    pub(super) fn begin(&mut self, pattern: &'a Pattern, period: Duration, last: Instant) {
        self.again.push(Again { pattern, period, last });
    }

    /// The frame of an identifier does not come again; `None`: none does.
    pub(super) fn end(&mut self, id: Option<Id>) {
        self.again.retain(|again| id.is_some() && again.pattern.identifier() != id);
    }

    /// Returns whether there is a deviation.
    pub(super) const fn are_broken(&self) -> bool {
        self.deviation.is_some()
    }

    /// Takes the deviation.
    pub(super) fn take_deviation(&mut self) -> Option<Deviation> {
        self.deviation.take()
    }
}
