//! The injection of a fault into a run.

use std::sync::Arc;

use protocol_core::time::{Instant, NEVER, after};

use super::fault::PlanFault;
use super::master::Subject;
use crate::simulation::{Command, Executed, Reply, Simulation};
use crate::state::{PlantState, Power};
use crate::world::NodeId;

/// An injected fault, and whether it has changed anything.
#[derive(Debug)]
pub(super) struct Injection<'a> {
    fault: &'a PlanFault,
    /// The device of a plant or power fault.
    device: Option<NodeId>,
    /// The name of the communication fault.
    pub(super) name: Option<Arc<str>>,
    /// The plant before a plant fault, without the angle of a shaft.
    plant: Option<PlantState>,
    has_changed: bool,
    /// The instant at which [`poll`](Self::poll) must switch the power on; [`NEVER`] if no switch is pending.
    pub(super) due: Instant,
}

impl<'a> Injection<'a> {
    pub(super) fn begin(fault: &'a PlanFault, target: &mut impl Subject) -> Self {
        let simulation = target.simulation();
        let now = simulation.now();
        let device = fault.device().and_then(|device| simulation.find(device).ok()).map(|(node, _)| node);
        let mut injection = Self { fault, device, name: None, plant: None, has_changed: false, due: NEVER };
        let is_powered = |simulation: &Simulation| device.map(|node| simulation.world().is_powered(node));
        let before = (injection.plant(simulation), is_powered(simulation));
        let Ok(Executed::Done(reply)) = target.execute(fault.command.clone()) else { return injection };
        if let Reply::Fault(record) = reply {
            injection.name = Some(record.name.into());
        }
        let simulation = target.simulation();
        injection.due = fault.off_for.map_or(NEVER, |time| after(now, time));
        injection.has_changed = before != (injection.plant(simulation), is_powered(simulation))
            || matches!(fault.command, Command::Power(_, Power::Watchdog));
        if let Command::Plant(..) = fault.command {
            injection.plant = before.0.map(|plant| plant.at_rest());
        }
        injection
    }

    fn plant(&self, simulation: &Simulation) -> Option<PlantState> {
        self.device.map(|node| PlantState::of(node, simulation.world()))
    }

    pub(super) fn poll(&mut self, now: Instant, target: &mut impl Subject) {
        if self.due <= now
            && let Some(device) = self.fault.device()
        {
            self.due = NEVER;
            // The device of a checked plan exists.
            let _ = target.execute(Command::Power(device.to_owned(), Power::On));
        }
        // A profile may change the plant only after the injection.
        if !self.has_changed && self.plant.is_some() {
            self.has_changed = self.plant(target.simulation()).map(|plant| plant.at_rest()) != self.plant;
        }
    }

    /// Returns whether the fault has switched or reset the power of a device.
    pub(super) fn has_switched(&self) -> bool {
        self.has_changed && matches!(self.fault.command, Command::Power(..))
    }

    /// Returns the number of frames that a communication fault affected; for a plant or power fault, 1 if the plant or
    /// the power changed.
    pub(super) fn struck(&self, simulation: &Simulation) -> u64 {
        match &self.name {
            Some(name) => simulation.faults().find(|record| *record.name == **name).map_or(0, |record| record.struck),
            None => self.has_changed.into(),
        }
    }
}
