//! The world: devices, their plant and their memory on one bus, in virtual time, event by event.
//!
//! At each instant the order is fixed: first what ends on the bus and those who hear it, then the devices that are due,
//! both in the order of their numbers, and at last the next frame starts. So a run depends on nothing but the calls and
//! the seed.

mod agenda;
mod client;
mod controller;
mod link;
mod node;
mod plant;
mod power;
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
pub use link::{Link, LinkError};
pub use node::{FAULT_LOG_WRITE_TIME, Factory, SimDevice, WRITE_TIME, Write, write_time};
pub use plant::{Plant, PlantError};
pub use power::SUPPLY_JITTER;
pub use run::FLUSH_PATIENCE;

pub use crate::bus::{Event, EventKind};

use crate::bus::{Bus, Disturbance, Injector, Port, PortId};
use crate::memory::Memory;

use agenda::Agenda;
use client::Connection;
use link::Coupling;
use node::{Node, Power};

/// A device of a world, by its number in the order of [`World::add_device`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(usize);

/// A client of a world's bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TapId(PortId);

/// Devices, their plant and their memory on one bus, in virtual time.
///
/// The clone of a world goes on as the original would: the same calls come to the same, at the same instants. Two things
/// stay with the original: the file that keeps a memory, for the clone has its own memory in RAM; and each [`Client`],
/// in whose place the clone has another one, to be taken with [`take_client`](Self::take_client).
#[derive(Clone)]
pub struct World {
    now: Instant,
    bit_rate: BitRate,
    /// The number of changes of the bus's rate, and of a device's: power-ups and restarts among them.
    rate_changes: u64,
    bus: Bus,
    nodes: Vec<Node>,
    agenda: Agenda,
    /// The shafts that follow a valve.
    couplings: Vec<Coupling>,
    /// Which device a port belongs to, by the port's number; `None` for a tap.
    owners: Vec<Option<NodeId>>,
    random: fastrand::Rng,
    /// The list of ports that are being looked at, to be used again.
    touched: Vec<PortId>,
    /// The clients that somebody else owns.
    clients: Vec<Connection>,
}

impl World {
    /// An empty world at instant 0.
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
        }
    }

    /// The virtual time.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Adds a healthy device with a new memory, not yet powered: a kind as it leaves the factory, or a [`Setup`].
    pub fn add(&mut self, name: &str, setup: impl Into<Setup>) -> NodeId {
        self.add_with(name, setup, Memory::in_ram())
    }

    /// Adds a healthy device with this memory, not yet powered. Where the memory holds something, it decides, not the
    /// setup. A setup without a bit rate takes that of the bus, if the product can run at it.
    pub fn add_with(&mut self, name: &str, setup: impl Into<Setup>, memory: Memory) -> NodeId {
        let setup: Setup = setup.into();
        let bit_rate = setup.bit_rate.or(Some(self.bit_rate).filter(|rate| setup.kind.bit_rates().contains(rate)));
        let setup = Setup { bit_rate, ..setup };
        let power_on = move |image: &Image, cause, now| AnyDevice::power_on(setup, image, cause, now).into();
        let node = self.add_device(name, power_on, memory);
        self.set_inputs(node, Inputs::healthy(setup.kind));
        node
    }

    /// Adds a device of any make, not yet powered. `factory` builds it from its memory each time it is powered up.
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
            write: None,
            forced_bus_off: false,
            frames_dropped: 0,
        });
        id
    }

    /// All devices.
    pub fn devices(&self) -> impl Iterator<Item = NodeId> + use<> {
        (0..self.nodes.len()).map(NodeId)
    }

    /// The name of a device.
    #[must_use]
    pub fn name(&self, node: NodeId) -> &str {
        &self.nodes[node.0].name
    }

    /// The device of that name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<NodeId> {
        self.devices().find(|node| self.name(*node) == name)
    }

    /// A device, while it is powered.
    #[must_use]
    pub fn device(&self, node: NodeId) -> Option<&dyn Device> {
        match &self.nodes[node.0].power {
            Power::On(device) => Some(&**device),
            _ => None,
        }
    }

    /// A device as what it is, while it is powered and a `T`.
    #[must_use]
    pub fn device_as<T: Device + 'static>(&self, node: NodeId) -> Option<&T> {
        match &self.nodes[node.0].power {
            Power::On(device) => (&**device as &dyn std::any::Any).downcast_ref(),
            _ => None,
        }
    }

    /// What a device drives, while it is powered.
    #[must_use]
    pub fn outputs(&self, node: NodeId) -> Option<Outputs> {
        self.device(node).map(Device::outputs)
    }

    /// Returns the inputs of a device. The bus mode in them is that of its controller; the shaft of a linked sensor is as
    /// the device last saw it.
    #[must_use]
    pub fn inputs(&self, node: NodeId) -> &Inputs {
        &self.nodes[node.0].inputs
    }

    /// Changes what a device senses. The bus mode in it is not looked at: see [`force_bus_off`](Self::force_bus_off);
    /// nor is the angle of a shaft that follows a valve: see [`set_plant`](Self::set_plant).
    pub fn set_inputs(&mut self, node: NodeId, inputs: Inputs) {
        self.follow_links(node);
        let now = self.now;
        let inputs = self.as_linked(node, inputs);
        let Node { inputs: sensed, power, .. } = &mut self.nodes[node.0];
        *sensed = Inputs { bus: sensed.bus, ..inputs };
        if let Power::On(device) = power {
            device.sense(sensed, now);
            self.service(node);
        }
    }

    /// The memory of a device.
    #[must_use]
    pub fn memory(&self, node: NodeId) -> &Memory {
        &self.nodes[node.0].memory
    }

    /// The memory of a device, to inject faults into.
    pub fn memory_mut(&mut self, node: NodeId) -> &mut Memory {
        &mut self.nodes[node.0].memory
    }

    /// The CAN controller of a device: its error counters and what waits in it.
    #[must_use]
    pub fn port(&self, node: NodeId) -> &Port {
        self.bus.port(self.nodes[node.0].port)
    }

    /// Keeps the controller of a device bus-off, or lets it recover: after 128 sequences of 11 recessive bits.
    pub fn force_bus_off(&mut self, node: NodeId, on: bool) {
        let Node { port, power, forced_bus_off, .. } = &mut self.nodes[node.0];
        let port = *port;
        if std::mem::replace(forced_bus_off, on) == on || !matches!(power, Power::On(_)) {
            return;
        }
        self.bus.force_bus_off(port, on, self.now);
        self.service(node);
    }

    /// Whether the controller of a device is kept bus-off.
    #[must_use]
    pub fn is_bus_off_forced(&self, node: NodeId) -> bool {
        self.nodes[node.0].forced_bus_off
    }

    /// Adds a client: it sends in the order it is told to, hears everything but its own frames, and acknowledges. What
    /// it hears is kept until it is [taken](Self::take_received), however much.
    pub fn add_tap(&mut self, name: &str) -> TapId {
        let port = self.bus.add_tap(name.into(), self.bit_rate, self.now);
        self.own(port, None);
        TapId(port)
    }

    /// Adds a gateway: a client that keeps nothing of what it hears. It has a second controller that sends nothing and
    /// so acknowledges whatever its clients send, even when a device sends the very same frame at the same moment; and
    /// a lone device does not go error-passive.
    pub fn add_gateway(&mut self, name: &str) -> TapId {
        let listener = format!("{name}, listening");
        let [port, listener] = [name, &listener].map(|name| self.bus.add_gateway(name.into(), self.bit_rate, self.now));
        self.own(port, None);
        self.own(listener, None);
        TapId(port)
    }

    /// Takes a client away, with all that it had to send. Its [`TapId`] may be given to another client.
    pub fn remove_tap(&mut self, tap: TapId) {
        self.bus.remove(tap.0, self.now);
    }

    /// Gives a client's frame to the bus.
    pub fn send(&mut self, tap: TapId, frame: Frame) {
        // A client's queue takes everything.
        let _ = embedded_can::nb::Can::transmit(self.bus.port_mut(tap.0), &frame);
        self.bus.refresh(tap.0, self.now);
    }

    /// Takes back what a client has given to the bus; a frame on the wire is cut off.
    pub fn withdraw(&mut self, tap: TapId) {
        self.bus.drop_pending(tap.0, self.now);
    }

    /// How many frames of a client are not sent yet, the one on the wire included.
    #[must_use]
    pub fn pending(&self, tap: TapId) -> usize {
        self.bus.port(tap.0).pending()
    }

    /// Whether a frame of a client is on the wire.
    #[must_use]
    pub fn is_sending(&self, tap: TapId) -> bool {
        self.bus.is_sending(tap.0)
    }

    /// What a client has heard since this was last asked, oldest first, each with the end of the frame.
    pub fn take_received(&mut self, tap: TapId) -> std::collections::vec_deque::Drain<'_, (Instant, Frame)> {
        self.bus.port_mut(tap.0).take_received()
    }

    /// The controller of a client.
    #[must_use]
    pub fn tap_port(&self, tap: TapId) -> &Port {
        self.bus.port(tap.0)
    }

    /// The bit rate of the bus: that of its clients, and the one that a new device's controller starts with.
    #[must_use]
    pub const fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    /// Changes the bit rate of the bus and of all its clients: the master that changes its rate.
    pub fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.bit_rate = bit_rate;
        self.rate_changes += 1;
        for (number, owner) in self.owners.iter().enumerate() {
            if owner.is_none() && !self.bus.is_external(PortId(number)) {
                self.bus.set_bit_rate(PortId(number), bit_rate, self.now);
            }
        }
    }

    /// Returns the bit rate that a device is set to; without power, the one that it would start with.
    pub(crate) fn device_rate(&self, node: NodeId) -> BitRate {
        let Node { factory, memory, power, .. } = &self.nodes[node.0];
        match power {
            Power::On(device) => device.bit_rate(),
            _ => factory(&memory.peek_image(), StartCause::PowerOn, self.now).bit_rate(),
        }
    }

    /// Returns whether a device is changing its bit rate, and silent meanwhile.
    pub(crate) fn is_switching_bit_rate(&self, node: NodeId) -> bool {
        matches!(&self.nodes[node.0].power, Power::On(device) if device.is_switching_bit_rate())
    }

    /// Returns the number of changes of the bus's bit rate, and of the devices': power-ups and restarts among them.
    pub(crate) const fn rate_changes(&self) -> u64 {
        self.rate_changes
    }

    /// Sets the controller of a device to a bit rate.
    fn set_device_rate(&mut self, node: NodeId, rate: BitRate) {
        self.rate_changes += 1;
        self.bus.set_bit_rate(self.nodes[node.0].port, rate, self.now);
    }

    /// How busy the bus was in the last second, in percent.
    #[must_use]
    pub fn load(&self) -> u8 {
        self.bus.load(self.now)
    }

    /// Adds something that disturbs the bus.
    pub fn inject(&mut self, injector: impl Injector + Clone + 'static) {
        self.bus.inject(injector);
    }

    /// Destroys the next attempts to send a frame, in the place of an earlier such disturbance.
    pub const fn disturb(&mut self, disturbance: Disturbance) {
        self.bus.disturb(disturbance);
    }

    /// What is left of the last [`disturb`](Self::disturb).
    #[must_use]
    pub const fn disturbance(&self) -> Disturbance {
        self.bus.disturbance()
    }

    /// Takes away all injectors.
    pub fn clear_injectors(&mut self) {
        self.bus.clear_injectors();
    }

    /// Records from now on what happens, to be taken with [`take_events`](Self::take_events); or does so no longer.
    /// A new world records nothing: events that nobody takes would fill the memory.
    pub fn record_events(&mut self, on: bool) {
        self.bus.record_events(on);
    }

    /// Takes what happened since this was last called, oldest first.
    pub fn take_events(&mut self) -> Drain<'_, Event> {
        self.bus.take_events()
    }

    fn own(&mut self, port: PortId, owner: Option<NodeId>) {
        if port.0 == self.owners.len() {
            self.owners.push(owner);
        }
    }

    /// A random time up to `limit`, the same in each run with one seed.
    fn jitter(&mut self, limit: Duration) -> Duration {
        Duration::from_ticks(self.random.u64(..=limit.as_ticks()))
    }
}
