//! The power of a device, and resets of its processor.

use protocol_core::device::StartCause;
use serde::Deserialize;
use utoipa::ToSchema;

use super::Invalid;
use crate::world::{NodeId, World};

/// A change of a device's power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// Cuts the power immediately.
    Off,
    /// Switches the power on and boots the device; no effect on a device with power.
    On,
    /// Resets the processor, as the watchdog does.
    Watchdog,
}

/// A change of a device's power: exactly one of the two members.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PowerChange {
    /// True switches the power on and boots the device; false cuts the power.
    pub on: Option<bool>,
    /// A reset of the processor.
    pub reset: Option<ResetCause>,
}

/// The cause of a reset of a device's processor.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ResetCause {
    /// The watchdog.
    Watchdog,
}

impl PowerChange {
    /// Returns the change. Exactly one of `on` and `reset` must be given.
    pub fn power(self) -> Result<Power, Invalid> {
        match (self.on, self.reset) {
            (Some(false), None) => Ok(Power::Off),
            (Some(true), None) => Ok(Power::On),
            (None, Some(ResetCause::Watchdog)) => Ok(Power::Watchdog),
            _ => {
                Err(Invalid("the body must be {\"on\": true}, {\"on\": false} or {\"reset\": \"watchdog\"}".to_owned()))
            }
        }
    }
}

impl Power {
    /// Applies the change to a device. The error is the message that an unpowered device cannot be reset.
    pub fn switch(self, node: NodeId, world: &mut World) -> Result<(), &'static str> {
        match self {
            Self::Off => world.power(node, false),
            Self::On => world.power(node, true),
            Self::Watchdog if !world.can_reset(node) => {
                return Err("the device has no power: its watchdog cannot reset it");
            }
            Self::Watchdog => world.power_with(node, StartCause::Watchdog),
        }
        Ok(())
    }
}
