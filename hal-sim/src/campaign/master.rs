//! The kinds of controllers that a campaign can test.

use crate::scenario::Target;
use crate::simulation::Simulation;

/// A simulation with its controller.
pub trait Subject: Target {
    /// Returns whether the controller is alive.
    fn is_alive(&self) -> bool {
        true
    }
}

impl Subject for Simulation {}

/// A kind of controller: starts and clones the controllers of a campaign.
pub trait Master {
    /// The simulation with the controller.
    type Target: Subject;

    /// Adds a new controller to a simulation.
    fn start(&self, simulation: Simulation) -> Self::Target;

    /// Returns a clone that continues exactly as the original would; `None` if the controller cannot be cloned.
    fn fork(&self, target: &Self::Target) -> Option<Self::Target>;
}

/// No separate controller: the steps of the scenario act as the controller.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scripted;

impl Master for Scripted {
    type Target = Simulation;

    fn start(&self, simulation: Simulation) -> Simulation {
        simulation
    }

    fn fork(&self, target: &Simulation) -> Option<Simulation> {
        Some(target.clone())
    }
}
