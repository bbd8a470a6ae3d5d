//! What a valve makes of the senses of its device.

use crate::actuator::{InternalCause, Valve, ValveSenses};
use crate::controller::BusErrorMode;
use crate::device::Senses;
use crate::time::Instant;

/// Takes what the device senses, as often as it likes.
pub(super) fn sense(valve: &mut Valve, senses: &Senses, now: Instant) {
    let &Senses { supply_mv, temperature_c, internal_fault, bus, spool } = senses;
    valve.sense(&ValveSenses { supply_mv, temperature_c, spool }, now);
    valve.set_internal(InternalCause::Injected, internal_fault, now);
    valve.set_bus_off(bus == BusErrorMode::BusOff, now);
}
