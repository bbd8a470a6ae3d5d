//! The inputs of a device that become faults of its valve.

use crate::actuator::{InternalCause, Valve};
use crate::controller::BusErrorMode;
use crate::device::Inputs;
use crate::time::Instant;

/// The causes of faults among the inputs of the device, beside those of its valve. Unlike the faults, they outlast a restart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Causes {
    internal_fault: bool,
    bus_off: bool,
}

impl Causes {
    /// The causes of a healthy device: none.
    pub(super) const NONE: Self = Self { internal_fault: false, bus_off: false };

    /// Takes the inputs, any number of times. Returns whether the controller is bus-off.
    pub(super) fn sense(&mut self, valve: &mut Valve, inputs: &Inputs, now: Instant) -> bool {
        if let Some(sensed) = inputs.valve() {
            valve.sense(sensed, now);
        }
        *self = Self { internal_fault: inputs.internal_fault, bus_off: inputs.bus == BusErrorMode::BusOff };
        self.tell(valve, now);
        self.bus_off
    }

    /// Hands the causes to a valve that has started anew.
    pub(super) fn tell(self, valve: &mut Valve, now: Instant) {
        valve.set_internal(InternalCause::Injected, self.internal_fault, now);
        valve.set_bus_off(self.bus_off, now);
    }
}
