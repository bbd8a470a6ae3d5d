//! Scenarios in virtual time: TOML files with devices, actions and expectations.
//!
//! ```text
//! file     the file format                  script   the checked scenario
//! step     its steps                        trial    the check that each step can be executed
//! runner   executes a scenario              schema   the JSON schema for editors
//! strict   each frame claimed by a step     report   failures as text
//! frames   expected frames                  target   a simulation, perhaps with an emulated board in it
//! ```
//!
//! Each scenario has its own world, so that many can run in parallel; two runs with the same seed are byte-identical.

mod file;
mod frames;
mod report;
mod runner;
mod schema;
mod script;
mod step;
mod strict;
mod target;
mod trial;

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

/// The sender's name of a scenario's frames in traces; no device can have this name.
pub const OWN: &str = "the master";

/// A scenario cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// The line, from 1; `None` for the file as a whole.
    pub line: Option<usize>,
    /// The reason, with the accepted forms.
    pub reason: String,
}

impl Scenario {
    /// Runs the scenario in its own world.
    #[must_use]
    pub fn run(&self, seed: u64) -> Outcome {
        runner::run(self, &mut self.powered(seed), false, &mut |_| {})
    }

    /// Runs the scenario and keeps its [trace](Outcome::trace).
    #[must_use]
    pub fn run_traced(&self, seed: u64) -> Outcome {
        self.play(&mut self.powered(seed))
    }

    /// Runs the scenario as [`run_traced`](Self::run_traced) does, and calls `watch` after every step of its
    /// simulation. `watch` may replace the simulation by a clone.
    #[must_use]
    pub fn run_watched(&self, seed: u64, mut watch: impl FnMut(&mut Simulation)) -> Outcome {
        runner::run(self, &mut self.powered(seed), true, &mut watch)
    }

    /// Runs the scenario on a target whose devices are powered, and keeps the [trace](Outcome::trace). If the target
    /// cannot read a state that the scenario expects, the scenario fails before it begins.
    #[must_use]
    pub fn play(&self, target: &mut impl Target) -> Outcome {
        runner::run(self, target, true, &mut |_| {})
    }

    /// Creates a simulation of the scenario and powers the devices.
    fn powered(&self, seed: u64) -> Simulation {
        let mut simulation = self.simulation(seed);
        simulation.send_as(OWN);
        simulation.power_up(SUPPLY_JITTER);
        simulation
    }
}
