//! Valves and a master on a simulated bus, with real memories, for tests that need bus errors or a flash.

use hal_sim::bus::Confinement;
use hal_sim::memory::Flash;
use hal_sim::{ClientPortId, Memory, NodeId, World};
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::device::ValveOutputs;
use protocol_core::device::pve::{Kind, PveCanopen, Setup};
use protocol_core::frame::Frame;
use protocol_core::memory::Image;
use protocol_core::time::{Duration, Instant, after};

use super::{Inputs, frame};

/// The time for which the master waits for an answer.
const PATIENCE: Duration = Duration::from_millis(500);

/// Valves and a master on a bus of 250 kbit/s, in virtual time.
pub struct BusRig {
    /// The world of valves and master.
    pub world: World,
    /// The master.
    pub master: ClientPortId,
}

impl Default for BusRig {
    /// Creates a bus with a master and no valve.
    fn default() -> Self {
        let mut world = World::new(BitRate::Kbit250, 0);
        let master = world.add_client_port("master");
        Self { world, master }
    }
}

impl BusRig {
    /// Creates a bus with a master and one `pvea-canopen` with this memory, switched off. With a new memory it is node
    /// 0x20.
    #[must_use]
    pub fn with_flash(flash: Flash) -> (Self, NodeId) {
        let mut rig = Self::default();
        let valve = rig.add(Setup::new(Kind::PveaCanopen), Memory::with_flash(flash));
        (rig, valve)
    }

    /// Creates a bus with a master and a new `pvea-canopen` at node 0x20, booted, without the frames of its boot.
    #[must_use]
    pub fn booted() -> (Self, NodeId) {
        let (mut rig, valve) = Self::with_flash(Flash::new());
        rig.boot(valve);
        (rig, valve)
    }

    /// Adds a valve, switched off.
    pub fn add(&mut self, setup: Setup, memory: Memory) -> NodeId {
        let name = format!("valve-{}", self.world.devices().count() + 1);
        let factory = move |image: &Image, cause, now| Box::new(PveCanopen::power_on(setup, image, cause, now)) as _;
        self.world.add_device(&name, factory, memory)
    }

    /// Adds a new valve with this node ID, boots it and drops its frames.
    pub fn add_booted(&mut self, node_id: u8) -> NodeId {
        let setup = Setup { node_id: Some(node_id), ..Setup::new(Kind::PveaCanopen) };
        let valve = self.add(setup, Memory::in_ram());
        self.boot(valve);
        valve
    }

    /// Switches a valve on and runs for 50 ms. Returns the frames on the bus.
    pub fn boot(&mut self, valve: NodeId) -> Vec<String> {
        self.world.power(valve, true);
        self.run_for(50);
        self.take()
    }

    /// Advances the time by a number of milliseconds.
    pub fn run_for(&mut self, ms: u64) {
        let end = after(self.world.now(), Duration::from_millis(ms));
        self.world.run_until(end);
    }

    /// Sends a frame from the master.
    pub fn send(&mut self, text: &str) {
        self.world.send(self.master, frame(text));
    }

    /// Takes the frames that the master has received.
    pub fn take(&mut self) -> Vec<String> {
        self.world.take_received(self.master).map(|(_, frame)| frame.to_string()).collect()
    }

    /// Runs until the master receives a frame, and takes it; `None` if none comes in time.
    pub fn hear(&mut self) -> Option<(Instant, Frame)> {
        let end = after(self.world.now(), PATIENCE);
        loop {
            let first = self.world.take_received(self.master).next();
            if first.is_some() || self.world.next_event() > end {
                return first;
            }
            self.world.step();
        }
    }

    /// Sends a frame. Returns the next frame that the master receives, in the notation of the manuals.
    pub fn ask(&mut self, request: &str) -> Option<String> {
        self.send(request);
        self.hear().map(|(_, frame)| frame.to_string())
    }

    /// Sends a frame, and asserts the next frame that the master receives.
    #[track_caller]
    pub fn exchange(&mut self, request: &str, answer: &str) {
        assert_eq!(self.ask(request).as_deref(), Some(answer), "answer to {request}");
    }

    /// Reads a number by SDO; `None` without such an answer.
    pub fn read(&mut self, node_id: u8, index: u16, sub: u8) -> Option<u32> {
        let [low, high] = index.to_le_bytes();
        self.send(&format!("{:03X}: 40 {low:02X} {high:02X} {sub:02X} 00 00 00 00", 0x600 + u16::from(node_id)));
        match *self.hear()?.1.data() {
            [0x43 | 0x47 | 0x4B | 0x4F, .., a, b, c, d] => Some(u32::from_le_bytes([a, b, c, d])),
            _ => None,
        }
    }

    /// Writes a number of `size` bytes by SDO. Returns whether the device confirmed it.
    pub fn write(&mut self, node_id: u8, (index, sub, size, value): (u16, u8, u8, u32)) -> bool {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        let command = 0x23 | (4 - size) << 2;
        let id = 0x600 + u16::from(node_id);
        self.send(&format!("{id:03X}: {command:02X} {low:02X} {high:02X} {sub:02X} {a:02X} {b:02X} {c:02X} {d:02X}"));
        self.hear().is_some_and(|(_, answer)| answer.data()[0] == 0x60)
    }

    /// Changes the inputs of a valve.
    pub fn sense(&mut self, valve: NodeId, change: impl FnOnce(&mut Inputs)) {
        let mut inputs = Inputs::from(*self.world.inputs(valve));
        change(&mut inputs);
        self.world.set_inputs(valve, inputs.into());
    }

    /// Returns the outputs of a valve.
    ///
    /// # Panics
    /// Panics for a valve without power.
    #[must_use]
    pub fn outputs(&self, valve: NodeId) -> ValveOutputs {
        self.world.outputs(valve).expect("powered").valve().expect("a valve")
    }

    /// Returns the error mode of a valve's CAN controller.
    #[must_use]
    pub fn mode(&self, valve: NodeId) -> BusErrorMode {
        self.world.port(valve).mode()
    }

    /// Returns the error counters of a valve's CAN controller.
    #[must_use]
    pub fn errors(&self, valve: NodeId) -> Confinement {
        self.world.port(valve).confinement()
    }
}
