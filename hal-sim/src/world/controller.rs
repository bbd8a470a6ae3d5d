//! External controllers on the bus of a world, such as the emulated controller of a firmware image.

use std::collections::vec_deque::Drain;

use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::World;
use crate::bus::{Port, PortId, WireEvent};

/// An external controller on a world's bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ControllerId(PortId);

impl World {
    /// Adds an external controller, initially disconnected.
    pub fn add_controller(&mut self, name: &str) -> ControllerId {
        let port = self.bus.add_external(name.into(), self.bit_rate);
        self.own(port, None);
        ControllerId(port)
    }

    /// Connects the controller at a bit rate. The controller participates after 11 recessive bits. A silent controller
    /// receives but never drives the bus.
    pub fn attach(&mut self, controller: ControllerId, rate: BitRate, silent: bool) {
        self.bus.attach(controller.0, rate, silent, self.now);
    }

    /// Disconnects the controller without clearing its error counters.
    pub fn detach(&mut self, controller: ControllerId) {
        self.bus.detach(controller.0, false, self.now);
    }

    /// Disconnects the controller and clears its error counters, as after a chip reset or a power loss.
    pub fn reset_controller(&mut self, controller: ControllerId) {
        self.bus.detach(controller.0, true, self.now);
    }

    /// Sets the frame that the controller sends next. The caller must repeat the call after each event of the
    /// controller.
    pub fn offer(&mut self, controller: ControllerId, frame: Option<Frame>) {
        self.bus.offer(controller.0, frame, self.now);
    }

    /// Starts the recovery of a bus-off controller, which takes 128 sequences of 11 recessive bits.
    pub fn start_recovery(&mut self, controller: ControllerId) {
        self.bus.start_recovery(controller.0, self.now);
    }

    /// Takes the wire events of the controller since the last call, each with its instant.
    pub fn take_wire_events(&mut self, controller: ControllerId) -> Option<Drain<'_, (Instant, WireEvent)>> {
        self.bus.take_wire_events(controller.0)
    }

    /// Returns the port of the controller, with the error mode as calculated by the bus.
    #[must_use]
    pub fn controller_port(&self, controller: ControllerId) -> &Port {
        self.bus.port(controller.0)
    }
}
