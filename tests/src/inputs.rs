//! The inputs of a valve, in one piece: the tests change one of its fields at a time.

use protocol_core::actuator::{SpoolSense, ValveInputs};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::{self, ProductInputs};

/// The inputs of a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inputs {
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

impl Default for Inputs {
    /// A healthy valve.
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
