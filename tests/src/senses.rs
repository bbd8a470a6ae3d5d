//! What a valve senses, in one piece: the tests change one of its fields at a time.

use protocol_core::actuator::{SpoolSense, ValveSenses};
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
