//! The bench of the simulator: a world in virtual time, without a gateway.

use std::collections::VecDeque;

use protocol_core::controller::BitRate;
use protocol_core::device::{Kind, Setup};
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER};

use super::play::Bench;
use super::script::{Device, UseCase};
use crate::world::{Plant, TapId, World};

/// Devices and a master in a world of their own.
pub struct SimulatedBench {
    world: World,
    master: TapId,
    received: VecDeque<Frame>,
}

impl SimulatedBench {
    /// Returns the bench that a use case wants: its devices, switched off, at the bit rate that they start with.
    #[must_use]
    pub fn new(case: &UseCase) -> Self {
        let mut world = World::new(case.bit_rate(), 0);
        let master = world.add_tap("master");
        for Device { kind, node_id, serial } in case.devices {
            let setup = Setup { node_id: Some(*node_id), serial: *serial, ..Setup::<Kind>::new(*kind) };
            world.add(kind.name(), setup);
        }
        Self { world, master, received: VecDeque::new() }
    }

    fn collect(&mut self) {
        self.received.extend(self.world.take_received(self.master).map(|(_, frame)| frame));
    }
}

impl Bench for SimulatedBench {
    fn power_cycle(&mut self) {
        for on in [false, true] {
            for device in self.world.devices() {
                self.world.power(device, on);
            }
        }
    }

    fn send(&mut self, frame: Frame) {
        self.world.send(self.master, frame);
    }

    fn receive(&mut self, until: Instant) -> Option<Frame> {
        loop {
            self.collect();
            if let Some(frame) = self.received.pop_front() {
                return Some(frame);
            }
            let next = self.world.next_event();
            if next > until || next == NEVER {
                self.world.run_until(until);
                self.collect();
                return self.received.pop_front();
            }
            self.world.step();
        }
    }

    /// # Panics
    /// When a device has no such plant: scripts are part of the program.
    fn set_plant(&mut self, plant: Plant) {
        for device in self.world.devices() {
            if let Err(error) = self.world.set_plant(device, plant) {
                panic!("{}: {error}", self.world.name(device));
            }
        }
    }

    fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.world.set_bit_rate(bit_rate);
    }

    fn now(&self) -> Instant {
        self.world.now()
    }
}
