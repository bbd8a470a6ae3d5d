//! Executes a scenario step by step and collects its failures.

use protocol_core::time::{Instant, NEVER, after};

use super::frames::Frames;
use super::guard::Guard;
use super::reaction::Reactions;
use super::report::{Failure, Outcome, Trace};
use super::script::Scenario;
use super::step::{Begin, Expect, Never, Step, What};
use super::strict::Claims;
use super::target::Target;
use crate::devices::NotHeard;
use crate::simulation::{Command, Executed, Happened, Refusal, Reply, Simulation, Ticket};
use crate::state::{FaultRecord, Pattern};

/// An observer of a run.
pub(crate) trait Watch {
    /// Observes an event of the bus.
    fn event(&mut self, _happened: &Happened) {}

    /// Observes the simulation after each of its steps, and may replace the simulation with a clone.
    fn step(&mut self, _simulation: &mut Simulation) {}
}

/// The observer that ignores everything.
impl Watch for () {}

/// A run of a scenario on a target with powered devices. A run can be paused at any instant. A clone continues with a
/// clone of the target exactly as the original would.
#[derive(Clone)]
pub(crate) struct Run<'a> {
    scenario: &'a Scenario,
    /// The work after the wait in progress.
    next: Next,
    wait: Option<Wait<'a>>,
    /// The check that each device frame is expected by a step; `None` unless the scenario is strict.
    claims: Option<Claims<'a>>,
    /// The claims during an action whose frames may match the step's expectation.
    held_claims: Option<Claims<'a>>,
    /// The trace, written while the scenario runs.
    trace: Option<Trace>,
    /// The step being executed.
    step: Option<&'a Step>,
    /// The completed commands with their results.
    ended: Vec<(Ticket, Result<Reply, Refusal>)>,
    guards: Vec<Guard<'a>>,
    reactions: Reactions<'a>,
    failures: Vec<Failure>,
    /// Whether failures no longer count.
    is_forgiven: bool,
    /// The active communication faults by name, each with the step that added it.
    faults: Vec<(String, &'a Step)>,
    /// The number of the first event that no failure has shown yet.
    shown: u64,
}

/// The next piece of work. Steps are given by their index; `from` is the number of the first event of the step.
#[derive(Clone, Copy, Debug)]
enum Next {
    Start,
    Begin { step: usize },
    Act { step: usize },
    Expect { step: usize, from: u64, act: Option<Ticket> },
    Judge { step: usize, from: u64, state: Option<Ticket> },
    End,
    Over,
}

/// A wait in progress.
#[derive(Clone)]
struct Wait<'a> {
    end: Instant,
    goal: Goal<'a>,
    /// Whether the goal was reached; set when the wait has ended.
    is_reached: bool,
}

/// The condition that ends an advance of time.
#[derive(Clone)]
enum Goal<'a> {
    /// No condition: time advances to the given end.
    None,
    /// The completion of a pending command.
    Command(Ticket),
    Frames(Frames<'a>),
}

/// Runs a scenario on a target with powered devices and, if `traced`, records a trace.
pub(super) fn run(scenario: &Scenario, target: &mut impl Target, traced: bool, watch: &mut dyn Watch) -> Outcome {
    let mut run = Run::new(scenario, traced);
    run.advance(target, NEVER, watch);
    run.outcome(target.simulation())
}

impl<'a> Run<'a> {
    /// Creates a run that has not begun.
    pub(crate) fn new(scenario: &'a Scenario, traced: bool) -> Self {
        Self {
            scenario,
            next: Next::Start,
            wait: None,
            claims: scenario.strict.then(Claims::default),
            held_claims: None,
            trace: traced.then(Trace::default),
            step: None,
            ended: Vec::new(),
            guards: Vec::new(),
            reactions: Reactions::new(&scenario.reactions),
            failures: Vec::new(),
            is_forgiven: false,
            faults: Vec::new(),
            shown: 0,
        }
    }

    /// Advances to `until` or to the end of the scenario, whichever comes first, and processes everything due by then.
    /// Returns whether the scenario has ended.
    pub(crate) fn advance<T: Target>(&mut self, target: &mut T, until: Instant, watch: &mut dyn Watch) -> bool {
        Runner { run: self, target, watch }.advance(until)
    }

    /// Ends the run. Returns its outcome; `simulation` is the simulation of its target.
    pub(crate) fn outcome(mut self, simulation: &Simulation) -> Outcome {
        let errors = simulation.history().errors();
        self.failures.iter_mut().for_each(|failure| failure.show_errors(&errors));
        Outcome {
            title: self.scenario.title.clone(),
            steps: self.scenario.steps.len(),
            end: simulation.now(),
            failures: self.failures,
            trace: self.trace.map_or_else(String::new, Trace::finish),
        }
    }
}

/// For runs into which a campaign injects faults.
#[cfg(feature = "campaign")]
impl Run<'_> {
    /// Advances to `until`, beyond the end of the scenario if necessary: cyclic frames, rules and devices go on.
    pub(crate) fn pass<T: Target>(&mut self, target: &mut T, until: Instant, watch: &mut dyn Watch) {
        if self.advance(target, until, watch) {
            self.wait = Some(Wait::until(until));
            Runner { run: self, target, watch }.pass(until);
            self.wait = None;
        }
    }

    /// Adds a note to the trace.
    pub(crate) fn note(&mut self, note: &str) {
        if let Some(trace) = &mut self.trace {
            trace.note(note);
        }
    }

    /// Ignores further failures while the steps continue: a fault from outside the scenario may cause such failures.
    pub(crate) fn forgive(&mut self) {
        (self.claims, self.held_claims, self.is_forgiven) = (None, None, true);
    }
}

/// A run with its target, while it advances.
struct Runner<'r, 'a, B> {
    run: &'r mut Run<'a>,
    target: &'r mut B,
    watch: &'r mut dyn Watch,
}

impl<'a, B: Target> Runner<'_, 'a, B> {
    fn advance(&mut self, until: Instant) -> bool {
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

    /// Waits for the start of a step, or after the last step for the end of the prohibitions. Fails a step whose start
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
        let Some(Expect { what, any_order, within, .. }) = &step.expect else { return };
        let now = self.target.simulation().now();
        match what {
            What::Frames(patterns) => {
                let wanted = patterns.iter().map(|pattern| (pattern, None)).collect();
                let frames = Frames { wanted, any_order: *any_order, next: from, mark: from, last: now };
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

    /// Checks deviations, prohibitions, faults and bit rates at the end of the scenario.
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
        self.run.next = Next::Over;
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
                let reason = "it affected no frame: nothing was tested";
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

    /// Takes the result of an awaited command; returns an error if virtual time reached its limit first.
    fn result(&mut self, ticket: Ticket) -> Result<Reply, Refusal> {
        let place = self.run.ended.iter().position(|(known, _)| *known == ticket);
        place.map_or(
            Err(Refusal::Conflict("virtual time reached its limit before the command completed".to_owned())),
            |place| self.run.ended.swap_remove(place).1,
        )
    }

    /// Starts to check a prohibition.
    fn never(&mut self, step: &'a Step, never: &'a Never) {
        let simulation = self.target.simulation();
        let (mut guard, command) = Guard::new(step, never, simulation.now(), simulation.history().next());
        if let Ok(Executed::Pending(ticket)) = self.target.execute(command) {
            guard.ticket = Some(ticket);
            self.run.guards.push(guard);
        }
        self.look();
    }

    /// Advances to the end of the wait, but no further than `until`: until its goal is reached, or a deviation from a
    /// strict scenario is found. Processes all due events. Returns whether the wait has ended.
    fn pass(&mut self, until: Instant) -> bool {
        let Some(end) = self.run.wait.as_ref().map(|wait| wait.end) else { return true };
        loop {
            if self.is_reached() || self.run.claims.as_ref().is_some_and(Claims::are_broken) {
                return true;
            }
            let (limit, due) = (end.min(until), self.run.reactions.due());
            if self.target.go(limit.min(due)) && limit < due {
                // At a pause, nothing has happened. A look would sample linked shafts and change their rounding.
                if until < end {
                    return false;
                }
                self.look();
                self.is_reached();
                return true;
            }
            self.look();
            self.watch.step(self.target.simulation_mut());
        }
    }

    /// Checks the goal of the wait in progress, and returns whether it is reached.
    fn is_reached(&mut self) -> bool {
        let simulation = self.target.simulation();
        let Some(wait) = &mut self.run.wait else { return true };
        wait.is_reached = match (&mut wait.goal, &mut self.run.claims) {
            (Goal::Frames(frames), None) => {
                frames.look(simulation.history());
                frames.are_all_there()
            }
            (Goal::Frames(frames), Some(claims)) => {
                claims.look(simulation.now(), simulation.history(), Some(frames));
                frames.are_all_there()
            }
            (goal, claims) => {
                if let Some(claims) = claims {
                    claims.look(simulation.now(), simulation.history(), None);
                }
                matches!(goal, Goal::Command(ticket) if self.run.ended.iter().any(|(known, _)| known == ticket))
            }
        };
        wait.is_reached
    }

    /// Processes new events and collects completed commands.
    fn look(&mut self) {
        while let Some(happened) = self.target.simulation_mut().take_event() {
            self.watch.event(&happened);
            self.run.reactions.observe(&happened);
            if let Some(trace) = &mut self.run.trace {
                trace.add(&happened, self.target.simulation().history());
            }
        }
        self.target.simulation_mut().poll();
        self.run.ended.extend(self.target.simulation_mut().take_completed());
        // A prohibition proves nothing for a device at another bit rate, so such devices are detected at the end of
        // each prohibition.
        let now = self.target.simulation().now();
        if self.run.guards.iter().any(|guard| guard.until == now) {
            self.target.simulation_mut().rates_mut().find_at(now);
        }
        self.fail_unheard();
        self.guard();
        self.react(now);
    }

    /// Executes the actions of the rules that are due. Their frames are sent beside the steps, which do not wait for
    /// them.
    fn react(&mut self, now: Instant) {
        for act in self.run.reactions.take_acts(now) {
            if let Ok(Executed::Pending(ticket)) = self.target.execute(act.clone()) {
                self.target.simulation_mut().forget(ticket);
            }
        }
    }

    /// Adds a failure for each device whose bit rate differs from that of the bus. The failure names the line of the
    /// device if the rates already differed at 0 ms, otherwise the current step.
    fn fail_unheard(&mut self) {
        for NotHeard { device, since, reason, .. } in self.target.simulation_mut().rates_mut().take_found() {
            let place = self.run.scenario.devices.iter().position(|known| known.name == device);
            let entry = place.and_then(|place| self.run.scenario.entries.get(place));
            let step = self.run.step.filter(|_| since > Instant::from_ticks(0));
            let line = step.map(|step| step.line).or(entry.map(|entry| entry.line)).unwrap_or(1);
            let failure = Failure::not_heard(line, reason).with(self.target.simulation().now(), Vec::new());
            self.run.failures.push(failure);
        }
    }

    /// Checks the active prohibitions.
    fn guard(&mut self) {
        for mut guard in std::mem::take(&mut self.run.guards) {
            let ended = self.run.ended.iter().position(|(known, _)| guard.ticket == Some(*known));
            let ended = ended.map(|place| self.run.ended.swap_remove(place).1);
            match guard.violation(ended.as_ref(), self.target.simulation().history()) {
                Some(failure) => {
                    guard.ticket.into_iter().for_each(|ticket| self.target.simulation_mut().forget(ticket));
                    self.fail(failure);
                }
                None if ended.is_some() => self.end_guard(&guard),
                None => self.run.guards.push(guard),
            }
        }
    }

    /// Fails the step of a prohibition that was never checked.
    fn end_guard(&mut self, guard: &Guard<'_>) {
        if let Some(reason) = guard.unchecked(self.target.simulation().now()) {
            self.fail(Failure::undone(guard.step, "never", reason));
        }
    }

    /// Adds a failure at the current time, with the events before it.
    fn fail(&mut self, failure: Failure) {
        if self.run.is_forgiven {
            return;
        }
        let (at, history) = (self.target.simulation().now(), self.target.simulation().history());
        let until = failure.until().unwrap_or_else(|| history.next());
        self.run.failures.push(failure.with(at, history.excerpt(self.run.shown, until)));
        self.run.shown = self.run.shown.max(until);
    }
}

impl Wait<'_> {
    const fn until(end: Instant) -> Self {
        Self { end, goal: Goal::None, is_reached: false }
    }

    const fn for_command(ticket: Ticket) -> Self {
        Self { end: NEVER, goal: Goal::Command(ticket), is_reached: false }
    }
}
