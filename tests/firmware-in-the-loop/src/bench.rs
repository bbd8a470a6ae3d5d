//! The bench of the use cases with the flashed image in the place of the first valve.
//!
//! The image is not told what it is: its flash holds what a host device of that node ID and serial number has stored in
//! its own. Further valves of a use case are host devices.

use std::collections::VecDeque;

use hal_sim::use_case::{Bench, Device, Plant, UseCase};
use hal_sim::world::SUPPLY_JITTER;
use hal_sim::{NodeId, TapId, World};
use protocol_core::controller::BitRate;
use protocol_core::device::Setup;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use crate::board::Board;
use crate::content;
use crate::rig::{BoardId, Rig};

/// One emulated board, host devices and a master.
pub struct ImageBench {
    /// The board and its world.
    pub rig: Rig,
    /// The board.
    pub board: BoardId,
    /// The master.
    pub master: TapId,
    others: Vec<NodeId>,
    received: VecDeque<Frame>,
}

impl ImageBench {
    /// What a use case wants: its devices, switched off, at the bit rate that they start with.
    ///
    /// # Panics
    /// When the use case has no device.
    #[must_use]
    pub fn new(board: &'static Board, case: &UseCase) -> Self {
        let (first, others) = case.devices.split_first().expect("a use case has a device");
        Self::with_devices(board, case.bit_rate(), first, others)
    }

    /// The image as the device `first`, and host devices, switched off.
    #[must_use]
    pub fn with_devices(board: &'static Board, bit_rate: BitRate, first: &Device, others: &[Device]) -> Self {
        Self::with_memory(board, bit_rate, &content::stored_by(first), others)
    }

    /// The image with these bytes in its memory, and host devices, switched off.
    #[must_use]
    pub fn with_memory(board: &'static Board, bit_rate: BitRate, memory: &[u8], others: &[Device]) -> Self {
        let mut rig = Rig::new(bit_rate);
        let master = rig.world.add_tap("master");
        let board = rig.add_board(board, "board", memory);
        let others = others.iter().map(|device| add_host_device(&mut rig.world, device)).collect();
        Self { rig, board, master, others, received: VecDeque::new() }
    }

    fn collect(&mut self) {
        self.received.extend(self.rig.world.take_received(self.master).map(|(_, frame)| frame));
    }
}

pub(crate) fn add_host_device(world: &mut World, device: &Device) -> NodeId {
    let setup = Setup { node_id: Some(device.node_id), serial: device.serial, ..Setup::from(device.kind) };
    world.add(device.kind.name(), setup)
}

impl Bench for ImageBench {
    fn power_cycle(&mut self) {
        self.rig.power(self.board, false);
        for other in &self.others {
            self.rig.world.power(*other, false);
        }
        self.rig.power(self.board, true);
        if !self.others.is_empty() {
            // A host device boots in no time. The use cases want the first valve first, and the supply lets them start
            // so.
            self.rig.run_for(SUPPLY_JITTER);
        }
        for other in &self.others {
            self.rig.world.power(*other, true);
        }
    }

    fn send(&mut self, frame: Frame) {
        self.rig.world.send(self.master, frame);
    }

    fn receive(&mut self, until: Instant) -> Option<Frame> {
        loop {
            self.collect();
            if let Some(frame) = self.received.pop_front() {
                return Some(frame);
            }
            if self.rig.world.now() >= until {
                return None;
            }
            self.rig.step(until);
        }
    }

    fn set_plant(&mut self, plant: Plant) {
        self.rig.type_line(self.board, &plant.to_string());
        for other in &self.others {
            if let Plant::SupplyMv(millivolt) = plant {
                let mut senses = *self.rig.world.senses(*other);
                if let Some(valve) = senses.valve_mut() {
                    valve.supply_mv = millivolt;
                }
                self.rig.world.set_senses(*other, senses);
            }
        }
    }

    fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.rig.world.set_bit_rate(bit_rate);
    }

    fn now(&self) -> Instant {
        self.rig.world.now()
    }
}
