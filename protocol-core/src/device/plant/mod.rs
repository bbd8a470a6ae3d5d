//! The plant of a device: its environment, in the words and units of the control interface and the consoles. A button
//! can inject some faults.

mod button;
mod change;
mod words;

pub use button::Injection;
pub use change::{Change, Inapplicable, natural};
pub use words::{Product, Value, Values, WORDS, Word};

use super::{Inputs, Kind, ProductInputs};
use crate::actuator::{Position, ValveInputs};
use crate::time::Instant;

/// The plant of a device: its inputs, and the memory and bus faults. The controller determines the error mode in the
/// inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plant {
    /// The inputs of the device.
    pub inputs: Inputs,
    /// Whether every write to the memory fails.
    pub memory_fails: bool,
    /// Whether the controller is held bus-off.
    pub bus_off: bool,
}

impl Plant {
    /// Returns the plant of a healthy device of this kind.
    #[must_use]
    pub fn healthy(kind: Kind) -> Self {
        Self { inputs: Inputs::healthy(kind), memory_fails: false, bus_off: false }
    }

    /// Applies a change.
    ///
    /// # Errors
    /// Returns [`Inapplicable`], and changes nothing, for a word of another product or a value out of range.
    pub fn change(&mut self, change: Change, now: Instant) -> Result<(), Inapplicable> {
        match change {
            Change::MemoryFails(fails) => self.memory_fails = fails,
            Change::BusOff(there) => self.bus_off = there,
            change => change.apply(&mut self.inputs, now)?,
        }
        Ok(())
    }

    /// Returns this plant as one [`Change`] for each plant word of its product. Words that only the simulator has are
    /// left out.
    pub fn words(&self, now: Instant) -> impl Iterator<Item = Change> + use<> {
        let own = match &self.inputs.product {
            ProductInputs::Valve(ValveInputs { supply_mv, temperature_c, spool }) => [
                Some(Change::SupplyMv(*supply_mv)),
                Some(Change::TemperatureC(*temperature_c)),
                Some(Change::Spool(spool.fault)),
                Some(Change::Lever(spool.lever.map(Position::raw))),
            ],
            ProductInputs::Encoder(shaft) => [
                Some(Change::AngleCdeg(shaft.angle_at(now))),
                Some(Change::SpeedRpm(shaft.speed_rpm)),
                Some(Change::MeasuringError(shaft.measuring_error)),
                None,
            ],
        };
        let common = [
            Change::InternalFault(self.inputs.internal_fault),
            Change::MemoryFails(self.memory_fails),
            Change::BusOff(self.bus_off),
        ];
        own.into_iter().flatten().chain(common)
    }
}

#[cfg(test)]
mod tests;
