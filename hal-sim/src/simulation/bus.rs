//! The state of the bus, for JSON.

use serde::Serialize;
use utoipa::ToSchema;

use super::heard::{NotHeard, RateWatch};
use crate::state::{BitsPerSecond, raw};
use crate::world::World;

/// The state of the bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct BusState {
    /// The instant of this state, in microseconds of virtual time.
    pub t_us: u64,
    /// The bit rate, in bit/s.
    #[schema(value_type = BitsPerSecond)]
    pub bit_rate: u32,
    /// The load of the bus in the last second, in percent.
    pub load: u8,
    /// The pending disturbance of the bus.
    pub disturb: DisturbState,
    /// The devices whose bit rate differs from that of the bus, or differed earlier for longer than a change may take.
    pub not_heard: Vec<NotHeard>,
}

/// The pending disturbance of the bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct DisturbState {
    /// The number of attempts left to destroy.
    pub frames: u32,
    /// The identifier of the destroyed frames; null for all.
    #[schema(required, maximum = 536870911)]
    pub id: Option<u32>,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
}

impl BusState {
    /// Returns the current state of the bus. `rates` provides the devices with a different bit rate.
    pub(super) fn of(world: &World, rates: &RateWatch) -> Self {
        let disturbance = world.disturbance();
        let id = disturbance.id.filter(|_| disturbance.frames > 0).map(raw);
        Self {
            t_us: world.now().as_micros(),
            bit_rate: world.bit_rate().bits_per_second(),
            load: world.load(),
            disturb: DisturbState {
                frames: disturbance.frames,
                id: id.map(|(id, _)| id),
                extended: id.is_some_and(|(_, extended)| extended),
            },
            not_heard: rates.all(),
        }
    }
}
