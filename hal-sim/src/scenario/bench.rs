//! Where a scenario is played.

use protocol_core::time::Instant;

use crate::simulation::{Command, Executed, Refusal, Simulation};

/// Where a scenario is played: a simulation, of which a device can be something else, as a board.
pub trait Bench {
    /// The bus, with the devices of which the state is known, and what has happened.
    fn simulation(&self) -> &Simulation;

    /// The same, to be changed; time passes by [`go`](Self::go) alone.
    fn simulation_mut(&mut self) -> &mut Simulation;

    /// As [`Simulation::go`].
    fn go(&mut self, end: Instant) -> bool {
        self.simulation_mut().go(end)
    }

    /// As [`Simulation::execute`].
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed then.
    fn execute(&mut self, command: Command) -> Result<Executed, Refusal> {
        self.simulation_mut().execute(command)
    }
}

impl Bench for Simulation {
    fn simulation(&self) -> &Simulation {
        self
    }

    fn simulation_mut(&mut self) -> &mut Simulation {
        self
    }
}
