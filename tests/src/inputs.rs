//! The inputs of a valve as one value, whose fields the tests change.

use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::actuator::{Position, SpoolFault, SpoolSense, ValveInputs};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::{self, ProductInputs};

/// The inputs of a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inputs {
    /// Supply voltage, mV.
    pub supply_mv: u32,
    /// Temperature, °C.
    pub temperature_c: i16,
    /// The influences on the spool.
    pub spool: SpoolSense,
    /// Whether an internal fault is injected.
    pub internal_fault: bool,
    /// The error mode of the CAN controller.
    pub bus: BusErrorMode,
}

impl Default for Inputs {
    /// Returns the inputs of a healthy valve.
    fn default() -> Self {
        device::Inputs::default().into()
    }
}

impl From<device::Inputs> for Inputs {
    fn from(inputs: device::Inputs) -> Self {
        let ValveInputs { supply_mv, temperature_c, spool } = *inputs.valve().expect("a valve");
        Self { supply_mv, temperature_c, spool, internal_fault: inputs.internal_fault, bus: inputs.bus }
    }
}

impl From<Inputs> for device::Inputs {
    fn from(Inputs { supply_mv, temperature_c, spool, internal_fault, bus }: Inputs) -> Self {
        let product = ProductInputs::Valve(ValveInputs { supply_mv, temperature_c, spool });
        Self { internal_fault, bus, product }
    }
}

impl Inputs {
    /// Returns any inputs, mostly within their limits.
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
                let mut inputs = Inputs { supply_mv, temperature_c, internal_fault, bus, ..Inputs::default() };
                inputs.spool.fault = fault;
                inputs.spool.lever = lever;
                inputs.spool.measured = measured;
                inputs
            },
        )
    }
}
