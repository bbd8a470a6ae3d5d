//! The injection of a fault into a run.

use protocol_core::time::{Instant, NEVER, after};

use super::fault::{Act, PlanFault};
use super::master::Subject;
use crate::simulation::{Command, Executed, Reply, Simulation};
use crate::state::{PlantState, Power};

/// An injected fault, and whether it has changed anything.
pub(super) struct Injection<'a> {
    fault: &'a PlanFault,
    /// The name of the communication fault.
    name: Option<String>,
    /// The plant before the change, without the angle of a shaft.
    plant: Option<PlantState>,
    has_changed: bool,
    /// The instant at which the power returns.
    power_on: Instant,
}

impl<'a> Injection<'a> {
    pub(super) fn begin(fault: &'a PlanFault, target: &mut impl Subject) -> Self {
        let mut injection = Self { fault, name: None, plant: None, has_changed: false, power_on: NEVER };
        let now = target.simulation().now();
        let before = injection.plant(target.simulation());
        let was_powered = injection.is_powered(target.simulation());
        let Ok(Executed::Done(reply)) = target.execute(fault.command()) else { return injection };
        match (&fault.act, reply) {
            (Act::Message(_), Reply::Fault(record)) => injection.name = Some(record.name),
            (Act::Plant(..), _) => {
                injection.has_changed = injection.plant(target.simulation()) != before;
                injection.plant = before.map(|plant| plant.at_rest());
            }
            (Act::Power(_, power, lasts), _) => {
                let is_powered = injection.is_powered(target.simulation());
                injection.has_changed = *power == Power::Watchdog || was_powered != is_powered;
                injection.power_on = lasts.map_or(NEVER, |lasts| after(now, lasts));
            }
            _ => {}
        }
        injection
    }

    fn plant(&self, simulation: &Simulation) -> Option<PlantState> {
        let Act::Plant(device, _) = &self.fault.act else { return None };
        simulation.find(device).ok().map(|(node, _)| PlantState::of(node, simulation.world()))
    }

    fn is_powered(&self, simulation: &Simulation) -> Option<bool> {
        let Act::Power(device, ..) = &self.fault.act else { return None };
        simulation.find(device).ok().map(|(node, _)| simulation.world().is_powered(node))
    }

    pub(super) fn name(&self) -> Option<std::sync::Arc<str>> {
        self.name.as_deref().map(Into::into)
    }

    /// Returns the instant at which [`poll`](Self::poll) must switch the power on; [`NEVER`] if no switch is pending.
    pub(super) const fn due(&self) -> Instant {
        self.power_on
    }

    pub(super) fn poll(&mut self, now: Instant, target: &mut impl Subject) {
        if self.power_on <= now
            && let Act::Power(device, ..) = &self.fault.act
        {
            self.power_on = NEVER;
            // The device of a checked plan exists.
            let _ = target.execute(Command::Power(device.clone(), Power::On));
        }
        // A profile may change the plant only after the injection.
        if !self.has_changed && self.plant.is_some() {
            self.has_changed = self.plant(target.simulation()).map(|plant| plant.at_rest()) != self.plant;
        }
    }

    /// Returns the number of frames that a communication fault affected; for a plant or power fault, 1 if the plant or
    /// the power changed.
    pub(super) fn struck(&self, simulation: &Simulation) -> u64 {
        match &self.name {
            Some(name) => simulation.faults().find(|record| record.name == *name).map_or(0, |record| record.struck),
            None => self.has_changed.into(),
        }
    }
}
