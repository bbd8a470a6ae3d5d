//! The device of any product, for platforms that select the product at run time.

use super::hat::Hat;
use super::pve::{PveCanopen, PveIsobus};
use super::{Device, Kind, Protocol, Setup, StartCause};
use crate::memory::Memory;
use crate::time::Instant;

/// A device of any product. The value has the size of the largest product.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "a board has one device and no allocator")]
pub enum AnyDevice {
    /// A valve on CANopen.
    PveCanopen(PveCanopen),
    /// A valve on ISOBUS.
    PveIsobus(PveIsobus),
    /// An angle sensor.
    Hat(Hat),
}

impl AnyDevice {
    /// Creates a device and powers it up with the contents of the memory.
    #[must_use]
    pub fn power_on(setup: Setup, memory: &dyn Memory, cause: StartCause, now: Instant) -> Self {
        let mut device = Self::new(setup);
        device.start_up(memory, cause, now);
        device
    }

    /// Creates a device without power. A platform with a small stack moves the device to its final place before the
    /// [start](Self::start_up).
    #[must_use]
    pub fn new(setup: Setup) -> Self {
        match setup.kind {
            Kind::Pve(kind) => match kind.protocol() {
                Protocol::Canopen => Self::PveCanopen(PveCanopen::new(setup.with_kind(kind))),
                Protocol::Isobus => Self::PveIsobus(PveIsobus::new(setup.with_kind(kind))),
            },
            Kind::Hat(kind) => Self::Hat(Hat::new(setup.with_kind(kind))),
        }
    }

    /// Powers up a new device with the contents of the memory.
    pub fn start_up(&mut self, memory: &dyn Memory, cause: StartCause, now: Instant) {
        match self {
            Self::PveCanopen(device) => device.start_up(memory, cause, now),
            Self::PveIsobus(device) => device.start_up(memory, cause, now),
            Self::Hat(device) => device.start_up(memory, cause, now),
        }
    }

    /// Returns the device as a trait object.
    #[must_use]
    pub const fn as_dyn(&self) -> &dyn Device {
        match self {
            Self::PveCanopen(device) => device,
            Self::PveIsobus(device) => device,
            Self::Hat(device) => device,
        }
    }

    /// Returns the device as a mutable trait object.
    pub const fn as_dyn_mut(&mut self) -> &mut (dyn Device + Send) {
        match self {
            Self::PveCanopen(device) => device,
            Self::PveIsobus(device) => device,
            Self::Hat(device) => device,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Image;

    #[test]
    fn every_kind_makes_a_device_of_its_own() {
        let now = Instant::from_secs(1);
        for kind in Kind::ALL {
            let mut any = AnyDevice::power_on(Setup::from(kind), &Image::empty(), StartCause::PowerOn, now);
            let is_as_made = match kind {
                Kind::Pve(_) if kind.protocol() == Protocol::Canopen => matches!(any, AnyDevice::PveCanopen(_)),
                Kind::Pve(_) => matches!(any, AnyDevice::PveIsobus(_)),
                Kind::Hat(_) => matches!(any, AnyDevice::Hat(_)),
            };
            assert!(is_as_made, "{kind}");
            assert_eq!(any.as_dyn().bit_rate(), kind.bit_rates()[0], "{kind}");
            any.as_dyn_mut().sense(&crate::device::Inputs::healthy(kind), now);
            assert!(any.as_dyn_mut().next_frame(now).is_some(), "{kind} has booted");
        }
    }
}
