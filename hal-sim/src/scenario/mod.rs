//! Scenarios in virtual time: TOML files with devices, actions and expectations.
//!
//! ```text
//! file     the file format                  script   the checked scenario
//! step     its steps                        trial    the check that each step can be executed
//! runner   executes a scenario              schema   the JSON schema for editors
//! strict   each frame claimed by a step     report   failures as text
//! frames   expected frames                  guard    prohibitions (`never`)
//! reaction rules (`reactions`)              target   a simulation, possibly with an emulated board
//! ```
//!
//! Each run has its own simulation, so that runs can be parallel. Two runs with the same seed are byte-identical.

pub(crate) mod file;
mod frames;
mod guard;
mod reaction;
mod report;
pub(crate) mod runner;
pub(crate) mod schema;
mod script;
pub(crate) mod step;
mod strict;
mod target;
pub(crate) mod trial;

#[cfg(test)]
mod heard_tests;
#[cfg(test)]
mod tests;

pub use report::Outcome;
pub use schema::schema;
pub use script::Scenario;
pub use target::Target;

use crate::simulation::Simulation;
use crate::world::SUPPLY_JITTER;

/// The name of a scenario's frame sender in traces. No device can have this name.
pub const OWN: &str = "the master";

/// The error of a scenario that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// The line number, from 1; `None` if the error concerns the whole file.
    pub line: Option<usize>,
    /// The reason, with the accepted forms.
    pub reason: String,
}

impl Scenario {
    /// Runs the scenario in a new simulation.
    #[must_use]
    pub fn run(&self, seed: u64) -> Outcome {
        runner::run(self, &mut self.powered(seed), false, &mut ())
    }

    /// Runs the scenario in a new simulation and records a [trace](Outcome::trace).
    #[must_use]
    pub fn run_traced(&self, seed: u64) -> Outcome {
        self.play(&mut self.powered(seed))
    }

    /// Runs the scenario as [`run_traced`](Self::run_traced) does, and calls `watch` after every step of the
    /// simulation. `watch` may replace the simulation with a clone.
    #[must_use]
    pub fn run_watched(&self, seed: u64, mut watch: impl FnMut(&mut Simulation)) -> Outcome {
        runner::run(self, &mut self.powered(seed), true, &mut watch)
    }

    /// Runs the scenario on a target with powered devices and records a [trace](Outcome::trace). If the target cannot
    /// read a state that the scenario expects, the scenario fails before it begins.
    #[must_use]
    pub fn play(&self, target: &mut impl Target) -> Outcome {
        runner::run(self, target, true, &mut ())
    }

    /// Creates a simulation of the scenario and powers on its devices.
    pub(crate) fn powered(&self, seed: u64) -> Simulation {
        let mut simulation = self.simulation(seed);
        simulation.send_as(OWN);
        simulation.power_up(SUPPLY_JITTER);
        simulation
    }
}
