//! Scenarios: devices, what happens to them, and what has to come of it, as files in TOML, in virtual time.
//!
//! ```text
//! file     the file as it is written        script   the same, checked: everything in it can be done
//! runner   goes through one                 schema   the format for editors
//! strict   each frame claimed by a step     report   what came of it, in words
//! frames   those that are expected           target   a simulation, or one with a board in it
//! ```
//!
//! Each scenario has a world of its own: many run at once, and two runs with one seed are the same to the last byte.

mod file;
mod frames;
mod report;
mod runner;
mod schema;
mod script;
mod strict;
mod target;

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

/// Who sends the frames of a scenario, in traces. No device can have that name.
pub const OWN: &str = "the master";

/// A scenario that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// The line, from 1 on; `None`: the file as a whole.
    pub line: Option<usize>,
    /// What is wrong, and what is accepted.
    pub reason: String,
}

impl Scenario {
    /// Runs the scenario in a world of its own.
    #[must_use]
    pub fn run(&self, seed: u64) -> Outcome {
        runner::run(self, &mut self.powered(seed), false, &mut |_| {})
    }

    /// Runs the scenario, and keeps the [trace](Outcome::trace) of it.
    #[must_use]
    pub fn run_traced(&self, seed: u64) -> Outcome {
        self.play(&mut self.powered(seed))
    }

    /// Runs the scenario as [`run_traced`](Self::run_traced) does, and calls `watch` after everything that happens in
    /// its simulation. A clone that is put in the place of the simulation goes on as that would.
    #[must_use]
    pub fn run_watched(&self, seed: u64, mut watch: impl FnMut(&mut Simulation)) -> Outcome {
        runner::run(self, &mut self.powered(seed), true, &mut watch)
    }

    /// Plays the scenario on a target whose devices are powered, and keeps the [trace](Outcome::trace) of it. Where the
    /// target cannot look at a state that the scenario expects, nothing happens, and that is a failure.
    #[must_use]
    pub fn play(&self, target: &mut impl Target) -> Outcome {
        runner::run(self, target, true, &mut |_| {})
    }

    /// Returns a simulation of the scenario, with power.
    fn powered(&self, seed: u64) -> Simulation {
        let mut simulation = self.simulation(seed);
        simulation.send_as(OWN);
        simulation.power_up(SUPPLY_JITTER);
        simulation
    }
}
