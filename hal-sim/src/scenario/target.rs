//! The target of a scenario: a simulation, possibly with an emulated board.

use protocol_core::time::Instant;

use crate::simulation::{Command, Executed, Refusal, Simulation};

/// The target of a scenario: a simulation in which an emulated board may replace a device.
pub trait Target {
    /// Returns the simulation: the bus, its history, and the devices whose state can be read.
    fn simulation(&self) -> &Simulation;

    /// Returns the simulation, mutably. Only [`go`](Self::go) may advance time.
    fn simulation_mut(&mut self) -> &mut Simulation;

    /// Advances time as [`Simulation::go`] does.
    fn go(&mut self, end: Instant) -> bool {
        self.simulation_mut().go(end)
    }

    /// Executes a command as [`Simulation::execute`] does.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed.
    fn execute(&mut self, command: Command) -> Result<Executed, Refusal> {
        self.simulation_mut().execute(command)
    }
}

impl Target for Simulation {
    fn simulation(&self) -> &Simulation {
        self
    }

    fn simulation_mut(&mut self) -> &mut Simulation {
        self
    }
}
