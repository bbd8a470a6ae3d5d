//! The faults that a button injects, for a board without a console.

use super::Plant;
use crate::actuator::{SpoolFault, ValveInputs};
use crate::device::{Inputs, ProductInputs};

/// A fault that the button injects. Each press selects the next fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Injection {
    /// No fault.
    #[default]
    None,
    /// A valve supply below 9 V.
    SupplyLow,
    /// A valve supply above 36 V.
    SupplyHigh,
    /// A valve temperature above 120 °C.
    Temperature,
    /// A stuck valve spool.
    SpoolStuck,
    /// A measuring error of an encoder.
    MeasuringError,
    /// An internal fault.
    Internal,
}

impl Injection {
    /// Returns the fault that the next press injects into a device with this product.
    #[must_use]
    pub const fn next(self, product: &ProductInputs) -> Self {
        match (self, product) {
            (Self::None, ProductInputs::Valve(_)) => Self::SupplyLow,
            (Self::None, ProductInputs::Encoder(_)) => Self::MeasuringError,
            (Self::SupplyLow, _) => Self::SupplyHigh,
            (Self::SupplyHigh, _) => Self::Temperature,
            (Self::Temperature, _) => Self::SpoolStuck,
            (Self::SpoolStuck | Self::MeasuringError, _) => Self::Internal,
            (Self::Internal, _) => Self::None,
        }
    }

    /// Returns the plant with this fault, and without the other faults of the button.
    #[must_use]
    pub fn applied_to(self, plant: Plant) -> Plant {
        let mut inputs = Inputs { internal_fault: self == Self::Internal, ..plant.inputs };
        match &mut inputs.product {
            ProductInputs::Valve(valve) => {
                let ValveInputs { supply_mv, temperature_c, .. } = ValveInputs::default();
                *valve = ValveInputs { supply_mv, temperature_c, ..*valve };
                valve.spool.fault = SpoolFault::None;
                match self {
                    Self::SupplyLow => valve.supply_mv = 8_500,
                    Self::SupplyHigh => valve.supply_mv = 37_000,
                    Self::Temperature => valve.temperature_c = 130,
                    Self::SpoolStuck => valve.spool.fault = SpoolFault::Stuck,
                    Self::None | Self::MeasuringError | Self::Internal => {}
                }
            }
            ProductInputs::Encoder(shaft) => shaft.measuring_error = self == Self::MeasuringError,
        }
        Plant { inputs, ..plant }
    }
}
