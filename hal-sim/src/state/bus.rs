//! Changes of the bus: its bit rate, and disturbances.

use protocol_core::controller::BitRate;
use serde::Deserialize;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{Object, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::{Identifier, Invalid};
use crate::bus::Disturbance;

/// A change of the bus.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BusChange {
    /// The bit rate of the bus and of every client, in bit/s.
    #[schema(value_type = BitsPerSecond)]
    pub bit_rate: u32,
}

/// The schema of a bit rate in bit/s.
#[derive(Clone, Copy, Debug)]
pub struct BitsPerSecond;

/// A disturbance of the bus, which destroys frames.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Disturb {
    /// The number of attempts; 0 ends an earlier disturbance.
    #[schema(maximum = 4294967295_i64)]
    pub frames: u32,
    /// The identifier; any by default.
    pub id: Option<Identifier>,
    /// Whether the identifier has 29 bits.
    pub extended: Option<bool>,
}

impl BusChange {
    /// Returns the requested bit rate.
    pub fn bit_rate(self) -> Result<BitRate, Invalid> {
        BitRate::from_bits_per_second(self.bit_rate).ok_or_else(|| {
            let rates: Vec<String> = BitRate::ALL.iter().map(|rate| rate.bits_per_second().to_string()).collect();
            Invalid(format!("bit_rate {} is not valid; accepted: {}", self.bit_rate, rates.join(", ")))
        })
    }
}

impl PartialSchema for BitsPerSecond {
    fn schema() -> RefOr<Schema> {
        let rates = BitRate::ALL.map(BitRate::bits_per_second);
        Object::builder().schema_type(Type::Integer).enum_values(Some(rates)).into()
    }
}

impl ToSchema for BitsPerSecond {}

impl Disturb {
    /// Returns the requested disturbance.
    pub fn disturbance(self) -> Result<Disturbance, Invalid> {
        if self.id.is_none() && self.extended == Some(true) {
            return Err(Invalid("extended is only valid together with id".to_owned()));
        }
        let id = self.id.map(|id| id.id(self.extended)).transpose()?;
        Ok(Disturbance { frames: self.frames, id })
    }
}
