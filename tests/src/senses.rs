//! What a valve senses, in one piece: the tests change one of its fields at a time.

use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::actuator::{Position, SpoolFault, SpoolSense, ValveSenses};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::{self, ProductSenses};

/// What a valve senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Senses {
    /// Supply voltage, mV.
    pub supply_mv: u32,
    /// Temperature, °C.
    pub temperature_c: i16,
    /// What acts on the spool.
    pub spool: SpoolSense,
    /// An internal fault that is injected from outside.
    pub internal_fault: bool,
    /// The CAN controller's error mode.
    pub bus: BusErrorMode,
}

impl Default for Senses {
    /// A healthy valve.
    fn default() -> Self {
        device::Senses::default().into()
    }
}

impl From<device::Senses> for Senses {
    fn from(senses: device::Senses) -> Self {
        let ValveSenses { supply_mv, temperature_c, spool } = *senses.valve().expect("a valve");
        Self { supply_mv, temperature_c, spool, internal_fault: senses.internal_fault, bus: senses.bus }
    }
}

impl From<Senses> for device::Senses {
    fn from(Senses { supply_mv, temperature_c, spool, internal_fault, bus }: Senses) -> Self {
        let product = ProductSenses::Valve(ValveSenses { supply_mv, temperature_c, spool });
        Self { internal_fault, bus, product }
    }
}

impl Senses {
    /// Any of them, most within their limits, for random tests.
    pub fn any() -> impl Strategy<Value = Self> {
        let supply_mv =
            prop_oneof![4 => Just(24_000), 1 => any::<u32>(), 1 => select(&[8_999, 9_000, 36_000, 36_001][..])];
        let temperature_c = prop_oneof![4 => Just(25), 1 => any::<i16>(), 1 => select(&[-41, -40, 120, 121][..])];
        let bus = prop_oneof![
            6 => Just(BusErrorMode::ErrorActive),
            1 => Just(BusErrorMode::ErrorPassive),
            1 => Just(BusErrorMode::BusOff)
        ];
        let fault = prop_oneof![
            4 => Just(SpoolFault::None),
            1 => select(&[SpoolFault::Stuck, SpoolFault::Slow, SpoolFault::Drifting, SpoolFault::NoFloat][..])
        ];
        let position = || option::weighted(0.1, (-16384..=16384_i16).prop_map(|raw| Position::new(raw).unwrap()));
        (supply_mv, temperature_c, prop::bool::weighted(0.1), bus, fault, position(), position()).prop_map(
            |(supply_mv, temperature_c, internal_fault, bus, fault, lever, measured)| {
                let mut senses = Senses { supply_mv, temperature_c, internal_fault, bus, ..Senses::default() };
                senses.spool.fault = fault;
                senses.spool.lever = lever;
                senses.spool.measured = measured;
                senses
            },
        )
    }
}
