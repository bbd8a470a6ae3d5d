//! Active prohibitions (`never`) of frames or of a state.

use protocol_core::time::{Instant, NEVER, after, since};

use super::report::Failure;
use super::step::{Never, Step, What};
use crate::simulation::{Command, Heard, History, Refusal, Reply, Simulation, Ticket};

/// An active prohibition of frames or of a state.
#[derive(Clone)]
pub(super) struct Guard<'a> {
    pub(super) step: &'a Step,
    never: &'a Never,
    begin: Instant,
    pub(super) until: Instant,
    /// The number of the next event to check.
    next: u64,
    /// True if the history still has all frames that count from an earlier instant.
    is_complete: bool,
    /// The pending wait for the forbidden state, or for the end of the prohibition.
    pub(super) ticket: Ticket,
}

impl<'a> Guard<'a> {
    /// Creates a prohibition that begins now. `ticket` is that of its [`command`](Self::command).
    pub(super) fn new(step: &'a Step, never: &'a Never, ticket: Ticket, simulation: &Simulation) -> Self {
        let (begin, history) = (simulation.now(), simulation.history());
        let until = never.span.map_or(NEVER, |span| after(begin, span));
        let next = if never.since.is_some() { 0 } else { history.next() };
        let is_complete = never.since.is_none_or(|since| history.has_all_since(since));
        Self { step, never, begin, until, next, is_complete, ticket }
    }

    /// Returns the command that waits for the forbidden state, or for the end of the prohibition.
    pub(super) fn command(never: &Never, now: Instant) -> Command {
        let within = never.span.unwrap_or_else(|| since(NEVER, now));
        match &never.what {
            What::Frames(_) => Command::Advance(within),
            What::State(wanted) => Command::Wait(wanted.condition(), within),
        }
    }

    /// Returns the failure if the prohibition was violated. `ended` is the result of the completed ticket, if any.
    pub(super) fn violation(&mut self, ended: Option<&Result<Reply, Refusal>>, history: &History) -> Option<Failure> {
        match (&self.never.what, ended) {
            (What::Frames(patterns), _) => {
                let is_it = |heard: Heard| Some((heard, patterns.iter().find(|it| it.matches(&heard.frame))?));
                let found = history.frames_since(self.next, self.never.since).find_map(is_it);
                self.next = history.next();
                found.map(|(heard, pattern)| Failure::came(self.step, pattern, &heard, history))
            }
            (What::State(wanted), Some(Ok(Reply::Device(state)))) => Some(Failure::held(self.step, wanted, state)),
            (What::State(_), _) => None,
        }
    }

    /// Returns the reason if the prohibition was never checked, or only in part: no time passed, `since_ms` or `t_us`
    /// was outside the checked time, or the history has dropped frames.
    pub(super) fn unchecked(&self, now: Instant) -> Option<&'static str> {
        let end = self.until.min(now);
        let instant = match &self.never.what {
            What::State(wanted) => wanted.condition.t_us.map(Instant::from_micros),
            What::Frames(_) => None,
        };
        match instant {
            _ if end <= self.begin => Some("no time has passed: nothing was checked"),
            _ if self.never.since.is_some_and(|since| end <= since) => {
                Some("the prohibition ends before since_ms: nothing was checked")
            }
            _ if !self.is_complete => Some("since_ms is too early: the first frames after it are no longer kept"),
            Some(instant) if instant < self.begin || instant > end => {
                Some("t_us was outside the checked time: nothing was checked")
            }
            _ => None,
        }
    }
}
