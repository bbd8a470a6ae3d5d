//! Strict scenarios: a step must claim every frame from a device.

use protocol_core::frame::Id;
use protocol_core::time::{Duration, Instant, after, since};

use super::frames::Frames;
use super::step::Step;
use crate::simulation::{Heard, History};
use crate::state::Pattern;

/// The claimed frames of a strict scenario, up to the first deviation.
#[derive(Clone, Default)]
pub(super) struct Claims<'a> {
    /// The number of the next event to check.
    next: u64,
    again: Vec<Again<'a>>,
    deviation: Option<Deviation>,
}

/// An expected cyclic frame.
#[derive(Clone)]
pub(super) struct Again<'a> {
    /// The step that expects it.
    pub(super) step: &'a Step,
    pattern: &'a Pattern,
    period: Duration,
    last: Instant,
    /// True once the frame has come again.
    pub(super) is_checked: bool,
}

/// A deviation from a strict scenario.
#[derive(Clone)]
pub(super) enum Deviation {
    /// A frame that no step claims.
    Unclaimed(Heard),
    /// A cyclic frame that was sent too early, with the time since the previous frame.
    Early(Heard, Duration),
    /// A cyclic frame that was not sent in time.
    Missing { pattern: Pattern, period: Duration, last: Instant },
}

impl<'a> Claims<'a> {
    /// Matches the frames received until `now`, first with the wanted frames, then with the expected cyclic frames.
    /// Stops at the first deviation, or when all wanted frames are matched.
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

    /// Matches a frame with the expected cyclic frames. Returns the deviation if no cyclic frame matches or the frame
    /// is early.
    fn repeat(&mut self, heard: Heard) -> Option<Deviation> {
        let known = self.again.iter_mut().find(|again| again.pattern.matches(&heard.frame));
        let Some(again) = known else { return Some(Deviation::Unclaimed(heard)) };
        again.is_checked = true;
        let pause = since(heard.at, std::mem::replace(&mut again.last, heard.at));
        (pause < again.period / 2).then_some(Deviation::Early(heard, pause))
    }

    fn find_missing(&mut self, now: Instant) {
        let late = |again: &&Again<'_>| now > after(again.last, again.period + again.period / 2);
        if self.deviation.is_none()
            && let Some(Again { pattern, period, last, .. }) = self.again.iter().find(late)
        {
            self.deviation = Some(Deviation::Missing { pattern: (*pattern).clone(), period: *period, last: *last });
        }
    }

    /// Starts expecting the frame of a step cyclically, every `period`; `last` is the time of the latest such frame.
    pub(super) fn begin(&mut self, step: &'a Step, pattern: &'a Pattern, period: Duration, last: Instant) {
        self.again.push(Again { step, pattern, period, last, is_checked: false });
    }

    /// Stops expecting the cyclic frame with an identifier, or all cyclic frames if `None`. Returns these frames.
    pub(super) fn end(&mut self, id: Option<Id>) -> Vec<Again<'a>> {
        self.again.extract_if(.., |again| id.is_none() || again.pattern.identifier() == id).collect()
    }

    /// Returns whether a deviation has been found.
    pub(super) const fn are_broken(&self) -> bool {
        self.deviation.is_some()
    }

    pub(super) fn take_deviation(&mut self) -> Option<Deviation> {
        self.deviation.take()
    }
}
