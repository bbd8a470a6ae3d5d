//! A run of a scenario: progress in virtual time, observation of events, and failures.

mod steps;

use protocol_core::time::{Instant, NEVER};

use crate::scenario::frames::Frames;
use crate::scenario::guard::Guard;
use crate::scenario::reaction::Reactions;
use crate::scenario::report::{Failure, Outcome, Trace};
use crate::scenario::script::Scenario;
use crate::scenario::step::Step;
use crate::scenario::strict::Claims;
use crate::scenario::target::Target;
use crate::simulation::{Executed, Happened, NotHeard, Refusal, Reply, Simulation, Ticket};

/// An observer of a run.
pub(crate) trait Watch {
    /// Observes a bus event.
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
    /// The work to do after the wait in progress.
    next: Next,
    wait: Option<Wait<'a>>,
    /// The check that a step expects each device frame; `None` unless the scenario is strict and failures count.
    claims: Option<Claims<'a>>,
    /// The claims, set aside during an action whose frames may match the step's expectation.
    held_claims: Option<Claims<'a>>,
    /// The trace, written while the scenario runs.
    trace: Option<Trace>,
    /// The step being executed.
    step: Option<&'a Step>,
    /// The instant at which each step has acted, in the order of the steps.
    #[cfg(feature = "campaign")]
    acted: Vec<Instant>,
    /// The completed commands with their results.
    ended: Vec<(Ticket, Result<Reply, Refusal>)>,
    guards: Vec<Guard<'a>>,
    reactions: Reactions<'a>,
    failures: Vec<Failure>,
    /// True if failures no longer count.
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
    /// True if the goal was reached; valid once the wait has ended.
    is_reached: bool,
}

/// The condition that ends a wait early.
#[derive(Clone)]
enum Goal<'a> {
    /// No condition: the wait lasts until its end.
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
            #[cfg(feature = "campaign")]
            acted: Vec::new(),
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

    /// Ends the run and returns its outcome. `simulation` is the simulation of the run's target.
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

/// Methods for campaigns, which inject faults into runs.
#[cfg(feature = "campaign")]
impl Run<'_> {
    /// Advances to `until`, beyond the end of the scenario if necessary. Cyclic frames, rules and devices stay active.
    pub(crate) fn pass<T: Target>(&mut self, target: &mut T, until: Instant, watch: &mut dyn Watch) {
        if self.advance(target, until, watch) {
            self.wait = Some(Wait::until(until));
            Runner { run: self, target, watch }.pass(until);
            self.wait = None;
        }
    }

    /// Returns the instant at which each step has acted, in the order of the steps.
    pub(crate) fn acted(&self) -> &[Instant] {
        &self.acted
    }

    /// Returns the number of steps that are over.
    pub(crate) fn completed(&self) -> usize {
        match self.next {
            Next::Start => 0,
            Next::Begin { step } | Next::Act { step } | Next::Expect { step, .. } | Next::Judge { step, .. } => step,
            Next::End | Next::Over => self.scenario.steps.len(),
        }
    }

    /// Adds a note to the trace.
    pub(crate) fn note(&mut self, note: &str) {
        if let Some(trace) = &mut self.trace {
            trace.note(note);
        }
    }

    /// Ignores further failures, which an injected fault may cause. The steps continue.
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
    /// Advances until the wait ends: at its end, its goal, or a deviation from a strict scenario. Pauses at `until`.
    /// Processes all due events. Returns whether the wait has ended.
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
        // A prohibition proves nothing for a device at a different bit rate, so such devices are detected at the end of
        // each prohibition.
        let now = self.target.simulation().now();
        if self.run.guards.iter().any(|guard| guard.until == now) {
            self.target.simulation_mut().rates_mut().find_at(now);
        }
        self.fail_unheard();
        self.guard();
        self.react(now);
    }

    /// Executes the actions of the rules that are due. The steps do not wait for the frames of these actions.
    fn react(&mut self, now: Instant) {
        for act in self.run.reactions.take_acts(now) {
            if let Ok(Executed::Pending(ticket)) = self.target.execute(act.clone()) {
                self.target.simulation_mut().forget(ticket);
            }
        }
    }

    /// Adds a failure for each device whose bit rate differs from that of the bus. The failure names the line of the
    /// device if the rates already differed at 0 ms, otherwise the line of the current step.
    fn fail_unheard(&mut self) {
        for NotHeard { device, t_us, reason, .. } in self.target.simulation_mut().rates_mut().take_found() {
            let place = self.run.scenario.devices.iter().position(|known| known.name == device);
            let entry = place.and_then(|place| self.run.scenario.entries.get(place));
            let step = self.run.step.filter(|_| t_us > 0);
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
