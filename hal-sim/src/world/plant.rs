//! What acts on a device besides the bus: its plant, by the words and units of the control interface.

/// A change of what acts on a device.
pub use protocol_core::device::plant::Change as Plant;
use protocol_core::device::plant::Inapplicable;

use super::{NodeId, World};

/// The plant of a device cannot be changed so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlantError {
    /// Another product has that.
    #[error("{0}: no plant word of this kind of device")]
    OtherProduct(Plant),
    /// A value that cannot be.
    #[error("{0}: out of range, {values}", values = .0.word().values)]
    OutOfRange(Plant),
    /// The valve at the other end of the link turns the shaft.
    #[error("{0}: the shaft is linked to a valve")]
    Linked(Plant),
}

impl World {
    /// Changes what acts on a device from outside, now.
    ///
    /// # Errors
    /// [`PlantError`]; nothing is changed then.
    pub fn set_plant(&mut self, node: NodeId, plant: Plant) -> Result<(), PlantError> {
        self.set_plants(node, &[plant])
    }

    /// Changes several things that act on a device from outside, all at once.
    ///
    /// # Errors
    /// [`PlantError`] for the first that cannot be; nothing is changed then.
    pub fn set_plants(&mut self, node: NodeId, plants: &[Plant]) -> Result<(), PlantError> {
        self.follow_links(node);
        let mut inputs = *self.inputs(node);
        for &plant in plants {
            if matches!(plant, Plant::SpeedRpm(speed) if speed != 0) && self.is_linked(node) {
                return Err(PlantError::Linked(plant));
            }
            plant.apply(&mut inputs, self.now).map_err(|error| match error {
                Inapplicable::OtherProduct => PlantError::OtherProduct(plant),
                Inapplicable::OutOfRange => PlantError::OutOfRange(plant),
            })?;
        }
        // The input of a linked shaft comes from its link.
        for plant in plants {
            if let Plant::AngleCdeg(angle) = *plant {
                self.turn_link(node, angle);
            }
        }
        if inputs != *self.inputs(node) {
            self.set_inputs(node, inputs);
        }
        for plant in plants {
            match *plant {
                Plant::MemoryFails(fails) => self.memory_mut(node).set_write_fails(fails),
                Plant::BusOff(there) => self.force_bus_off(node, there),
                _ => {}
            }
        }
        Ok(())
    }

    /// Returns what acts on a device from outside, by each word that it has.
    pub fn plant(&self, node: NodeId) -> impl Iterator<Item = Plant> + use<> {
        let mut inputs = *self.inputs(node);
        if let (Some(shaft), Some(angle)) = (inputs.shaft_mut(), self.angle_cdeg(node)) {
            (shaft.angle_cdeg, shaft.since) = (angle, self.now);
        }
        let (memory_fails, bus_off) = (self.memory(node).write_fails(), self.is_bus_off_forced(node));
        protocol_core::device::plant::Plant { inputs, memory_fails, bus_off }.words(self.now)
    }
}
