//! A device with its hardware: power, memory, plant, and a port on the bus.

use std::any::Any;
use std::sync::Arc;

use protocol_core::actuator::{Drive, SpoolTimes, Valve};
use protocol_core::device::{AnyDevice, Device, Effect, Inputs, StartCause, Viewable};
use protocol_core::memory::{Image, Record, RecordKey};
use protocol_core::pump::pump;
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::{electronics, rough};
use crate::bus::{DeviceCan, PortId};
use crate::memory::Memory;

/// The duration of a record write (A).
pub const WRITE_TIME: Duration = Duration::from_millis(10);
/// The duration of a fault log write: the minimum time that the real device needs to clear its counters (A).
pub const FAULT_LOG_WRITE_TIME: Duration = Duration::from_millis(50);

/// A [`Device`] that can be moved to another thread, cloned with its world, and viewed.
pub trait SimDevice: Device + Viewable + Any + Send {
    /// Returns a boxed clone.
    fn boxed(&self) -> Box<dyn SimDevice>;

    /// Pumps the device through its controller, see [`pump`]. This call is dispatched dynamically, all calls inside the
    /// pump statically.
    fn pump(&mut self, can: &mut DeviceCan<'_>, now: Instant) -> Option<Effect>;
}

impl<T: Device + Viewable + Any + Send + Clone> SimDevice for T {
    fn boxed(&self) -> Box<dyn SimDevice> {
        Box::new(self.clone())
    }

    fn pump(&mut self, can: &mut DeviceCan<'_>, now: Instant) -> Option<Effect> {
        pump(self, can, now)
    }
}

impl Clone for Box<dyn SimDevice> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}

/// Boxes the concrete product rather than the enum, so that the pump calls the product statically.
impl From<AnyDevice> for Box<dyn SimDevice> {
    fn from(device: AnyDevice) -> Self {
        match device {
            AnyDevice::PveCanopen(device) => Box::new(device),
            AnyDevice::PveIsobus(device) => Box::new(device),
            AnyDevice::Hat(device) => Box::new(device),
        }
    }
}

/// A function that creates a device from its memory image, start cause and start time. The result must depend on
/// nothing else: otherwise clones of a world would diverge.
pub type Factory = Arc<dyn Fn(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + Sync>;

#[derive(Clone)]
pub(super) struct Node {
    pub(super) name: Arc<str>,
    pub(super) port: PortId,
    pub(super) factory: Factory,
    pub(super) memory: Memory,
    pub(super) inputs: Inputs,
    pub(super) power: Power,
    /// The valve while its program does not run: the solenoids are off, and springs, lever and faults of the spool act.
    /// `None` for a running device and for a sensor.
    pub(super) released: Option<Valve>,
    pub(super) write: Option<Write>,
    pub(super) forced_bus_off: bool,
    /// The number of frames that the device had dropped when it was last served.
    pub(super) frames_dropped: u32,
    pub(super) electronics: electronics::State,
    /// The spool times of a valve in warm oil; `None` if the times do not depend on the temperature.
    pub(super) oil: Option<SpoolTimes>,
    pub(super) rough: rough::State,
}

/// The power state of a device.
#[derive(Clone)]
pub(super) enum Power {
    Off,
    /// The device will start at this time, with this cause.
    Coming(Instant, StartCause),
    On(Box<dyn SimDevice>),
}

/// A write in progress.
#[derive(Clone, Debug)]
pub struct Write {
    /// The key of the record.
    pub key: RecordKey,
    /// The sealed bytes of the record.
    pub record: Record,
    /// The start of the write.
    pub began: Instant,
    /// The end of the write. Unless the write fails, the memory holds the record from this time.
    pub done: Instant,
}

impl Write {
    /// Starts a record write. `takes` is the duration, usually [`write_time`].
    #[must_use]
    pub fn begin(key: RecordKey, record: Record, now: Instant, takes: Duration) -> Self {
        Self { key, record, began: now, done: after(now, takes) }
    }
}

impl Node {
    /// Makes a running device sense its inputs.
    pub(super) fn sense(&mut self, now: Instant) {
        if let Power::On(device) = &mut self.power {
            device.sense(&self.rough.sensed(&self.inputs, now), now);
        }
    }

    /// Switches the solenoids off and applies the present inputs to the spool. The program must not run.
    pub(super) fn release(&mut self, now: Instant) {
        let Self { factory, memory, inputs, released, .. } = self;
        let Some(inputs) = inputs.valve() else { return };
        if released.is_none() {
            // A device that has never run has the spool of a new device, in neutral.
            *released = factory(&memory.peek_image(), StartCause::PowerOn, now).valve().cloned();
        }
        if let Some(valve) = released {
            valve.drive(Drive::Off, now);
            valve.sense(inputs, now);
        }
    }

    /// Tells the newly started program where the spool is, by one measurement.
    pub(super) fn take_over_spool(&mut self, now: Instant) {
        let mut inputs = self.inputs;
        if let (Power::On(device), Some(released), Some(valve)) =
            (&mut self.power, self.released.take(), inputs.valve_mut())
        {
            valve.spool.measured = Some(released.position(now));
            device.sense(&inputs, now);
        }
    }

    /// Returns the next time at which the device must be served, excluding bus events.
    pub(super) fn due(&self) -> Instant {
        match &self.power {
            Power::Off => NEVER,
            Power::Coming(at, _) => *at,
            Power::On(device) => due(&**device, self.write.as_ref(), &self.electronics).min(self.rough.next),
        }
    }
}

/// Returns the next time at which a powered device or its write must be served.
pub(super) fn due(device: &dyn SimDevice, write: Option<&Write>, electronics: &electronics::State) -> Instant {
    electronics.cycle_from(device.deadline()).min(write.map_or(NEVER, |write| write.done))
}

/// Returns the write time of the record under `key`.
#[must_use]
pub const fn write_time(key: RecordKey) -> Duration {
    match key {
        RecordKey::FaultLog => FAULT_LOG_WRITE_TIME,
        _ => WRITE_TIME,
    }
}
