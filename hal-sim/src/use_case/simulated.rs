//! The bench of the simulator: a world in virtual time, without a gateway.

use std::collections::VecDeque;

use protocol_core::actuator::Position;
use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER};

use super::plant::Plant;
use super::play::Bench;
use super::script::UseCase;
use crate::kind::{Birth, Kind};
use crate::memory::Memory;
use crate::world::{TapId, World};

/// Valves and a master in a world of their own.
pub struct SimulatedBench {
    world: World,
    master: TapId,
    received: VecDeque<Frame>,
}

impl SimulatedBench {
    /// The bench that a use case wants: its valves, switched off, at 250 kbit/s.
    #[must_use]
    pub fn new(case: &UseCase) -> Self {
        let mut world = World::new(BitRate::Kbit250, 0);
        let master = world.add_tap("master");
        for valve in case.valves {
            let birth = Birth { node_id: Some(valve.node_id), serial: valve.serial };
            world.add_device(valve.kind.name(), Kind::Pve(valve.kind).factory(birth), Memory::in_ram());
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

    fn set_plant(&mut self, plant: Plant) {
        for device in self.world.devices() {
            let mut senses = *self.world.senses(device);
            match (plant, senses.valve_mut()) {
                (Plant::InternalFault(there), _) => senses.internal_fault = there,
                (Plant::BusOff(there), _) => self.world.force_bus_off(device, there),
                (Plant::SupplyMv(millivolt), Some(valve)) => valve.supply_mv = millivolt,
                (Plant::TemperatureC(celsius), Some(valve)) => valve.temperature_c = celsius,
                (Plant::Spool(fault), Some(valve)) => valve.spool.fault = fault,
                (Plant::Lever(pushed), Some(valve)) => {
                    valve.spool.lever = pushed.map(|raw| Position::clamped(raw.into()));
                }
                (_, None) => {}
            }
            self.world.set_senses(device, senses);
        }
    }

    fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.world.set_bit_rate(bit_rate);
    }

    fn now(&self) -> Instant {
        self.world.now()
    }
}
