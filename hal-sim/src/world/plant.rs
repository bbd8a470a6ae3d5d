//! The plant of a device: all influences on the device except the bus, in the terms and units of the control interface.

use protocol_core::device::Inputs;
use protocol_core::device::plant::{Change, Inapplicable, Plant, Product};

use super::{NodeId, World, oil};

/// The reason why a plant change is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlantError {
    /// The product has no such plant word.
    #[error("{0}: not a plant word of this kind of device; accepted: {words}", words = words_of_other_product(*.0))]
    OtherProduct(Change),
    /// The value is out of range.
    #[error("{0}: out of range; accepted: {values}", values = .0.word().values)]
    OutOfRange(Change),
    /// A link controls the angle of the shaft.
    #[error("{0}: the shaft is linked to a valve")]
    Linked(Change),
}

/// Lists the words of the product that lacks the word of this change.
fn words_of_other_product(change: Change) -> String {
    let product = match change.word().product {
        Some(Product::Valve) => Product::Encoder,
        Some(Product::Encoder) | None => Product::Valve,
    };
    product.words().map(|word| word.name).collect::<Vec<_>>().join(", ")
}

impl World {
    /// Applies one plant change to a device.
    ///
    /// # Errors
    /// [`PlantError`]; the plant is unchanged.
    pub fn set_plant(&mut self, node: NodeId, plant: Change) -> Result<(), PlantError> {
        self.set_plants(node, &[plant])
    }

    /// Applies the given plant changes to a device at the same instant.
    ///
    /// # Errors
    /// [`PlantError`] for the first refused change; the plant is unchanged.
    pub fn set_plants(&mut self, node: NodeId, plants: &[Change]) -> Result<(), PlantError> {
        self.follow_links(node);
        let mut inputs = self.check_plants(node, plants)?;
        let mut electronics = self.electronics(node);
        for plant in plants {
            match *plant {
                Change::Oil(there) => self.pour_oil(node, there, &mut inputs),
                plant => electronics.change(plant),
            }
        }
        // Supply and limit change together, so that the supply is compared only with the new limit.
        let has_new_electronics = electronics != self.electronics(node);
        self.fit_electronics(node, electronics);
        self.warm_oil(node, &mut inputs);
        // A linked shaft is set through its link, not through the inputs.
        for plant in plants {
            if let Change::AngleCdeg(angle) = *plant {
                self.turn_link(node, angle);
            }
        }
        if inputs != *self.inputs(node) || has_new_electronics {
            self.set_inputs(node, inputs);
        }
        for plant in plants {
            match *plant {
                Change::MemoryFails(fails) => self.memory_mut(node).set_write_fails(fails),
                Change::BusOff(there) => self.force_bus_off(node, there),
                _ => {}
            }
        }
        Ok(())
    }

    /// Starts or ends the dependence of a valve's spool times on the temperature, see [`OIL`](super::OIL). At the
    /// start, the current times become the times in warm oil, from 0 to 60 °C. At the end, the spool times return to
    /// these values.
    fn pour_oil(&mut self, node: NodeId, there: bool, inputs: &mut Inputs) {
        let Some(valve) = inputs.valve_mut() else { return };
        let oil = &mut self.nodes[node.0].oil;
        if there {
            oil.get_or_insert(valve.spool.times);
        } else if let Some(times) = oil.take() {
            valve.spool.times = times;
        }
    }

    /// Returns whether a valve's spool times depend on the temperature.
    #[must_use]
    pub fn has_oil(&self, node: NodeId) -> bool {
        self.nodes[node.0].oil.is_some()
    }

    /// Adapts the times of a valve's spool to the temperature.
    fn warm_oil(&self, node: NodeId, inputs: &mut Inputs) {
        if let (Some(times), Some(valve)) = (self.nodes[node.0].oil, inputs.valve_mut()) {
            valve.spool.times = oil::at_temperature(times, valve.temperature_c);
        }
    }

    /// Returns the inputs that a device would have after the given plant changes.
    pub(crate) fn check_plants(&self, node: NodeId, plants: &[Change]) -> Result<Inputs, PlantError> {
        let mut inputs = *self.inputs(node);
        for &plant in plants {
            if matches!(plant, Change::SpeedRpm(speed) if speed != 0) && self.is_linked(node) {
                return Err(PlantError::Linked(plant));
            }
            plant.apply(&mut inputs, self.now).map_err(|error| match error {
                Inapplicable::OtherProduct => PlantError::OtherProduct(plant),
                Inapplicable::OutOfRange => PlantError::OutOfRange(plant),
            })?;
        }
        Ok(inputs)
    }

    /// Returns the plant of a device as one change for each supported plant word, in the order of the words.
    pub fn plant(&self, node: NodeId) -> impl Iterator<Item = Change> + use<> {
        let mut inputs = *self.inputs(node);
        if let (Some(shaft), Some(angle)) = (inputs.shaft_mut(), self.angle_cdeg(node)) {
            (shaft.angle_cdeg, shaft.since) = (angle, self.now);
        }
        let (memory_fails, bus_off) = (self.memory(node).write_fails(), self.is_bus_off_forced(node));
        let words = Plant { inputs, memory_fails, bus_off }.words(self.now);
        let electronics = self.electronics(node);
        let of_valve =
            inputs.valve().map(|_| [Change::BrownOutMv(electronics.brown_out_mv), Change::Oil(self.has_oil(node))]);
        words.chain(of_valve.into_iter().flatten()).chain(electronics.words())
    }
}
