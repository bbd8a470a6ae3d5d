//! What a device senses, and what it drives: what all have in common, and what is the product's.

use super::Kind;
use crate::actuator::{Led, ValveSenses};
use crate::controller::BusErrorMode;
use crate::encoder::Shaft;

/// Everything that a device senses of the world around it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Senses {
    /// An internal fault that is injected from outside.
    pub internal_fault: bool,
    /// The CAN controller's error mode.
    pub bus: BusErrorMode,
    /// What the product senses. A device keeps its last own senses when it is given those of another product.
    pub product: ProductSenses,
}

/// What a product senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProductSenses {
    /// A valve: its supply, its temperature and its spool.
    Valve(ValveSenses),
    /// An encoder: its shaft.
    Encoder(Shaft),
}

impl Default for ProductSenses {
    /// Returns those of a healthy valve.
    fn default() -> Self {
        Self::Valve(ValveSenses::default())
    }
}

impl Senses {
    /// Returns what a healthy device of this kind senses: a valve its supply, an encoder a shaft that rests at 0.
    #[must_use]
    pub fn healthy(kind: Kind) -> Self {
        match kind {
            Kind::Pve(_) => Self::default(),
            Kind::Hat(_) => Self::encoder(Shaft::at(0)),
        }
    }

    /// Returns what a healthy encoder with this shaft senses.
    #[must_use]
    pub const fn encoder(shaft: Shaft) -> Self {
        Self { internal_fault: false, bus: BusErrorMode::ErrorActive, product: ProductSenses::Encoder(shaft) }
    }

    /// Returns what a valve senses; `None` for another product.
    #[must_use]
    pub const fn valve(&self) -> Option<&ValveSenses> {
        match &self.product {
            ProductSenses::Valve(valve) => Some(valve),
            ProductSenses::Encoder(_) => None,
        }
    }

    /// Returns the same, to be changed.
    #[must_use]
    pub const fn valve_mut(&mut self) -> Option<&mut ValveSenses> {
        match &mut self.product {
            ProductSenses::Valve(valve) => Some(valve),
            ProductSenses::Encoder(_) => None,
        }
    }

    /// Returns the shaft of an encoder; `None` for another product.
    #[must_use]
    pub const fn shaft(&self) -> Option<&Shaft> {
        match &self.product {
            ProductSenses::Encoder(shaft) => Some(shaft),
            ProductSenses::Valve(_) => None,
        }
    }

    /// Returns the same, to be changed.
    #[must_use]
    pub const fn shaft_mut(&mut self) -> Option<&mut Shaft> {
        match &mut self.product {
            ProductSenses::Encoder(shaft) => Some(shaft),
            ProductSenses::Valve(_) => None,
        }
    }
}

/// What a device drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// A valve: its solenoids and its LED.
    Valve(ValveOutputs),
    /// An encoder: nothing.
    Encoder,
}

impl Outputs {
    /// Returns what a valve drives; `None` for another product.
    #[must_use]
    pub const fn valve(self) -> Option<ValveOutputs> {
        match self {
            Self::Valve(outputs) => Some(outputs),
            Self::Encoder => None,
        }
    }
}

/// What a valve drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValveOutputs {
    /// Whether the solenoids are energised.
    pub solenoids: bool,
    /// The LED.
    pub led: Led,
}
