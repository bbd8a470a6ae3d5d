//! The target of a scenario: a simulation, or a simulation with an emulated board in it.

use protocol_core::time::Instant;

use crate::simulation::{Command, Executed, Refusal, Simulation};

/// The target of a scenario: a simulation, in which a device can be something else, such as a board.
pub trait Target {
    /// The bus, with the devices of which the state is known, and what has happened.
    fn simulation(&self) -> &Simulation;

    /// The same, to be changed; time passes by [`go`](Self::go) alone.
    fn simulation_mut(&mut self) -> &mut Simulation;

    /// Lets time pass like [`Simulation::go`].
    fn go(&mut self, end: Instant) -> bool {
        self.simulation_mut().go(end)
    }

    /// Executes a command like [`Simulation::execute`].
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed then.
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
