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
use crate::simulation::{Executed, Happened, NotHeard, Simulation, Ticket};

/// An observer of a run.
pub(crate) trait Watch {
    /// Observes a bus event.
    fn event(&mut self, _happened: &Happened) {}

    /// Observes the simulation after each of its steps, and may replace the simulation with a clone.
    fn step(&mut self, _simulation: &mut Simulation) {}

    /// Returns the next instant at which [`step`](Self::step) must be called even without an event; later than now, and
    /// `limit` at the latest.
    fn due(&self, _simulation: &Simulation, limit: Instant) -> Instant {
        limit
    }
}

/// The observer that ignores everything.
impl Watch for () {}

impl<F: FnMut(&mut Simulation)> Watch for F {
    fn step(&mut self, simulation: &mut Simulation) {
        self(simulation);
    }
}

/// A run of a scenario on a target with powered devices. A run can be paused at any instant. A clone continues with a
/// clone of the target exactly as the original would.
#[derive(Clone)]
pub(crate) struct Run<'a> {
    scenario: &'a Scenario,
    next: Next<'a>,
    /// The index of the current step.
    index: usize,
    /// The number of the first event of the current step.
    from: u64,
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
    guards: Vec<Guard<'a>>,
    reactions: Reactions<'a>,
    failures: Vec<Failure>,
    /// True if failures no longer count.
    is_forgiven: bool,
    /// The active communication faults by name, each with the step that added it.
    faults: Vec<(String, &'a Step)>,
    /// The number of frames to destroy, with the step of the disturbance.
    disturbed: Option<(u32, &'a Step)>,
    /// The number of the first event that no failure has shown yet.
    shown: u64,
}

/// The next piece of work, with the wait before it.
#[derive(Clone)]
enum Next<'a> {
    Start,
    Begin,
    /// The action, at an instant, or now if `None`.
    Act(Option<Instant>),
    /// The expectation, once the command of the action has completed, if it takes time.
    Expect(Option<Ticket>),
    /// The verdict on an expected state, once the command that waits for the state has completed. `None` for a step
    /// without an expectation.
    JudgeState(Option<Ticket>),
    /// The verdict on expected frames, once all have come, or at an instant.
    JudgeFrames(Frames<'a>, Instant),
    /// The end of the scenario, at an instant, or now if `None`.
    End(Option<Instant>),
    Over,
}

impl Next<'_> {
    /// Returns the instant at which the wait ends at the latest; `None` if there is no wait.
    fn latest(&self) -> Option<Instant> {
        match self {
            Self::Act(at) | Self::End(at) => *at,
            Self::Expect(ticket) | Self::JudgeState(ticket) => ticket.map(|_| NEVER),
            Self::JudgeFrames(_, end) => Some(*end),
            Self::Start | Self::Begin | Self::Over => None,
        }
    }
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
            index: 0,
            from: 0,
            claims: scenario.strict.then(Claims::default),
            held_claims: None,
            trace: traced.then(Trace::default),
            step: None,
            #[cfg(feature = "campaign")]
            acted: Vec::new(),
            guards: Vec::new(),
            reactions: Reactions::new(&scenario.reactions),
            failures: Vec::new(),
            is_forgiven: false,
            faults: Vec::new(),
            disturbed: None,
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
            Runner { run: self, target, watch }.pass(until, until);
        }
    }

    /// Returns the instant at which each step has acted, in the order of the steps.
    pub(crate) fn acted(&self) -> &[Instant] {
        &self.acted
    }

    /// Returns the number of steps that are over.
    pub(crate) fn completed(&self) -> usize {
        match self.next {
            Next::End(_) | Next::Over => self.scenario.steps.len(),
            _ => self.index,
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
    /// Advances until the wait before the next work ends: at `end`, when the awaited frames or result have come, or at a
    /// deviation from a strict scenario. Pauses at `until`. Processes all due events. Returns whether the wait has
    /// ended.
    fn pass(&mut self, end: Instant, until: Instant) -> bool {
        loop {
            if self.is_reached() || self.run.claims.as_ref().is_some_and(Claims::are_broken) {
                return true;
            }
            let (limit, due) = (end.min(until), self.run.reactions.due());
            let watched = self.watch.due(self.target.simulation(), limit.min(due));
            let has_arrived = self.target.go(watched);
            if has_arrived && watched < limit.min(due) {
                // As at a pause, nothing has happened.
                self.watch.step(self.target.simulation_mut());
                continue;
            }
            if has_arrived && limit < due {
                // At a pause, nothing has happened.
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

    /// Checks whether the awaited frames or the awaited result have come.
    fn is_reached(&mut self) -> bool {
        let (simulation, run) = (self.target.simulation(), &mut *self.run);
        let (now, history) = (simulation.now(), simulation.history());
        match (&mut run.next, &mut run.claims) {
            (Next::JudgeFrames(frames, _), None) => frames.look(history),
            (Next::JudgeFrames(frames, _), Some(claims)) => claims.look(now, history, Some(frames)),
            (_, Some(claims)) => claims.look(now, history, None),
            (_, None) => {}
        }
        match &run.next {
            Next::JudgeFrames(frames, _) => frames.are_all_there(),
            Next::Expect(Some(ticket)) | Next::JudgeState(Some(ticket)) => simulation.has_completed(*ticket),
            _ => false,
        }
    }

    /// Processes new events, due commands and due waits.
    fn look(&mut self) {
        while let Some(happened) = self.target.simulation_mut().take_event() {
            self.watch.event(&happened);
            self.run.reactions.observe(&happened);
            if let Some(trace) = &mut self.run.trace {
                trace.add(&happened, self.target.simulation().history());
            }
        }
        self.target.simulation_mut().poll();
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
            let at = self.target.simulation().now();
            self.run.failures.push(Failure { at, ..Failure::not_heard(line, reason) });
        }
    }

    /// Checks the active prohibitions.
    fn guard(&mut self) {
        for mut guard in std::mem::take(&mut self.run.guards) {
            let ended = self.target.simulation_mut().take_result(guard.ticket);
            match guard.violation(ended.as_ref(), self.target.simulation().history()) {
                Some(failure) => {
                    self.target.simulation_mut().forget(guard.ticket);
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
        let until = failure.until.unwrap_or_else(|| history.next());
        let excerpt = history.excerpt(self.run.shown, until);
        self.run.failures.push(Failure { at, excerpt, ..failure });
        self.run.shown = self.run.shown.max(until);
    }
}
