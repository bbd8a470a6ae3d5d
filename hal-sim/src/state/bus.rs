//! Changes of the bus: its bit rate, and disturbances.

use protocol_core::controller::BitRate;
use protocol_core::frame::{ExtendedId, Id, StandardId};
use serde::Deserialize;
use utoipa::ToSchema;

use super::Invalid;
use super::given::given;
use crate::bus::Disturbance;

/// A change of the bus.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BusChange {
    /// The bit rate of the bus and of every client, in bit/s.
    pub(crate) bit_rate: u32,
}

/// Frames to be destroyed.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Disturb {
    /// The number of attempts; 0 ends an earlier disturbance.
    pub(crate) frames: u32,
    /// The identifier; without it any.
    #[serde(default, deserialize_with = "given")]
    pub(crate) id: Option<u32>,
    /// Whether the identifier has 29 bits.
    #[serde(default)]
    pub(crate) extended: bool,
}

impl BusChange {
    /// Returns the bit rate.
    pub(crate) fn bit_rate(self) -> Result<BitRate, Invalid> {
        BitRate::from_bits_per_second(self.bit_rate).ok_or_else(|| {
            let rates: Vec<String> = BitRate::ALL.iter().map(|rate| rate.bits_per_second().to_string()).collect();
            Invalid(format!("bit_rate {}: accepted: {}", self.bit_rate, rates.join(", ")))
        })
    }
}

impl Disturb {
    /// Returns the disturbance.
    pub(crate) fn disturbance(self) -> Result<Disturbance, Invalid> {
        let id = self.id.map(|id| identifier(id, self.extended)).transpose()?;
        if id.is_none() && self.extended {
            return Err(Invalid("extended without an id".to_owned()));
        }
        Ok(Disturbance { frames: self.frames, id })
    }
}

/// Returns the identifier of a number.
pub(crate) fn identifier(id: u32, extended: bool) -> Result<Id, Invalid> {
    let identifier = if extended {
        ExtendedId::new(id).map(Id::Extended)
    } else {
        u16::try_from(id).ok().and_then(StandardId::new).map(Id::Standard)
    };
    identifier.ok_or_else(|| {
        let accepted = if extended { "0–536870911" } else { "0–2047, more with \"extended\": true" };
        Invalid(format!("id {id}: accepted: {accepted}"))
    })
}
