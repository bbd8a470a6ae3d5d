//! Executes the steps of a run in order, each with its start, action, expectation and prohibition.

use protocol_core::time::{Instant, NEVER, after};

use super::{Goal, Next, Runner, Wait};
use crate::scenario::frames::Frames;
use crate::scenario::guard::Guard;
use crate::scenario::report::Failure;
use crate::scenario::step::{Begin, Expect, Never, Step, What};
use crate::scenario::strict::Claims;
use crate::scenario::target::Target;
use crate::simulation::{Command, Executed, Refusal, Reply, Ticket};
use crate::state::{FaultRecord, Pattern};

impl<'a, B: Target> Runner<'_, 'a, B> {
    /// Advances to `until` or to the end of the scenario. Returns whether the scenario has ended.
    pub(super) fn advance(&mut self, until: Instant) -> bool {
        loop {
            if self.run.wait.is_some() && !self.pass(until) {
                return false;
            }
            let wait = self.run.wait.take();
            match self.run.next {
                Next::Start => self.start(),
                Next::Begin { step } => self.begin(step),
                Next::Act { step } => self.act(step),
                Next::Expect { step, from, act } => self.expect(step, from, act),
                Next::Judge { step, from, state } => self.judge(step, from, state, wait),
                Next::End => self.end(),
                Next::Over => return true,
            }
        }
    }

    fn start(&mut self) {
        self.run.next = if self.refuse_states() { Next::Over } else { Next::Begin { step: 0 } };
    }

    /// Waits for the start of a step; after the last step, for the end of the prohibitions. Fails a step whose start
    /// time has passed.
    fn begin(&mut self, index: usize) {
        let scenario = self.run.scenario;
        let Some(step) = scenario.steps.get(index) else {
            self.run.next = Next::End;
            let end = self.run.guards.iter().map(|guard| guard.until).filter(|until| *until != NEVER).max();
            self.run.wait = end.map(Wait::until);
            return;
        };
        self.run.next = Next::Act { step: index };
        let now = self.target.simulation().now();
        let begin = match step.begin {
            Begin::Now => return,
            Begin::After(pause) => after(now, pause),
            Begin::At(distance) => after(Instant::from_ticks(0), distance),
        };
        if begin < now {
            self.fail(Failure::late(step, begin));
        } else {
            self.run.wait = Some(Wait::until(begin));
        }
    }

    fn act(&mut self, index: usize) {
        let scenario = self.run.scenario;
        let Some(step) = scenario.steps.get(index) else { return };
        self.settle(step);
        if self.ends_early() {
            return;
        }
        self.run.step = Some(step);
        #[cfg(feature = "campaign")]
        self.run.acted.push(self.target.simulation().now());
        // The first event of the step. Earlier frames cannot match the patterns of this step.
        let from = self.target.simulation().history().next();
        if let (Some(note), Some(trace)) = (&step.note, &mut self.run.trace) {
            trace.note(note);
        }
        self.run.next = Next::Expect { step: index, from, act: None };
        let Some(act) = &step.act else { return };
        if let Command::Fault(_) = act {
            // A new fault may replace an expired one.
            let over: Vec<FaultRecord> = self.target.simulation().faults().filter(|record| record.is_over).collect();
            self.end_faults(&over);
        }
        // Frames that devices send during the action may match the step's expectation, so they are not judged yet.
        let expects = matches!(&step.expect, Some(Expect { what: What::Frames(_), .. }));
        self.run.held_claims = self.run.claims.take_if(|_| expects);
        match self.execute(act) {
            Ok(Executed::Pending(ticket)) => {
                self.run.next = Next::Expect { step: index, from, act: Some(ticket) };
                self.run.wait = Some(Wait::for_command(ticket));
            }
            Ok(Executed::Done(reply)) => self.acted(step, act, Ok(reply)),
            Err(refusal) => self.acted(step, act, Err(refusal)),
        }
    }

    /// Processes the result of an action.
    fn acted(&mut self, step: &'a Step, act: &Command, done: Result<Reply, Refusal>) {
        self.run.claims = self.run.held_claims.take().or(self.run.claims.take());
        match (done, act, &mut self.run.claims) {
            (Err(_), _, Some(claims)) if claims.are_broken() => {}
            (Err(refusal), ..) => self.fail(Failure::refused(step, act, &refusal)),
            (Ok(_), Command::Stop(which), Some(claims)) => claims.end(*which),
            (Ok(Reply::Fault(record)), ..) => self.run.faults.push((record.name, step)),
            (Ok(Reply::Faults(ended)), ..) => self.end_faults(&ended),
            _ => {}
        }
    }

    /// Starts the expectation of a step, after its action.
    fn expect(&mut self, index: usize, from: u64, act: Option<Ticket>) {
        let scenario = self.run.scenario;
        let Some(step) = scenario.steps.get(index) else { return };
        if let (Some(ticket), Some(act)) = (act, &step.act) {
            let done = self.result(ticket);
            self.acted(step, act, done);
        }
        self.run.next = Next::Judge { step: index, from, state: None };
        let Some(Expect { what, any_order, since, within, .. }) = &step.expect else { return };
        let now = self.target.simulation().now();
        match what {
            What::Frames(patterns) => {
                let wanted = patterns.iter().map(|pattern| (pattern, None)).collect();
                let next = if since.is_some() { 0 } else { from };
                let frames = Frames { wanted, any_order: *any_order, since: *since, next, mark: from, last: now };
                let (end, goal) = (after(now, *within), Goal::Frames(frames));
                self.run.wait = Some(Wait { end, goal, is_reached: false });
            }
            What::State(wanted) => {
                if let Ok(Executed::Pending(ticket)) = self.execute(&Command::Wait(wanted.condition(), *within)) {
                    self.run.next = Next::Judge { step: index, from, state: Some(ticket) };
                    self.run.wait = Some(Wait::for_command(ticket));
                }
            }
        }
    }

    /// Judges the expectation of a step, and starts its prohibition.
    fn judge(&mut self, index: usize, from: u64, state: Option<Ticket>, wait: Option<Wait<'a>>) {
        let scenario = self.run.scenario;
        let Some(step) = scenario.steps.get(index) else { return };
        match (&step.expect, state, wait) {
            (Some(expect), None, Some(Wait { goal: Goal::Frames(frames), is_reached, .. })) => {
                self.judge_frames(step, expect, from, frames, is_reached);
            }
            (Some(Expect { what: What::State(wanted), .. }), Some(ticket), _) => {
                if let Err(Refusal::TimedOut(timed_out)) = self.result(ticket)
                    && let Some(state) = &timed_out.state
                {
                    self.fail(Failure::state(step, wanted, state));
                }
            }
            _ => {}
        }
        if let Some(never) = &step.never {
            self.never(step, never);
        }
        self.settle(step);
        if !self.ends_early() {
            self.run.next = Next::Begin { step: index + 1 };
        }
    }

    fn judge_frames(&mut self, step: &'a Step, expect: &'a Expect, from: u64, frames: Frames<'a>, came: bool) {
        let (patterns, Frames { wanted, mark, last, .. }) = (expect.what.frames(), frames);
        if let (true, Some(period), [pattern], Some(claims)) = (came, expect.every, patterns, &mut self.run.claims) {
            claims.begin(pattern, period, last);
        }
        if !came && !self.run.is_forgiven {
            let missing = wanted.iter().filter(|(_, frame)| frame.is_none());
            let missing: Vec<&Pattern> = missing.map(|(pattern, _)| *pattern).collect();
            let history = self.target.simulation().history();
            let deviation = self.run.claims.as_mut().and_then(Claims::take_deviation);
            let failure = Failure::frames(step, patterns, &missing, (from, mark), history);
            let failure = deviation.map_or(failure.clone(), |deviation| failure.because(&deviation, history));
            self.fail(failure);
        }
    }

    /// Ends the scenario if it is strict and has failed: after the first deviation, further deviations are meaningless.
    /// Returns whether the scenario has ended.
    fn ends_early(&mut self) -> bool {
        let ends = self.run.claims.is_some() && !self.run.failures.is_empty();
        if ends {
            self.run.next = Next::Over;
        }
        ends
    }

    /// Ends the scenario: reports a pending deviation, ends the `never` checks, checks the remaining communication
    /// faults, and compares the devices' bit rates with the bus.
    fn end(&mut self) {
        if let Some(last) = self.run.scenario.steps.last() {
            self.settle(last);
        }
        for guard in std::mem::take(&mut self.run.guards) {
            self.end_guard(&guard);
        }
        let left: Vec<FaultRecord> = self.target.simulation().faults().collect();
        self.end_faults(&left);
        self.target.simulation_mut().rates_mut().find_all();
        self.fail_unheard();
        // A strict scenario claims no frames after its end.
        (self.run.claims, self.run.next) = (None, Next::Over);
    }

    /// Fails the scenario before the first step if a step expects a state that the target cannot read. Returns whether
    /// the scenario failed.
    fn refuse_states(&mut self) -> bool {
        for step in &self.run.scenario.steps {
            let expected = step.expect.as_ref().map(|expect| &expect.what);
            for what in expected.into_iter().chain(step.never.as_ref().map(|never| &never.what)) {
                if let What::State(wanted) = what
                    && self.target.simulation().find(wanted.device()).is_err()
                {
                    let reason = "the target gives no access to the state; use frames";
                    self.fail(Failure::undone(step, &format!("a state of {}", wanted.device()), reason));
                }
            }
        }
        !self.run.failures.is_empty()
    }

    /// Fails each step whose fault ended without affecting a frame, because nothing was tested. Faults with probability
    /// 0 are exempt.
    fn end_faults(&mut self, ended: &[FaultRecord]) {
        for record in ended {
            let Some(place) = self.run.faults.iter().position(|(name, _)| *name == record.name) else { continue };
            let (_, step) = self.run.faults.swap_remove(place);
            let is_off = matches!(&step.act, Some(Command::Fault(fault)) if fault.probability == 0);
            if record.struck == 0 && !is_off {
                let reason = "the fault affected no frame: nothing was tested";
                self.fail(Failure::undone(step, &format!("fault {}", record.fault), reason));
            }
        }
    }

    /// Fails a step of a strict scenario if a deviation was found: an unclaimed frame, or a cyclic frame that is early
    /// or missing.
    fn settle(&mut self, step: &Step) {
        if let Some(deviation) = self.run.claims.as_mut().and_then(Claims::take_deviation) {
            let failure = Failure::deviation(step, &deviation, self.target.simulation().history());
            self.fail(failure);
        }
    }

    /// Executes a command and processes its immediate events.
    fn execute(&mut self, command: &Command) -> Result<Executed, Refusal> {
        let executed = self.target.execute(command.clone());
        self.look();
        executed
    }

    /// Takes the result from an awaited command. Returns an error if virtual time reached its limit first.
    fn result(&mut self, ticket: Ticket) -> Result<Reply, Refusal> {
        let place = self.run.ended.iter().position(|(known, _)| *known == ticket);
        place.map_or(
            Err(Refusal::Conflict("virtual time reached its limit before the command completed".to_owned())),
            |place| self.run.ended.swap_remove(place).1,
        )
    }

    /// Starts the check of a prohibition.
    fn never(&mut self, step: &'a Step, never: &'a Never) {
        let simulation = self.target.simulation();
        let (mut guard, command) = Guard::new(step, never, simulation.now(), simulation.history());
        if let Ok(Executed::Pending(ticket)) = self.target.execute(command) {
            guard.ticket = Some(ticket);
            self.run.guards.push(guard);
        }
        self.look();
    }
}
