//! The world: devices with their plants and memories on one bus, in virtual time, event by event.
//!
//! The order within one instant is fixed: the end of the frame on the wire, due faults, the devices that these events
//! affect, the devices that are due, and the start of the next frame. Devices are served in the order of their numbers.
//! A run depends only on the calls and the seed.

mod agenda;
mod client;
mod controller;
mod electronics;
mod link;
mod node;
mod oil;
mod plant;
mod power;
mod rough;
mod run;
mod view;

#[cfg(test)]
mod probe;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::vec::Drain;

use protocol_core::controller::BitRate;
use protocol_core::device::{AnyDevice, Device, Inputs, Outputs, Setup, StartCause};
use protocol_core::frame::Frame;
use protocol_core::memory::Image;
use protocol_core::time::{Duration, Instant};

pub use client::{Client, WorldGone};
pub use controller::ControllerId;
pub use electronics::Electronics;
pub use link::{Link, LinkError};
pub use node::{FAULT_LOG_WRITE_TIME, Factory, SimDevice, WRITE_TIME, Write, write_time};
pub use oil::OIL;
pub use plant::PlantError;
pub use power::SUPPLY_JITTER;
/// A change of a device's plant.
pub use protocol_core::device::plant::Change;
pub use rough::{NOISE_STEP, Roughness};
pub use run::FLUSH_PATIENCE;

pub use crate::bus::{Event, EventKind};

use crate::bus::{Bus, Disturbance, Fault, FaultError, FaultState, Injector, LISTENING, Port, PortId};
use crate::memory::Memory;

use agenda::Agenda;
use client::Connection;
use link::Coupling;
use node::{Node, Power};

/// The number of a device, in the order of [`World::add_device`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(usize);

/// The port of a client on a world's bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientPortId(PortId);

/// A bus and its devices with plants and memories, in virtual time.
///
/// A clone continues exactly as the original would: the same calls have the same results at the same times. Files and
/// clients remain with the original: the clone keeps its memories in RAM, and [`take_client`](Self::take_client)
/// returns a new [`Client`] in place of a named client of the original.
#[derive(Clone)]
pub struct World {
    now: Instant,
    bit_rate: BitRate,
    /// A counter of bit rate changes on the bus and in the devices, including starts, restarts and power cuts.
    rate_changes: u64,
    bus: Bus,
    nodes: Vec<Node>,
    agenda: Agenda,
    couplings: Vec<Coupling>,
    /// The device of each port, by port number; `None` for all other ports.
    owners: Vec<Option<NodeId>>,
    random: fastrand::Rng,
    /// A reusable buffer for the ports being served.
    touched: Vec<PortId>,
    /// The clients owned by the caller.
    clients: Vec<Connection>,
    /// The controllers that send inserted frames, by fault name.
    inserters: Vec<(Arc<str>, ClientPortId)>,
}

impl World {
    /// Creates an empty world at virtual time 0.
    #[must_use]
    pub fn new(bit_rate: BitRate, seed: u64) -> Self {
        Self {
            now: Instant::from_ticks(0),
            bit_rate,
            rate_changes: 0,
            bus: Bus::default(),
            nodes: Vec::new(),
            agenda: Agenda::default(),
            couplings: Vec::new(),
            owners: Vec::new(),
            random: fastrand::Rng::with_seed(seed),
            touched: Vec::new(),
            clients: Vec::new(),
            inserters: Vec::new(),
        }
    }

    /// Returns the current virtual time.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Adds a healthy, unpowered device with a new memory. `setup` is a kind in factory state, or a [`Setup`].
    pub fn add(&mut self, name: &str, setup: impl Into<Setup>) -> NodeId {
        self.add_with(name, setup, Memory::in_ram())
    }

    /// Adds a healthy, unpowered device with an existing memory. Records in the memory take precedence over the setup.
    /// A setup without a bit rate uses the bit rate of the bus if the product supports this rate.
    pub fn add_with(&mut self, name: &str, setup: impl Into<Setup>, memory: Memory) -> NodeId {
        let setup: Setup = setup.into();
        let bit_rate = setup.bit_rate.or(Some(self.bit_rate).filter(|rate| setup.kind.bit_rates().contains(rate)));
        let setup = Setup { bit_rate, ..setup };
        let power_on = move |image: &Image, cause, now| AnyDevice::power_on(setup, image, cause, now).into();
        let node = self.add_device(name, power_on, memory);
        self.set_inputs(node, Inputs::healthy(setup.kind));
        node
    }

    /// Adds an unpowered device of any type. `factory` creates the device from its memory at each power-up.
    pub fn add_device(
        &mut self,
        name: &str,
        factory: impl Fn(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + Sync + 'static,
        memory: Memory,
    ) -> NodeId {
        let name: Arc<str> = name.into();
        let id = NodeId(self.nodes.len());
        let port = self.bus.add_device(name.clone(), self.bit_rate);
        self.own(port, Some(id));
        self.agenda.add();
        self.nodes.push(Node {
            name,
            port,
            factory: Arc::new(factory),
            memory,
            inputs: Inputs::default(),
            power: Power::Off,
            released: None,
            write: None,
            forced_bus_off: false,
            frames_dropped: 0,
            electronics: electronics::State::default(),
            oil: None,
            rough: rough::State::default(),
        });
        id
    }

    /// Returns all devices.
    pub fn devices(&self) -> impl Iterator<Item = NodeId> + use<> {
        (0..self.nodes.len()).map(NodeId)
    }

    /// Returns the name of a device.
    #[must_use]
    pub fn name(&self, node: NodeId) -> &str {
        &self.nodes[node.0].name
    }

    /// Returns the device with this name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<NodeId> {
        self.devices().find(|node| self.name(*node) == name)
    }

    /// Returns a device; `None` without power.
    #[must_use]
    pub fn device(&self, node: NodeId) -> Option<&dyn Device> {
        self.on(node).map(|device| device as &dyn Device)
    }

    fn on(&self, node: NodeId) -> Option<&dyn SimDevice> {
        match &self.nodes[node.0].power {
            Power::On(device) => Some(&**device),
            _ => None,
        }
    }

    /// Returns a device as a `T`; `None` if the device has no power or is not a `T`.
    #[must_use]
    pub fn device_as<T: Device + 'static>(&self, node: NodeId) -> Option<&T> {
        (self.on(node)? as &dyn std::any::Any).downcast_ref()
    }

    /// Returns the outputs of a device; `None` without power.
    #[must_use]
    pub fn outputs(&self, node: NodeId) -> Option<Outputs> {
        self.device(node).map(Device::outputs)
    }

    /// Returns the inputs of a device. The error mode of the controller is the value that the device sensed last. The
    /// angle of a linked shaft is the angle when the valve or the sensor was last served.
    #[must_use]
    pub fn inputs(&self, node: NodeId) -> &Inputs {
        &self.nodes[node.0].inputs
    }

    /// Sets the inputs of a device, except the error mode of the controller, the motion of a linked shaft and the
    /// roughness of a spool. See [`force_bus_off`](Self::force_bus_off), [`set_plant`](Self::set_plant) and
    /// [`set_roughness`](Self::set_roughness).
    pub fn set_inputs(&mut self, node: NodeId, inputs: Inputs) {
        self.follow_links(node);
        let mut inputs = self.as_linked(node, inputs);
        let now = self.now;
        let state = &mut self.nodes[node.0];
        let Node { inputs: sensed, power, electronics, rough, .. } = state;
        if let (Some(from), Some(to)) = (sensed.shaft(), inputs.shaft()) {
            rough.change_motion(from, to, now);
        }
        if let (Some(valve), Some(earlier)) = (inputs.valve_mut(), sensed.valve()) {
            valve.spool.roughness = earlier.spool.roughness;
        }
        *sensed = Inputs { bus: sensed.bus, ..inputs };
        electronics.has_new_inputs = matches!(power, Power::On(_));
        if !electronics.has_new_inputs {
            state.release(now);
        }
        self.watch_supply(node);
        self.service(node);
    }

    /// Returns the memory of a device.
    #[must_use]
    pub fn memory(&self, node: NodeId) -> &Memory {
        &self.nodes[node.0].memory
    }

    /// Returns the memory of a device, for fault injection.
    pub fn memory_mut(&mut self, node: NodeId) -> &mut Memory {
        &mut self.nodes[node.0].memory
    }

    /// Returns the CAN controller of a device, with its error counters and pending frames.
    #[must_use]
    pub fn port(&self, node: NodeId) -> &Port {
        self.bus.port(self.nodes[node.0].port)
    }

    /// Forces the controller of a device bus-off if `on`. Otherwise starts the recovery of the controller, which takes
    /// 128 sequences of 11 recessive bits.
    pub fn force_bus_off(&mut self, node: NodeId, on: bool) {
        let Node { port, power, forced_bus_off, .. } = &mut self.nodes[node.0];
        let port = *port;
        if std::mem::replace(forced_bus_off, on) == on || !matches!(power, Power::On(_)) {
            return;
        }
        self.bus.force_bus_off(port, on, self.now);
        self.service(node);
    }

    /// Returns whether the controller of a device is forced bus-off.
    #[must_use]
    pub fn is_bus_off_forced(&self, node: NodeId) -> bool {
        self.nodes[node.0].forced_bus_off
    }

    /// Adds a client that sends frames in FIFO order, receives all frames except its own, and acknowledges. Received
    /// frames are kept without limit until they are [taken](Self::take_received).
    pub fn add_client_port(&mut self, name: &str) -> ClientPortId {
        let port = self.bus.add_client(name.into(), self.bit_rate, usize::MAX, self.now);
        self.own(port, None);
        ClientPortId(port)
    }

    /// Adds a gateway: a client that discards received frames. A second controller, which never sends, acknowledges the
    /// gateway's frames even when a device sends the same frame simultaneously. The second controller also acknowledges
    /// the frames from a lone device, which therefore does not become error-passive.
    pub fn add_gateway(&mut self, name: &str) -> ClientPortId {
        let listener = format!("{name}{LISTENING}");
        let [port, _] = [name, &listener].map(|name| self.add_deaf_client(name.into()));
        port
    }

    /// Adds a [gateway](Self::add_gateway) that only sends. A fault that loses frames cannot name this gateway.
    pub fn add_sender(&mut self, name: &str) -> ClientPortId {
        let port = self.add_gateway(name);
        self.bus.only_send(port.0);
        port
    }

    /// Adds a client that discards received frames.
    fn add_deaf_client(&mut self, name: Arc<str>) -> ClientPortId {
        let port = self.bus.add_client(name, self.bit_rate, 0, self.now);
        self.own(port, None);
        ClientPortId(port)
    }

    /// Removes a client and drops its pending frames. Its [`ClientPortId`] may be reused.
    pub fn remove_client_port(&mut self, port: ClientPortId) {
        self.bus.remove(port.0, self.now);
    }

    /// Sends a frame from a client.
    pub fn send(&mut self, port: ClientPortId, frame: Frame) {
        // A client's queue has no limit.
        let _ = self.bus.hand_over(port.0, &frame, self.now);
        self.bus.refresh(port.0, self.now);
    }

    /// Drops a client's pending frames. A frame on the wire is cut off.
    pub fn withdraw(&mut self, port: ClientPortId) {
        self.bus.drop_pending(port.0, self.now);
    }

    /// Returns the number of a client's pending frames, including delayed frames and the frame on the wire.
    #[must_use]
    pub fn pending(&self, port: ClientPortId) -> usize {
        self.bus.port(port.0).pending()
    }

    /// Drops a client's pending frames, except the frame on the wire and the frames delayed by faults.
    pub fn drop_waiting(&mut self, port: ClientPortId) {
        self.bus.drop_waiting(port.0, self.now);
    }

    /// Returns whether a client's frame is on the wire.
    #[must_use]
    pub fn is_sending(&self, port: ClientPortId) -> bool {
        self.bus.is_sending(port.0)
    }

    /// Takes the frames that a client has received, oldest first, each with its end time.
    pub fn take_received(&mut self, port: ClientPortId) -> std::collections::vec_deque::Drain<'_, (Instant, Frame)> {
        self.bus.port_mut(port.0).take_received()
    }

    /// Returns the CAN controller of a client.
    #[must_use]
    pub fn client_port(&self, port: ClientPortId) -> &Port {
        self.bus.port(port.0)
    }

    /// Returns the bit rate of the bus and its clients.
    #[must_use]
    pub const fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    /// Changes the bit rate of the bus and its clients, but not of devices and external controllers.
    pub fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.bit_rate = bit_rate;
        self.rate_changes += 1;
        for (number, owner) in self.owners.iter().enumerate() {
            if owner.is_none() && !self.bus.is_external(PortId(number)) {
                self.bus.set_bit_rate(PortId(number), bit_rate, self.now);
            }
        }
    }

    /// Returns the bit rate of a device; for an unpowered device, the rate at its next start.
    pub(crate) fn device_rate(&self, node: NodeId) -> BitRate {
        let Node { factory, memory, .. } = &self.nodes[node.0];
        let restarted = || factory(&memory.peek_image(), StartCause::PowerOn, self.now).bit_rate();
        self.on(node).map_or_else(restarted, |device| device.bit_rate())
    }

    /// Returns whether a device has stopped communication to switch its bit rate.
    pub(crate) fn is_switching_bit_rate(&self, node: NodeId) -> bool {
        self.on(node).is_some_and(|device| device.is_switching_bit_rate())
    }

    /// Returns the counter of bit rate changes on the bus and in the devices, including starts, restarts and power
    /// cuts.
    pub(crate) const fn rate_changes(&self) -> u64 {
        self.rate_changes
    }

    fn set_device_rate(&mut self, node: NodeId, rate: BitRate) {
        self.rate_changes += 1;
        self.bus.set_bit_rate(self.nodes[node.0].port, rate, self.now);
    }

    /// Returns the load of the bus in the last second, in percent.
    #[must_use]
    pub fn load(&self) -> u8 {
        self.bus.load(self.now)
    }

    /// Adds an injector of bit errors.
    pub fn inject(&mut self, injector: impl Injector + Clone + 'static) {
        self.bus.inject(injector);
    }

    /// Destroys the next matching transmission attempts. Replaces any earlier disturbance.
    pub const fn disturb(&mut self, disturbance: Disturbance) {
        self.bus.disturbance = disturbance;
    }

    /// Returns the requested disturbance, with the remaining number of attempts to destroy.
    #[must_use]
    pub const fn disturbance(&self) -> Disturbance {
        self.bus.disturbance
    }

    /// Adds a communication fault, which starts now or later.
    ///
    /// # Errors
    /// [`FaultError`]; the faults are unchanged.
    pub fn fault(&mut self, fault: Fault) -> Result<(), FaultError> {
        let own: Vec<Arc<str>> = self.inserters.iter().map(|(name, _)| Arc::clone(name)).collect();
        self.bus.add_fault(fault, &own, self.now)
    }

    /// Ends a fault; returns whether the fault existed. Frames already delayed by the fault are still sent when due.
    pub fn end_fault(&mut self, name: &str) -> bool {
        let has_ended = self.bus.end_fault(name);
        self.end_insertions();
        has_ended
    }

    /// Ends all faults.
    pub fn end_faults(&mut self) {
        self.bus.end_faults();
        self.end_insertions();
    }

    fn end_insertions(&mut self) {
        for (name, port) in &self.inserters {
            if !self.bus.inserts(name) {
                self.bus.drop_waiting(port.0, self.now);
            }
        }
        self.dismiss_inserters();
    }

    /// Returns the faults in the order in which they were added. An expired fault remains listed until it is ended or a
    /// new fault replaces it.
    pub fn faults(&self) -> impl Iterator<Item = FaultState> {
        self.bus.faults(self.now)
    }

    /// Removes all injectors.
    pub fn clear_injectors(&mut self) {
        self.bus.clear_injectors();
    }

    /// Starts or stops recording events for [`take_events`](Self::take_events). Recording is initially off, because
    /// events that are never taken would fill the memory.
    pub fn record_events(&mut self, on: bool) {
        self.bus.journal.record(on);
    }

    /// Takes the recorded events, oldest first.
    pub fn take_events(&mut self) -> Drain<'_, Event> {
        self.bus.journal.take()
    }

    fn own(&mut self, port: PortId, owner: Option<NodeId>) {
        if port.0 == self.owners.len() {
            self.owners.push(owner);
        }
    }

    /// Returns a random duration up to `limit`, reproducible from the seed.
    fn jitter(&mut self, limit: Duration) -> Duration {
        Duration::from_ticks(self.random.u64(..=limit.as_ticks()))
    }
}
