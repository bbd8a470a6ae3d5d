//! Executes the steps of a run in order, each with its start, action, expectation and prohibition.

use protocol_core::frame::Id;
use protocol_core::time::{Instant, NEVER, after};

use super::{Next, Runner};
use crate::scenario::frames::Frames;
use crate::scenario::guard::Guard;
use crate::scenario::report::Failure;
use crate::scenario::step::{Begin, Expect, Never, Step, What};
use crate::scenario::strict::Claims;
use crate::scenario::target::Target;
use crate::simulation::{Command, Executed, Refusal, Reply, Stopped, Ticket};
use crate::state::{FaultRecord, digits};

impl<'a, B: Target> Runner<'_, 'a, B> {
    /// Advances to `until` or to the end of the scenario. Returns whether the scenario has ended.
    pub(super) fn advance(&mut self, until: Instant) -> bool {
        loop {
            if let Some(end) = self.run.next.latest()
                && !self.pass(end, until)
            {
                return false;
            }
            let step = self.run.scenario.steps.get(self.run.index);
            match (std::mem::replace(&mut self.run.next, Next::Over), step) {
                (Next::Start, _) => self.start(),
                (Next::Begin, Some(step)) => self.begin(step),
                (Next::Act(_), Some(step)) => self.act(step),
                (Next::Expect(act), Some(step)) => self.expect(step, act),
                (Next::JudgeState(state), Some(step)) => self.judge_state(step, state),
                (Next::JudgeFrames(frames, _), Some(step)) => self.judge_frames(step, &frames),
                (Next::End(_), _) => self.end(),
                (Next::Over, _) => return true,
                // After the last step, the run waits for the end of the prohibitions.
                (_, None) => {
                    let ends = self.run.guards.iter().map(|guard| guard.until);
                    self.run.next = Next::End(ends.filter(|until| *until != NEVER).max());
                }
            }
        }
    }

    fn start(&mut self) {
        if !self.refuse_states() {
            self.run.next = Next::Begin;
        }
    }

    /// Waits for the start of a step. Fails a step whose start time has passed.
    fn begin(&mut self, step: &Step) {
        let now = self.target.simulation().now();
        let begin = match step.begin {
            Begin::Now => None,
            Begin::After(pause) => Some(after(now, pause)),
            Begin::At(at) => Some(at),
        };
        self.run.next = match begin {
            Some(begin) if begin < now => {
                self.fail(Failure::late(step, begin));
                Next::Act(None)
            }
            begin => Next::Act(begin),
        };
    }

    fn act(&mut self, step: &'a Step) {
        self.settle(step);
        if self.ends_early() {
            return;
        }
        self.run.step = Some(step);
        #[cfg(feature = "campaign")]
        self.run.acted.push(self.target.simulation().now());
        // The first event of the step. Earlier frames cannot match the patterns of this step.
        self.run.from = self.target.simulation().history().next();
        if let (Some(note), Some(trace)) = (&step.note, &mut self.run.trace) {
            trace.note(note);
        }
        self.run.next = Next::Expect(None);
        let Some(act @ (_, command)) = &step.act else { return };
        match command {
            Command::Fault(_) => {
                // A new fault may replace an expired one.
                let over: Vec<_> = self.target.simulation().faults().filter(|record| record.is_over).collect();
                self.end_faults(&over);
            }
            Command::Disturb(_) => self.end_disturbance(),
            _ => {}
        }
        // Frames that devices send during the action may match the step's expectation, so they are not judged yet.
        let expects = matches!(&step.expect, Some(Expect { what: What::Frames(_), .. }));
        self.run.held_claims = self.run.claims.take_if(|_| expects);
        match self.execute(command) {
            Ok(Executed::Pending(ticket)) => self.run.next = Next::Expect(Some(ticket)),
            Ok(Executed::Done(reply)) => self.acted(step, act, Ok(reply)),
            Err(refusal) => self.acted(step, act, Err(refusal)),
        }
    }

    /// Processes the result of an action.
    fn acted(&mut self, step: &'a Step, act: &(&str, Command), done: Result<Reply, Refusal>) {
        self.run.claims = self.run.held_claims.take().or(self.run.claims.take());
        match (done, &act.1) {
            (Err(_), _) if self.run.claims.as_ref().is_some_and(Claims::are_broken) => {}
            (Err(refusal), _) => self.fail(Failure::refused(step, act, &refusal)),
            (Ok(Reply::Stopped(Stopped { stopped })), Command::Stop(which)) => {
                let expected = self.end_claims(*which);
                if let (Some(id), 0, 0) = (which, stopped, expected) {
                    let reason = format!("there is no cyclic frame \"{}\"", digits(*id));
                    self.fail(Failure::undone(step, act.0, &reason));
                }
            }
            (Ok(_), Command::Disturb(disturbance)) => {
                self.run.disturbed = Some((disturbance.frames, step)).filter(|(frames, _)| *frames > 0);
            }
            (Ok(Reply::Fault(record)), _) => self.run.faults.push((record.name, step)),
            (Ok(Reply::Faults(ended)), _) => self.end_faults(&ended),
            _ => {}
        }
    }

    /// Starts the expectation of a step, after its action.
    fn expect(&mut self, step: &'a Step, act: Option<Ticket>) {
        if let (Some(ticket), Some(act)) = (act, &step.act) {
            let done = self.result(ticket);
            self.acted(step, act, done);
        }
        self.run.next = Next::JudgeState(None);
        let Some(Expect { what, any_order, since, within, .. }) = &step.expect else { return };
        let (now, from) = (self.target.simulation().now(), self.run.from);
        match what {
            What::Frames(patterns) => {
                let wanted = patterns.iter().map(|pattern| (pattern, None)).collect();
                let next = if since.is_some() { 0 } else { from };
                let frames = Frames { wanted, any_order: *any_order, since: *since, next, mark: from, last: now };
                self.run.next = Next::JudgeFrames(frames, after(now, *within));
            }
            What::State(wanted) => {
                if let Ok(Executed::Pending(ticket)) = self.execute(&Command::Wait(wanted.condition(), *within)) {
                    self.run.next = Next::JudgeState(Some(ticket));
                }
            }
        }
    }

    fn judge_state(&mut self, step: &'a Step, state: Option<Ticket>) {
        if let (Some(ticket), Some(Expect { what: What::State(wanted), .. })) = (state, &step.expect)
            && let Err(Refusal::TimedOut(timed_out)) = self.result(ticket)
            && let Some(state) = &timed_out.state
        {
            self.fail(Failure::state(step, wanted, state));
        }
        self.conclude(step);
    }

    fn judge_frames(&mut self, step: &'a Step, frames: &Frames<'a>) {
        let every = step.expect.as_ref().and_then(|expect| expect.every);
        if !frames.are_all_there() && !self.run.is_forgiven {
            let history = self.target.simulation().history();
            let mut failure = Failure::frames(step, frames, self.run.from, history);
            if let Some(deviation) = self.run.claims.as_mut().and_then(Claims::take_deviation) {
                failure = failure.because(&deviation, history);
            }
            self.fail(failure);
        } else if let (true, Some(period), Some(claims)) = (frames.are_all_there(), every, &mut self.run.claims)
            && let [(pattern, _)] = frames.wanted.as_slice()
        {
            claims.begin(step, pattern, period, frames.last);
        }
        self.conclude(step);
    }

    /// Starts the prohibition of a step, and continues with the next step.
    fn conclude(&mut self, step: &'a Step) {
        if let Some(never) = &step.never {
            self.never(step, never);
        }
        self.settle(step);
        if !self.ends_early() {
            self.run.index += 1;
            self.run.next = Next::Begin;
        }
    }

    /// Returns whether the scenario is strict and has failed: after the first deviation, further deviations are
    /// meaningless.
    const fn ends_early(&self) -> bool {
        self.run.claims.is_some() && !self.run.failures.is_empty()
    }

    /// Ends the scenario: reports a pending deviation, ends the `never` checks, checks that faults, disturbances and
    /// periods were tested, and compares the devices' bit rates with the bus.
    fn end(&mut self) {
        if let Some(last) = self.run.scenario.steps.last() {
            self.settle(last);
        }
        for guard in std::mem::take(&mut self.run.guards) {
            self.end_guard(&guard);
        }
        let left: Vec<FaultRecord> = self.target.simulation().faults().collect();
        self.end_faults(&left);
        self.end_disturbance();
        self.end_claims(None);
        self.target.simulation_mut().rates_mut().find_all();
        self.fail_unheard();
        // A strict scenario claims no frames after its end.
        self.run.claims = None;
    }

    /// Fails the scenario before the first step if a step expects a state that the target cannot read. Returns whether
    /// the scenario failed.
    fn refuse_states(&mut self) -> bool {
        for step in &self.run.scenario.steps {
            let expected = step.expect.as_ref().map(|expect| &expect.what);
            for what in expected.into_iter().chain(step.never.as_ref().map(|never| &never.what)) {
                if let What::State(wanted) = what
                    && self.target.simulation().find(&wanted.device).is_err()
                {
                    let reason = "the target gives no access to the state; use frames";
                    self.fail(Failure::undone(step, &format!("a state of {}", wanted.device), reason));
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
            let is_off = matches!(&step.act, Some((_, Command::Fault(fault))) if fault.probability == 0);
            if record.struck == 0 && !is_off {
                let reason = "the fault affected no frame: nothing was tested";
                self.fail(Failure::undone(step, &format!("fault {}", record.fault), reason));
            }
        }
    }

    /// Fails the step whose disturbance destroyed no frame.
    fn end_disturbance(&mut self) {
        if let Some((frames, step)) = self.run.disturbed.take()
            && self.target.simulation().world().disturbance().frames == frames
        {
            self.fail(Failure::undone(step, "disturb", "no frame was destroyed: nothing was tested"));
        }
    }

    /// Stops expecting the cyclic frame with an identifier, or all cyclic frames if `None`. Fails each step whose frame
    /// did not come again, unless the scenario has failed already. Returns the number of expected cyclic frames.
    fn end_claims(&mut self, which: Option<Id>) -> usize {
        let has_failed = self.ends_early();
        let Some(claims) = &mut self.run.claims else { return 0 };
        let has_failed = has_failed || claims.are_broken();
        let ended = claims.end(which);
        for again in ended.iter().filter(|again| !again.is_checked && !has_failed) {
            let reason = "the frame did not come again: its period was not checked";
            self.fail(Failure::undone(again.step, "every_ms", reason));
        }
        ended.len()
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
        let late = || Err(Refusal::Conflict("virtual time reached its limit before the command completed".to_owned()));
        self.target.simulation_mut().take_result(ticket).unwrap_or_else(late)
    }

    /// Starts the check of a prohibition.
    fn never(&mut self, step: &'a Step, never: &'a Never) {
        let command = Guard::command(never, self.target.simulation().now());
        if let Ok(Executed::Pending(ticket)) = self.target.execute(command) {
            self.run.guards.push(Guard::new(step, never, ticket, self.target.simulation()));
        }
        self.look();
    }
}
