//! What a valve makes of the senses of its device.

use crate::actuator::{InternalCause, Valve};
use crate::controller::BusErrorMode;
use crate::device::Senses;
use crate::time::Instant;

/// Takes what the device senses, as often as it likes.
pub(super) fn sense(valve: &mut Valve, senses: &Senses, now: Instant) {
    if let Some(sensed) = senses.valve() {
        valve.sense(sensed, now);
    }
    valve.set_internal(InternalCause::Injected, senses.internal_fault, now);
    valve.set_bus_off(senses.bus == BusErrorMode::BusOff, now);
}
