//! Injects faults into a run, and observes the run from the first fault until the verdict is decided.

use std::iter::Peekable;
use std::ops::ControlFlow;
use std::vec;

use protocol_core::time::{Instant, NEVER, after};

use super::fault::PlanFault;
use super::golden::Golden;
use super::injection::Injection;
use super::master::Subject;
use super::oracles::{Oracles, next_sample};
use super::plan::Plan;
use super::rig::Rig;
use super::verdict::Observed;
use crate::scenario::runner::Watch;
use crate::simulation::{Happened, Simulation};

/// The faults of a run, each with its instant, in the order of time. The oracles begin at the first instant, and their
/// limits count from the last instant. Both rules also apply to an instant without a fault (`None`).
pub(super) type Faults<'a> = Vec<(Instant, Option<&'a PlanFault>)>;

/// The observation of a run from its first fault on.
#[derive(Debug)]
pub(super) struct Observation<'a> {
    to_come: Peekable<vec::IntoIter<(Instant, Option<&'a PlanFault>)>>,
    injections: Vec<Injection<'a>>,
    /// The latest instant at which the verdict is decided.
    end: Instant,
    /// The instant of the last sample.
    sampled: Instant,
}

impl<'a> Observation<'a> {
    pub(super) fn new(plan: &Plan, faults: Faults<'a>) -> Self {
        let at = |fault: Option<&(Instant, _)>| fault.map_or(NEVER, |(at, _)| *at);
        let (sampled, end) = (at(faults.first()), after(at(faults.last()), plan.observe));
        Self { to_come: faults.into_iter().peekable(), injections: Vec::new(), end, sampled }
    }

    /// Injects the faults that are due, and starts the oracles.
    pub(super) fn inject(&mut self, target: &mut impl Subject, oracles: &mut Oracles<'_>) {
        let now = target.simulation().now();
        while let Some((_, fault)) = self.to_come.next_if(|(at, _)| *at <= now) {
            let injection = fault.map(|fault| Injection::begin(fault, target));
            if injection.as_ref().is_some_and(Injection::has_switched) {
                oracles.note_effect(now);
            }
            oracles.begin(injection.as_ref().and_then(|injection| injection.name.clone()), target.simulation());
            self.injections.extend(injection);
        }
    }

    /// Updates the injected faults. Returns whether the current instant is a sample instant.
    pub(super) fn poll(&mut self, target: &mut impl Subject) -> bool {
        let now = target.simulation().now();
        self.injections.iter_mut().for_each(|injection| injection.poll(now, target));
        let is_sample = now >= next_sample(self.sampled);
        if is_sample {
            self.sampled = now;
        }
        is_sample
    }

    /// Returns the next instant at which the run must be observed, or the observations once the verdict is decided.
    pub(super) fn next(&mut self, target: &impl Subject, oracles: &Oracles<'_>) -> ControlFlow<Observed, Instant> {
        let (simulation, is_alive) = (target.simulation(), target.is_alive());
        let (now, had_effect) = (simulation.now(), oracles.has_effect());
        let struck = || self.injections.iter().map(|injection| injection.struck(simulation)).min().unwrap_or(0);
        let next = self.to_come.peek().map_or(NEVER, |(at, _)| *at);
        let is_decided = || oracles.are_decided() && had_effect && next == NEVER && struck() > 0;
        if now >= self.end || !is_alive || is_decided() {
            let (detected, safe) = (oracles.detected(), oracles.safe(now));
            return ControlFlow::Break(Observed { struck: struck(), is_alive, had_effect, detected, safe });
        }
        let limit = next_sample(self.sampled).min(self.end).min(next);
        let limit = self.injections.iter().map(|injection| injection.due).fold(limit, Instant::min);
        ControlFlow::Continue(oracles.due(simulation, limit))
    }
}

/// An observer of a run with faults.
pub(super) trait Spectator: Watch {
    /// Observes the devices at a sample instant.
    fn sample(&mut self, _golden: &Golden, _simulation: &Simulation) {}
}

impl Spectator for () {}

/// The observers of a run from its first fault on.
struct Observers<'r, 'a> {
    oracles: &'r mut Oracles<'a>,
    golden: &'r Golden,
    spectator: &'r mut dyn Spectator,
}

impl Watch for Observers<'_, '_> {
    fn event(&mut self, happened: &Happened) {
        self.oracles.event(happened);
        self.spectator.event(happened);
    }

    fn step(&mut self, simulation: &mut Simulation) {
        self.golden.compare(self.oracles, simulation);
        self.oracles.step(simulation);
        self.spectator.step(simulation);
    }

    fn due(&self, simulation: &Simulation, limit: Instant) -> Instant {
        self.oracles.due(simulation, limit)
    }
}

/// Injects faults into a run that has reached the instant of the first fault, and observes the run until the verdict is
/// decided. Returns the run and the observations.
pub(super) fn observe<'a, T: Subject>(
    plan: &Plan,
    golden: &Golden,
    mut rig: Rig<'a, T>,
    faults: Faults<'_>,
    spectator: &mut dyn Spectator,
) -> (Rig<'a, T>, Observed) {
    let mut observation = Observation::new(plan, faults);
    rig.run.forgive();
    loop {
        observation.inject(&mut rig.target, &mut rig.oracles);
        let due = match observation.next(&rig.target, &rig.oracles) {
            ControlFlow::Break(observed) => return (rig, observed),
            ControlFlow::Continue(due) => due,
        };
        let Rig { run, target, oracles } = &mut rig;
        run.pass(target, due, &mut Observers { oracles, golden, spectator });
        let is_sample = observation.poll(target);
        let simulation = target.simulation();
        if is_sample {
            spectator.sample(golden, simulation);
        }
        golden.compare(oracles, simulation);
        oracles.look(simulation);
    }
}
