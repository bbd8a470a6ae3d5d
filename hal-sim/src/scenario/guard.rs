//! Active prohibitions (`never`) of frames or of a state.

use protocol_core::time::{Instant, NEVER, after, since};

use super::report::Failure;
use super::step::{Never, Step, Wanted, What};
use crate::simulation::{Command, Heard, History, Refusal, Reply, Ticket};
use crate::state::Pattern;

/// An active prohibition of frames or of a state.
#[derive(Clone)]
pub(super) struct Guard<'a> {
    pub(super) step: &'a Step,
    since: Instant,
    pub(super) until: Instant,
    what: Guarded<'a>,
    /// True if the history still has all frames that count from an earlier instant.
    is_complete: bool,
    /// The pending wait for the forbidden state, or for the end of the prohibition.
    pub(super) ticket: Option<Ticket>,
}

#[derive(Clone, Copy)]
enum Guarded<'a> {
    /// Forbidden frames, the number of the next event to check, and the instant after which frames from any sender
    /// count.
    Frames(&'a [Pattern], u64, Option<Instant>),
    State(&'a Wanted),
}

impl<'a> Guard<'a> {
    /// Creates a prohibition that begins now, and the command whose ticket the caller must store in the prohibition.
    pub(super) fn new(step: &'a Step, never: &'a Never, now: Instant, history: &History) -> (Self, Command) {
        let until = never.span.map_or(NEVER, |span| after(now, span));
        let within = since(until, now);
        let (what, command) = match &never.what {
            What::Frames(patterns) => {
                let next = if never.since.is_some() { 0 } else { history.next() };
                (Guarded::Frames(patterns, next, never.since), Command::Advance(within))
            }
            What::State(wanted) => (Guarded::State(wanted), Command::Wait(wanted.condition(), within)),
        };
        let is_complete = never.since.is_none_or(|since| history.has_all_since(since));
        (Self { step, since: now, until, what, is_complete, ticket: None }, command)
    }

    /// Returns the failure if the prohibition was violated. `ended` is the result of the completed ticket, if any.
    pub(super) fn violation(&mut self, ended: Option<&Result<Reply, Refusal>>, history: &History) -> Option<Failure> {
        match (&mut self.what, ended) {
            (Guarded::Frames(patterns, next, since), _) => {
                let is_it = |heard: Heard| Some((heard, patterns.iter().find(|it| it.matches(&heard.frame))?));
                let found = history.frames_since(*next, *since).find_map(is_it);
                *next = history.next();
                found.map(|(heard, pattern)| Failure::came(self.step, pattern, &heard, history))
            }
            (Guarded::State(wanted), Some(Ok(Reply::Device(state)))) => Some(Failure::held(self.step, wanted, state)),
            (Guarded::State(_), _) => None,
        }
    }

    /// Returns the reason if the prohibition was never checked, or only in part: no time passed, `since_ms` or `t_us`
    /// was outside the checked time, or the history has dropped frames.
    pub(super) fn unchecked(&self, now: Instant) -> Option<&'static str> {
        let end = self.until.min(now);
        let (instant, since) = match &self.what {
            Guarded::State(wanted) => (wanted.condition.t_us.map(Instant::from_micros), None),
            Guarded::Frames(_, _, since) => (None, *since),
        };
        match instant {
            _ if end <= self.since => Some("no time has passed: nothing was checked"),
            _ if since.is_some_and(|since| end <= since) => {
                Some("the prohibition ends before since_ms: nothing was checked")
            }
            _ if !self.is_complete => Some("since_ms is too early: the first frames after it are no longer kept"),
            Some(instant) if instant < self.since || instant > end => {
                Some("t_us was outside the checked time: nothing was checked")
            }
            _ => None,
        }
    }
}
