//! The faults caused by inputs of the device.

use crate::actuator::{InternalCause, Valve};
use crate::controller::BusErrorMode;
use crate::device::Inputs;
use crate::time::Instant;

/// The fault causes that are inputs of the device but not of its valve: internal fault and bus-off. Unlike the faults,
/// these causes persist over a restart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Causes {
    internal_fault: bool,
    bus_off: bool,
}

impl Causes {
    /// No causes: a healthy device.
    pub(super) const NONE: Self = Self { internal_fault: false, bus_off: false };

    /// Applies the inputs, even unchanged inputs. Returns whether the controller is bus-off.
    pub(super) fn sense(&mut self, valve: &mut Valve, inputs: &Inputs, now: Instant) -> bool {
        if let Some(sensed) = inputs.valve() {
            valve.sense(sensed, now);
        }
        *self = Self { internal_fault: inputs.internal_fault, bus_off: inputs.bus == BusErrorMode::BusOff };
        self.tell(valve, now);
        self.bus_off
    }

    /// Applies the causes to a valve after its restart.
    pub(super) fn tell(self, valve: &mut Valve, now: Instant) {
        valve.set_internal(InternalCause::Injected, self.internal_fault, now);
        valve.set_bus_off(self.bus_off, now);
    }
}
