//! One device with its hardware: power, memory, plant, and a port on the bus.

use std::any::Any;
use std::sync::Arc;

use protocol_core::device::{AnyDevice, Device, Effect, Inputs, StartCause, Viewable};
use protocol_core::memory::{Image, Record, RecordKey};
use protocol_core::pump::pump;
use protocol_core::time::{Duration, Instant, NEVER, after};

use crate::bus::{Port, PortId};
use crate::memory::Memory;

/// How long a record takes to be written (A).
pub const WRITE_TIME: Duration = Duration::from_millis(10);
/// How long the fault log takes to be written: the real device takes at least so long to clear its counters (A).
pub const FAULT_LOG_WRITE_TIME: Duration = Duration::from_millis(50);

/// A [`Device`] that can be moved to the thread of the world, cloned with it, and looked at.
pub trait SimDevice: Device + Viewable + Any + Send {
    /// Returns the same device once more.
    fn boxed(&self) -> Box<dyn SimDevice>;

    /// Pumps the device through its controller, see [`pump`]. One call for a whole pass: each step of it knows what the
    /// device is.
    fn pump(&mut self, can: &mut Port, now: Instant) -> Option<Effect>;
}

impl<T: Device + Viewable + Any + Send + Clone> SimDevice for T {
    fn boxed(&self) -> Box<dyn SimDevice> {
        Box::new(self.clone())
    }

    fn pump(&mut self, can: &mut Port, now: Instant) -> Option<Effect> {
        pump(self, can, now)
    }
}

impl Clone for Box<dyn SimDevice> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}

/// Each product as what it is: a pass of the pump then knows it.
impl From<AnyDevice> for Box<dyn SimDevice> {
    fn from(device: AnyDevice) -> Self {
        match device {
            AnyDevice::PveCanopen(device) => Box::new(device),
            AnyDevice::PveIsobus(device) => Box::new(device),
            AnyDevice::Hat(device) => Box::new(device),
        }
    }
}

/// Builds a device from what its memory holds, why it starts, and when: the same from the same, in each clone of a
/// world.
pub type Factory = Arc<dyn Fn(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + Sync>;

/// One device with its hardware.
#[derive(Clone)]
pub(super) struct Node {
    pub(super) name: Arc<str>,
    pub(super) port: PortId,
    pub(super) factory: Factory,
    pub(super) memory: Memory,
    pub(super) inputs: Inputs,
    pub(super) power: Power,
    /// The record that is being written.
    pub(super) write: Option<Write>,
    pub(super) forced_bus_off: bool,
    /// How many frames the device had dropped when it was last looked at.
    pub(super) frames_dropped: u32,
}

/// Whether a device has power.
#[derive(Clone)]
pub(super) enum Power {
    Off,
    /// It starts then, for this reason.
    Coming(Instant, StartCause),
    On(Box<dyn SimDevice>),
}

/// A record on its way into the memory.
#[derive(Clone, Debug)]
pub struct Write {
    /// The key that it is written under.
    pub key: RecordKey,
    /// Its bytes, sealed.
    pub record: Record,
    /// The instant at which the write began.
    pub began: Instant,
    /// The instant at which the memory holds it, unless the write fails.
    pub done: Instant,
}

impl Write {
    /// Begins to write a record, which takes so long: [`write_time`] as a rule.
    #[must_use]
    pub fn begin(key: RecordKey, record: Record, now: Instant, takes: Duration) -> Self {
        Self { key, record, began: now, done: after(now, takes) }
    }
}

impl Node {
    /// Returns when something is next due for it, other than from the bus.
    pub(super) fn due(&self) -> Instant {
        match &self.power {
            Power::Off => NEVER,
            Power::Coming(at, _) => *at,
            Power::On(device) => due(&**device, self.write.as_ref()),
        }
    }
}

/// Returns when a device that is powered, or the record on its way into the memory, is next due.
#[inline]
pub(super) fn due(device: &dyn SimDevice, write: Option<&Write>) -> Instant {
    device.deadline().min(write.map_or(NEVER, |write| write.done))
}

/// Returns how long the memory takes to write the record under `key`.
#[must_use]
pub const fn write_time(key: RecordKey) -> Duration {
    match key {
        RecordKey::FaultLog => FAULT_LOG_WRITE_TIME,
        _ => WRITE_TIME,
    }
}
