//! A run of a scenario with its target and the oracles of a plan.

use protocol_core::time::Instant;

use super::master::{Master, Subject};
use super::oracles::Oracles;
use super::plan::Plan;
use crate::scenario::runner::{Run, Watch};
use crate::simulation::{Happened, Simulation};

/// A run with its target and its oracles.
#[derive(Clone)]
pub(super) struct Rig<'a, T> {
    pub(super) run: Run<'a>,
    pub(super) target: T,
    pub(super) oracles: Oracles<'a>,
}

impl<'a, T: Subject> Rig<'a, T> {
    /// Creates a run that has not begun.
    pub(super) fn new<M: Master<Target = T>>(plan: &'a Plan, master: &M, seed: u64, traced: bool) -> Self {
        let target = master.start(plan.scenario.powered(seed));
        let oracles = Oracles::new(plan, target.simulation());
        Self { run: Run::new(&plan.scenario, traced), target, oracles }
    }

    /// Returns a clone that continues exactly as the original would; `None` if the controller cannot be cloned.
    pub(super) fn fork<M: Master<Target = T>>(&self, master: &M) -> Option<Self> {
        let target = master.fork(&self.target)?;
        Some(Self { run: self.run.clone(), target, oracles: self.oracles.clone() })
    }

    /// Advances to an instant with an additional observer.
    pub(super) fn pass(&mut self, until: Instant, also: &mut dyn Watch) {
        self.run.pass(&mut self.target, until, &mut Both(&mut self.oracles, also));
    }
}

/// An observer that passes its observations to two others.
struct Both<'r, W>(&'r mut W, &'r mut dyn Watch);

impl<W: Watch> Watch for Both<'_, W> {
    fn event(&mut self, happened: &Happened) {
        self.0.event(happened);
        self.1.event(happened);
    }

    fn step(&mut self, simulation: &mut Simulation) {
        self.0.step(simulation);
        self.1.step(simulation);
    }

    fn due(&self, simulation: &Simulation, limit: Instant) -> Instant {
        self.1.due(simulation, self.0.due(simulation, limit))
    }
}
