//! One device on a bus, in virtual time. A free bus accepts each frame immediately, and the memory is a map of records.
//!
//! The controller, its mailboxes and the course of a write are those of hal-sim; the pump is that of all platforms.

mod frames;
mod memory;
mod sdo;
mod time;
mod wire;

use std::collections::{BTreeMap, BTreeSet};

use hal_sim::world::Write;
use protocol_core::controller::{BitRate, BusErrorMode, Filters};
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::device::{self, AnyDevice, Device, Effect, StartCause, ValveOutputs};
use protocol_core::memory::{Image, RecordKey};
use protocol_core::pump::pump;
use protocol_core::time::{Duration, Instant};

pub use frames::frame;
use wire::Wire;

use crate::Inputs;

/// A device on a rig.
pub struct Rig {
    setup: device::Setup,
    device: AnyDevice,
    wire: Wire,
    now: Instant,
    inputs: device::Inputs,
    /// The memory: records by key. The next start reads what a test puts here.
    pub records: BTreeMap<RecordKey, Vec<u8>>,
    /// Whether the next start finds the entire memory damaged.
    pub memory_damaged: bool,
    /// Whether every write fails.
    pub writes_fail: bool,
    /// The numbers of the writes that fail. The next write has number 0; each end of a write lowers the numbers.
    pub failing_writes: BTreeSet<usize>,
    /// The duration of a write.
    pub write_time: Duration,
    /// All written records, in order.
    pub writes: Vec<RecordKey>,
    write: Option<Write>,
    bit_rates: Vec<BitRate>,
}

impl Rig {
    /// Creates a new `pvea-canopen` at node 0x20, booted, without its two frames.
    #[must_use]
    pub fn booted() -> Self {
        Self::booted_as(Setup::new(Kind::PveaCanopen))
    }

    /// Creates a new `pveo-canopen` at node 0x20, booted, without its two frames.
    #[must_use]
    pub fn booted_pveo() -> Self {
        Self::booted_as(Setup::new(Kind::PveoCanopen))
    }

    /// Creates a valve with a node ID, booted, without its two frames.
    #[must_use]
    pub fn booted_as(setup: Setup) -> Self {
        let mut rig = Self::power_on(setup);
        let node_id = rig.node_id().expect("a node ID");
        rig.expect(&format!("{:03X}: 00", 0x700 + u16::from(node_id)));
        rig.expect(&format!("{:03X}: 00 00 00 00 00 00 00 00", 0x080 + u16::from(node_id)));
        rig
    }

    /// Creates a `pvea-canopen` in ACTIVE, with set-point 0.
    #[must_use]
    #[track_caller]
    pub fn active() -> Self {
        let mut rig = Self::booted();
        rig.activate();
        rig
    }

    /// Creates a device that has just been powered up, with a new memory.
    #[must_use]
    pub fn power_on(setup: impl Into<device::Setup>) -> Self {
        let setup = setup.into();
        let now = Instant::from_secs(1);
        let device = AnyDevice::power_on(setup, &Image::empty(), StartCause::PowerOn, now);
        let mut rig = Self {
            setup,
            device,
            wire: Wire::new(now),
            now,
            inputs: device::Inputs::healthy(setup.kind),
            records: BTreeMap::new(),
            memory_damaged: false,
            writes_fail: false,
            failing_writes: BTreeSet::new(),
            write_time: Duration::from_ticks(0),
            writes: Vec::new(),
            write: None,
            bit_rates: Vec::new(),
        };
        rig.device.as_dyn_mut().sense(&rig.inputs, now);
        rig.pump();
        rig
    }

    /// Switches the power off and on. The write in progress is lost.
    pub fn power_cycle(&mut self) {
        self.restart_by(StartCause::PowerOn);
    }

    /// Switches the power off and on, and drops the frames of the boot.
    pub fn start_anew(&mut self) {
        self.power_cycle();
        self.take();
    }

    /// Resets the processor by its watchdog.
    pub fn watchdog_reset(&mut self) {
        self.restart_by(StartCause::Watchdog);
    }

    /// Returns the filters of the device.
    #[must_use]
    pub fn filters(&self) -> &Filters {
        &self.wire.filters
    }

    /// Changes the inputs of the device. A controller that becomes bus-off drops its frames, and sends nothing until
    /// its recovery.
    pub fn sense(&mut self, change: impl FnOnce(&mut Inputs)) {
        let mut inputs = Inputs::from(self.inputs);
        change(&mut inputs);
        self.take_inputs(inputs.into());
    }

    /// Changes the inputs of a sensor.
    pub fn sense_hat(&mut self, change: impl FnOnce(&mut device::Inputs)) {
        let mut inputs = self.inputs;
        change(&mut inputs);
        self.take_inputs(inputs);
    }

    /// Injects an internal fault into any device, and removes it.
    pub fn internal_fault_comes_and_goes(&mut self) {
        self.sense_hat(|inputs| inputs.internal_fault = true);
        self.sense_hat(|inputs| inputs.internal_fault = false);
    }

    fn take_inputs(&mut self, inputs: device::Inputs) {
        self.inputs = inputs;
        let bus_off = self.inputs.bus == BusErrorMode::BusOff;
        if bus_off && !self.wire.bus_off {
            self.wire.clear();
        }
        self.wire.bus_off = bus_off;
        self.device.as_dyn_mut().sense(&self.inputs, self.now);
        self.pump();
        self.drain();
    }

    /// Holds the bus, as an unplugged cable does, or releases it. Frames stay in the mailboxes of a held bus.
    pub fn hold_bus(&mut self, held: bool) {
        self.wire.held = held;
        self.drain();
        self.pump();
    }

    /// Returns the number of frames in the mailboxes of the controller.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.wire.pending()
    }

    /// Requests all delayed writes.
    pub fn flush(&mut self) {
        self.device.as_dyn_mut().flush(self.now);
        self.pump();
    }

    /// Returns the device.
    #[must_use]
    pub fn device(&self) -> &dyn Device {
        self.device.as_dyn()
    }

    /// Returns the outputs of the valve.
    ///
    /// # Panics
    /// Panics for a device of another product.
    #[must_use]
    pub fn outputs(&self) -> ValveOutputs {
        self.device.as_dyn().outputs().valve().expect("a valve")
    }

    /// Returns the current node ID.
    #[must_use]
    pub fn node_id(&self) -> Option<u8> {
        self.device.as_dyn().node_id()
    }

    /// Returns the present time.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Returns the bit rates to which the device has switched, oldest first.
    #[must_use]
    pub fn bit_rates(&self) -> &[BitRate] {
        &self.bit_rates
    }

    fn restart_by(&mut self, cause: StartCause) {
        self.write = None;
        self.wire.power_cycle();
        self.device = AnyDevice::power_on(self.setup, &self.image(), cause, self.now);
        self.device.as_dyn_mut().sense(&self.inputs, self.now);
        self.pump();
    }

    /// Sends the frames of the mailboxes, the most urgent first, and pumps the device after each.
    fn drain(&mut self) {
        while self.wire.send_one() {
            self.pump();
        }
    }

    fn pump(&mut self) {
        self.wire.now = self.now;
        self.pump_all();
        assert!(self.device.as_dyn().deadline() > self.now, "what was due by {} us is due still", self.now.as_micros());
    }

    fn pump_all(&mut self) {
        loop {
            self.finish_write();
            match pump(self.device.as_dyn_mut(), &mut self.wire, self.now) {
                None => return,
                Some(Effect::Store(key, record)) => self.begin_write(key, record),
                Some(Effect::SetBitRate(bit_rate)) => {
                    self.wire.clear();
                    self.bit_rates.push(bit_rate);
                }
                Some(Effect::Restart(scope)) => {
                    self.wire.clear();
                    let image = self.image();
                    self.device.as_dyn_mut().restart(scope, &image, self.now);
                }
            }
        }
    }
}
