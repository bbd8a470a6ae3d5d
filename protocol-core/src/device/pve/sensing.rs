//! The inputs of the device that cause faults.

use crate::actuator::{InternalCause, Valve};
use crate::controller::BusErrorMode;
use crate::device::Inputs;
use crate::time::Instant;

/// The causes of faults that are inputs of the device but not of its valve. The causes outlast a restart; the faults do
/// not.
#[derive(Clone, Copy, Debug)]
pub(super) struct Causes {
    internal_fault: bool,
    bus_off: bool,
}

impl Causes {
    /// The causes of a healthy device: none.
    pub(super) const NONE: Self = Self { internal_fault: false, bus_off: false };

    /// Applies the inputs, changed or not. Returns whether the controller is bus-off.
    pub(super) fn sense(&mut self, valve: &mut Valve, inputs: &Inputs, now: Instant) -> bool {
        if let Some(sensed) = inputs.valve() {
            valve.sense(sensed, now);
        }
        *self = Self { internal_fault: inputs.internal_fault, bus_off: inputs.bus == BusErrorMode::BusOff };
        self.apply(valve, now);
        self.bus_off
    }

    /// Applies the causes to a valve.
    pub(super) fn apply(self, valve: &mut Valve, now: Instant) {
        valve.set_internal(InternalCause::Injected, self.internal_fault, now);
        valve.set_bus_off(self.bus_off, now);
    }
}
