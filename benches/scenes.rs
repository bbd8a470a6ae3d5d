//! Worlds of many valves, for the benchmarks.

use hal_sim::{ClientPortId, World};
use protocol_core::controller::BitRate;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after};

/// The number of node IDs.
const NODE_IDS: usize = 127;
/// The SYNC period at which 20 valves, each with a TPDO at every SYNC, load the bus by 80 %.
const SYNC_PERIOD: Duration = Duration::from_micros(8_800);

/// Valves and a client on a bus of 250 kbit/s.
#[derive(Clone)]
pub(crate) struct Scene {
    world: World,
    client: ClientPortId,
}

/// Parses a frame in the notation of the manuals.
pub(crate) fn frame(text: &str) -> Frame {
    text.parse().expect("a frame")
}

impl Scene {
    /// Creates valves at node IDs 1, 2, 3 …, beginning again after 127, without power.
    fn new(valves: usize) -> Self {
        let mut world = World::new(BitRate::Kbit250, 0);
        let client = world.add_client_port("client");
        for number in 0..valves {
            let serial = u32::try_from(number).expect("a small number");
            let node_id = u8::try_from(number % NODE_IDS).expect("a node ID") + 1;
            let setup = Setup { node_id: Some(node_id), serial: Some(serial), ..Setup::new(Kind::PveaCanopen) };
            world.add(&format!("valve-{number}"), setup);
        }
        Self { world, client }
    }

    /// Creates valves that have booted and have nothing to do.
    pub(crate) fn idle(valves: usize) -> Box<Self> {
        let mut scene = Self::new(valves);
        scene.world.power_all(Duration::from_millis(5));
        scene.run_for(Duration::from_secs(1));
        scene.hear();
        // One-time allocations happen here.
        scene.pass(frame("1A2: 00"), 1);
        scene.pass(frame("601: 40 18 10 01 00 00 00 00"), 2);
        Box::new(scene)
    }

    /// Creates 20 valves that send a TPDO at every SYNC.
    pub(crate) fn sync_driven() -> Box<Self> {
        let mut scene = Self::idle(20);
        for node_id in 1..=20 {
            scene.pass(frame(&format!("{:03X}: 2F 00 18 02 01 00 00 00", 0x600 + node_id)), 2);
        }
        scene.send(frame("000: 01 00"));
        scene.run_for(Duration::from_secs(1));
        scene.sync_for(2);
        scene
    }

    /// Creates 1,000 valves with heartbeats of 1 s, each at its own phase.
    pub(crate) fn heartbeats() -> Box<Self> {
        let mut scene = Self::new(1000);
        scene.world.power_all(Duration::from_millis(5));
        scene.run_for(Duration::from_secs(2));
        scene.hear();
        // Valves with the same node ID give the same answer at the same time.
        for node_id in 1..=NODE_IDS {
            for text in ["2B 17 10 00 E8 03 00 00", "23 10 10 01 73 61 76 65"] {
                scene.send(frame(&format!("{:03X}: {text}", 0x600 + node_id)));
            }
        }
        scene.run_for(Duration::from_secs(1));
        for valve in scene.world.devices() {
            scene.world.power(valve, false);
        }
        scene.world.power_all(Duration::from_secs(1));
        scene.run_for(Duration::from_secs(2));
        scene.hear();
        scene.beat_for(1);
        Box::new(scene)
    }

    /// Sends a frame, and runs until a number of frames have been on the bus, this one included.
    pub(crate) fn pass(&mut self, frame: Frame, frames: usize) {
        self.send(frame);
        for _ in 0..2 * frames {
            self.world.step();
        }
        assert_eq!((self.world.pending(self.client), self.hear()), (0, frames - 1));
    }

    /// Sends SYNCs for a number of seconds.
    pub(crate) fn sync_for(&mut self, seconds: u64) {
        let cycles = Duration::from_secs(seconds).as_ticks() / SYNC_PERIOD.as_ticks();
        let sync = frame("080:");
        self.hear();
        for _ in 0..cycles {
            self.send(sync);
            self.run_for(SYNC_PERIOD);
        }
        assert_eq!(self.hear() as u64, cycles * 20, "one TPDO of every valve for every SYNC");
        let load = self.world.load();
        assert!((75..=85).contains(&load), "{load} % load");
    }

    /// Runs for a number of seconds of heartbeats.
    pub(crate) fn beat_for(&mut self, seconds: u64) {
        self.run_for(Duration::from_secs(seconds));
        let heard = self.hear() as u64;
        // Two heartbeats under the same node ID that start at the same time are one frame.
        assert!((seconds * 950..=seconds * 1000).contains(&heard), "{heard} heartbeats");
    }

    fn send(&mut self, frame: Frame) {
        self.world.send(self.client, frame);
    }

    fn run_for(&mut self, time: Duration) {
        let end: Instant = after(self.world.now(), time);
        self.world.run_until(end);
    }

    /// Returns the number of frames that the client has received since the previous call.
    fn hear(&mut self) -> usize {
        self.world.take_received(self.client).count()
    }
}
