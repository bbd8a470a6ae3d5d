//! What a device senses, and what it drives.

use crate::actuator::{Led, SpoolSense};
use crate::controller::BusErrorMode;

/// Everything that a device senses of the world around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Senses {
    /// Supply voltage, mV.
    pub supply_mv: u32,
    /// Temperature, °C.
    pub temperature_c: i16,
    /// An internal fault that is injected from outside.
    pub internal_fault: bool,
    /// The CAN controller's error mode.
    pub bus: BusErrorMode,
    /// What acts on the spool.
    pub spool: SpoolSense,
}

impl Default for Senses {
    /// A healthy valve on a 24 V supply at room temperature.
    fn default() -> Self {
        Self {
            supply_mv: 24_000,
            temperature_c: 25,
            internal_fault: false,
            bus: BusErrorMode::ErrorActive,
            spool: SpoolSense::default(),
        }
    }
}

/// What a device drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// Whether the solenoids are energised.
    pub solenoids: bool,
    /// The LED.
    pub led: Led,
}
