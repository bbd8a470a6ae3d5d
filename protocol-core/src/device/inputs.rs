//! The inputs and outputs of devices.

use super::Kind;
use crate::actuator::{Led, ValveInputs};
use crate::controller::BusErrorMode;
use crate::encoder::Shaft;

/// The inputs of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Whether an internal fault is injected.
    pub internal_fault: bool,
    /// The error mode of the CAN controller.
    pub bus: BusErrorMode,
    /// The inputs of the product. A device ignores the inputs of another product.
    pub product: ProductInputs,
}

/// The inputs of a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProductInputs {
    /// The supply, temperature and spool of a valve.
    Valve(ValveInputs),
    /// The shaft of an encoder.
    Encoder(Shaft),
}

impl Default for ProductInputs {
    /// Returns the inputs of a healthy valve.
    fn default() -> Self {
        Self::Valve(ValveInputs::default())
    }
}

impl Inputs {
    /// Returns the inputs of a healthy device of this kind. The shaft of an encoder is at rest at 0.
    #[must_use]
    pub fn healthy(kind: Kind) -> Self {
        match kind {
            Kind::Pve(_) => Self::default(),
            Kind::Hat(_) => Self::encoder(Shaft::at(0)),
        }
    }

    /// Returns the inputs of a healthy encoder with this shaft.
    #[must_use]
    pub const fn encoder(shaft: Shaft) -> Self {
        Self { internal_fault: false, bus: BusErrorMode::ErrorActive, product: ProductInputs::Encoder(shaft) }
    }

    /// Returns the inputs of a valve; `None` for another product.
    #[must_use]
    pub const fn valve(&self) -> Option<&ValveInputs> {
        match &self.product {
            ProductInputs::Valve(valve) => Some(valve),
            ProductInputs::Encoder(_) => None,
        }
    }

    /// Returns the inputs of a valve as a mutable reference; `None` for another product.
    #[must_use]
    pub const fn valve_mut(&mut self) -> Option<&mut ValveInputs> {
        match &mut self.product {
            ProductInputs::Valve(valve) => Some(valve),
            ProductInputs::Encoder(_) => None,
        }
    }

    /// Returns the shaft of an encoder; `None` for another product.
    #[must_use]
    pub const fn shaft(&self) -> Option<&Shaft> {
        match &self.product {
            ProductInputs::Encoder(shaft) => Some(shaft),
            ProductInputs::Valve(_) => None,
        }
    }

    /// Returns the shaft of an encoder as a mutable reference; `None` for another product.
    #[must_use]
    pub const fn shaft_mut(&mut self) -> Option<&mut Shaft> {
        match &mut self.product {
            ProductInputs::Encoder(shaft) => Some(shaft),
            ProductInputs::Valve(_) => None,
        }
    }
}

/// The outputs of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// The solenoids and LED of a valve.
    Valve(ValveOutputs),
    /// An encoder, which has no outputs.
    Encoder,
}

impl Outputs {
    /// Returns the outputs of a valve; `None` for another product.
    #[must_use]
    pub const fn valve(self) -> Option<ValveOutputs> {
        match self {
            Self::Valve(outputs) => Some(outputs),
            Self::Encoder => None,
        }
    }
}

/// The outputs of a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValveOutputs {
    /// Whether the solenoids are energised.
    pub solenoids: bool,
    /// The LED.
    pub led: Led,
}
