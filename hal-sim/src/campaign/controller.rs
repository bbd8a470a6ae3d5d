//! Controllers in Rust, either cloned with the simulation or created for each cell.

use std::panic::{AssertUnwindSafe, catch_unwind};

use protocol_core::time::{Duration, Instant, NEVER, after};

use super::master::{Master, Subject};
use crate::scenario::Target;
use crate::simulation::Simulation;
use crate::world::Client;

/// The name of a Rust controller in traces.
pub const CONTROLLER: &str = "the controller";

/// A controller in Rust, over [`embedded_can`].
pub trait Controller {
    /// Receives and sends frames. Called at instant 0, at the end of each received frame, and at the instant that the
    /// previous call returned. Returns the instant of the next call without a frame: later than `now`, or [`NEVER`].
    /// Sent frames take part in the arbitration at `now`.
    ///
    /// A panic ends the controller. A call that never returns blocks the campaign.
    fn poll(&mut self, can: &mut Client, now: Instant) -> Instant;
}

/// The master for controllers in Rust.
#[derive(Clone, Copy, Debug)]
pub struct InRust<C, F> {
    /// Creates a controller.
    pub(super) make: F,
    /// Returns a clone of a controller; `None` if the controller cannot be cloned.
    pub(super) fork: fn(&C) -> Option<C>,
}

/// A simulation with a controller.
pub struct Controlled<C> {
    simulation: Simulation,
    client: Client,
    /// `None` once the controller has panicked.
    controller: Option<C>,
    /// The instant of the next call without a frame.
    next: Instant,
    /// The number of received frames that the last call left. They cause no further call.
    left: usize,
}

impl<C: Controller> Controlled<C> {
    fn new(mut simulation: Simulation, controller: C) -> Self {
        let client = simulation.world_mut().client(CONTROLLER);
        Self { next: simulation.now(), simulation, client, controller: Some(controller), left: 0 }
    }

    /// Calls the controller, and lets its frames take part in the arbitration.
    fn poll(&mut self) {
        let now = self.simulation.now();
        let Some(controller) = &mut self.controller else { return };
        match catch_unwind(AssertUnwindSafe(|| controller.poll(&mut self.client, now))) {
            Ok(next) => self.next = next.max(after(now, Duration::from_ticks(1))),
            Err(_) => (self.controller, self.next) = (None, NEVER),
        }
        self.left = self.client.received();
        self.simulation.world_mut().run_until(now);
    }
}

impl<C: Controller> Target for Controlled<C> {
    fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    fn go(&mut self, end: Instant) -> bool {
        let has_arrived = self.simulation.go(end.min(self.next));
        if self.controller.is_none() || (self.simulation.now() < self.next && self.client.received() <= self.left) {
            return has_arrived;
        }
        self.poll();
        false
    }
}

impl<C: Controller> Subject for Controlled<C> {
    fn is_alive(&self) -> bool {
        self.controller.is_some()
    }
}

impl<C: Controller, F: Fn() -> C> Master for InRust<C, F> {
    type Target = Controlled<C>;

    fn start(&self, simulation: Simulation) -> Controlled<C> {
        Controlled::new(simulation, (self.make)())
    }

    fn fork(&self, target: &Controlled<C>) -> Option<Controlled<C>> {
        let controller = Some((self.fork)(target.controller.as_ref()?)?);
        let mut simulation = target.simulation.clone();
        let client = simulation.world_mut().take_client(CONTROLLER)?;
        Some(Controlled { simulation, client, controller, ..*target })
    }
}
