//! The power of a device, and resets of its processor.

use protocol_core::device::StartCause;
use serde::Deserialize;
use utoipa::ToSchema;

use super::Invalid;
use super::given::given;
use crate::world::{NodeId, World};

/// What a device is switched to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// Off: at this instant.
    Off,
    /// On: it boots; one that is on stays so.
    On,
    /// The watchdog resets its processor.
    Watchdog,
}

/// What a device is switched to: one of the two.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PowerChange {
    /// Whether it has power from now on; one that gets it boots.
    #[serde(default, deserialize_with = "given")]
    pub on: Option<bool>,
    /// A reset of its processor.
    #[serde(default, deserialize_with = "given")]
    pub reset: Option<ResetCause>,
}

/// A reset of a device's processor.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ResetCause {
    /// By its watchdog.
    Watchdog,
}

impl PowerChange {
    /// Returns what the device is switched to.
    pub fn power(self) -> Result<Power, Invalid> {
        match (self.on, self.reset) {
            (Some(false), None) => Ok(Power::Off),
            (Some(true), None) => Ok(Power::On),
            (None, Some(ResetCause::Watchdog)) => Ok(Power::Watchdog),
            _ => Err(Invalid("accepted: {\"on\": true}, {\"on\": false} or {\"reset\": \"watchdog\"}".to_owned())),
        }
    }
}

impl Power {
    /// Switches a device, now; the error is why a device without power is not reset.
    pub fn switch(self, node: NodeId, world: &mut World) -> Result<(), &'static str> {
        match self {
            Self::Off => world.power(node, false),
            Self::On => world.power(node, true),
            Self::Watchdog if !world.is_powered(node) => {
                return Err("the device has no power: its watchdog resets nothing");
            }
            Self::Watchdog => world.power_with(node, StartCause::Watchdog),
        }
        Ok(())
    }
}
