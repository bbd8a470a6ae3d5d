//! A rig for one or two devices and a master on a simulated bus, in virtual time.

use hal_sim::bus::{Disturbance, EventKind};
use hal_sim::{BitRate, ClientPortId, Duration, Frame, Instant, Kind, Memory, NodeId, Setup, World};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::plant::Plant;
use protocol_core::time::{after, since};

use super::ledger::Ledger;
use super::well_formed::check;

/// The maximum number of events of the simulated world in an attack. It shortens hours of a busy bus.
const EVENTS: u32 = 30_000;

/// The number of an operation that never comes, for a flash that does not fail.
const NEVER_FAILS: u64 = u64::MAX;

/// The maximum silence by LSS: twice the longest delay, and the time for which a flood delays the request.
const LSS_SILENCE: Duration = Duration::from_secs(135);

/// The maximum time of an answer after the request was on the bus.
const ANSWERED: Duration = Duration::from_millis(100);

/// The maximum number of times that a client waits for the answers to others.
const WAITS: usize = 20;

/// A device on the bus.
pub(super) struct Unit {
    pub(super) node: NodeId,
    pub(super) kind: Kind,
    name: String,
    /// The knowledge of its memory.
    pub(super) ledger: Ledger,
    /// Whether writes may have failed since its last power-up.
    pub(super) memory_hurt: bool,
    /// Whether its memory had any content. Records may then be damaged until they are written.
    pub(super) damaged: bool,
    /// The frames that it has sent since they were last taken.
    sent: Vec<(Instant, Frame)>,
}

/// Devices and a master on a bus.
pub(super) struct Rig {
    pub(super) world: World,
    /// The master, which also acknowledges; `None` if only the devices are on the bus.
    master: Option<ClientPortId>,
    /// A node whose frames are more urgent than all others.
    flood: Option<ClientPortId>,
    pub(super) units: Vec<Unit>,
    events_left: u32,
    /// The time until which LSS may silence a device.
    silent_until: Instant,
}

impl Rig {
    pub(super) fn new(bit_rate: BitRate) -> Self {
        let mut world = World::new(bit_rate, 0);
        world.record_events(true);
        let master = Some(world.add_client_port("master"));
        Self { world, master, flood: None, units: Vec::new(), events_left: EVENTS, silent_until: Instant::MIN }
    }

    /// Adds a device without power. The content of a new memory is known.
    pub(super) fn add(&mut self, setup: Setup, memory: Memory, is_new: bool) {
        let name = format!("device-{}", self.units.len());
        let node = self.world.add_with(&name, setup, memory);
        let ledger = Ledger::of(setup, is_new);
        self.units.push(Unit {
            node,
            kind: setup.kind,
            name,
            ledger,
            memory_hurt: false,
            damaged: !is_new,
            sent: Vec::new(),
        });
    }

    pub(super) fn send(&mut self, frame: Frame) {
        if let Some(master) = self.master {
            self.world.send(master, frame);
        }
    }

    /// Advances the time, as far as the attack may.
    pub(super) fn run(&mut self, time: Duration) {
        let end = after(self.world.now(), time);
        while self.world.next_event() <= end && self.events_left > 0 {
            self.events_left -= 1;
            self.world.step();
        }
        if self.events_left > 0 {
            self.world.run_until(end);
        }
        self.listen();
    }

    /// Records the sent frames of the devices, and asserts that each is well-formed.
    fn listen(&mut self) {
        for event in self.world.take_events() {
            let EventKind::Frame { frame, .. } = event.what else { continue };
            if let Some(unit) = self.units.iter_mut().find(|unit| *unit.name == *event.who) {
                check(unit.kind, &frame);
                unit.sent.push((event.at, frame));
            }
        }
        if let Some(master) = self.master {
            self.world.take_received(master);
        }
        if let Some(flood) = self.flood {
            self.world.take_received(flood);
        }
    }

    /// Forgets the sent frames of the devices.
    pub(super) fn forget_sent(&mut self) {
        self.listen();
        self.units.iter_mut().for_each(|unit| unit.sent.clear());
    }

    /// Runs for a time. Returns the frames that a device sends.
    pub(super) fn watch(&mut self, unit: usize, time: Duration) -> Vec<(Instant, Frame)> {
        self.forget_sent();
        self.events_left = u32::MAX;
        self.run(time);
        std::mem::take(&mut self.units[unit].sent)
    }

    /// Sends a request. Returns the answer of a device; `None` if none comes in time.
    pub(super) fn ask(&mut self, unit: usize, request: Frame, is_answer: impl Fn(&Frame) -> bool) -> Option<Frame> {
        self.forget_sent();
        self.send(request);
        let end = after(self.world.now(), self.patience());
        let mut seen = 0;
        while self.world.next_event() <= end && self.events_left > 0 {
            self.events_left -= 1;
            self.world.step();
            self.listen();
            let sent = &self.units[unit].sent;
            if let Some((_, answer)) = sent[seen..].iter().find(|(_, frame)| is_answer(frame)) {
                return Some(*answer);
            }
            seen = sent.len();
        }
        None
    }

    /// Waits until the requests of others are answered, because a client takes their answers for its own. Returns
    /// `false` if that takes too long.
    pub(super) fn settle(&mut self) -> bool {
        (0..WAITS).any(|_| {
            let all_asked = self.master.is_none_or(|master| self.world.pending(master) == 0);
            self.run(ANSWERED);
            let all_answered = self.units.iter().all(|unit| {
                let port = self.world.port(unit.node);
                let is_off = port.mode() == BusErrorMode::BusOff;
                self.world.is_bus_off_forced(unit.node) || !is_off && port.pending() == 0
            });
            all_asked && all_answered
        })
    }

    /// Returns the maximum time of an answer: a write of each record, and all more urgent frames.
    fn patience(&self) -> Duration {
        Duration::from_millis(250) + self.frame_time() * 50
    }

    /// Records an activation of a bit rate by LSS, which silences the device for twice its delay.
    pub(super) fn silence_begins(&mut self) {
        self.silent_until = after(self.world.now(), LSS_SILENCE);
    }

    /// Returns the maximum remaining silence by LSS.
    pub(super) fn silence(&self) -> Duration {
        since(self.silent_until, self.world.now())
    }

    /// Returns the maximum duration of a frame.
    pub(super) fn frame_time(&self) -> Duration {
        Duration::from_micros(160 * 1_000_000 / u64::from(self.world.bit_rate().bits_per_second()))
    }

    /// Returns the node ID or address in force.
    pub(super) fn id(&self, unit: usize) -> Option<u8> {
        self.world.device(self.units[unit].node)?.node_id()
    }

    /// Returns whether a device's controller is error-active.
    pub(super) fn is_error_active(&self, unit: usize) -> bool {
        self.world.port(self.units[unit].node).mode() == BusErrorMode::ErrorActive
    }

    /// Connects the master, or disconnects it.
    pub(super) fn connect_master(&mut self, connected: bool) {
        if connected {
            self.master.get_or_insert_with(|| self.world.add_client_port("master"));
        } else {
            self.stop_flood();
            if let Some(master) = self.master.take() {
                self.world.remove_client_port(master);
            }
        }
    }

    /// Sends a number of frames of the highest priority from another node.
    pub(super) fn flood(&mut self, count: u16) {
        let flood = *self.flood.get_or_insert_with(|| self.world.add_client_port("flood"));
        // The frames are NMT commands to a missing node.
        let frame = Frame::of(protocol_core::frame::standard(0).into(), &[1, 0xFE]).expect("two bytes");
        (0..count).for_each(|_| self.world.send(flood, frame));
    }

    fn stop_flood(&mut self) {
        if let Some(flood) = self.flood.take() {
            self.world.remove_client_port(flood);
        }
    }

    /// Sets bus and master to the bit rate of a device.
    pub(super) fn follow_bit_rate(&mut self, unit: usize) {
        if let Some(device) = self.world.device(self.units[unit].node) {
            let rate = device.bit_rate();
            if rate != self.world.bit_rate() {
                self.world.set_bit_rate(rate);
            }
        }
    }

    /// Switches on a device that is off.
    pub(super) fn power_on(&mut self, unit: usize) {
        let Unit { node, memory_hurt, .. } = &mut self.units[unit];
        if !self.world.is_powered(*node) {
            let memory = self.world.memory_mut(*node);
            *memory_hurt = memory.write_fails();
            memory.flash_mut().fail_once_after(NEVER_FAILS);
            self.world.power(*node, true);
        }
    }

    pub(super) fn power_off(&mut self, unit: usize) {
        self.world.power(self.units[unit].node, false);
    }

    /// Withdraws the unsent frames of the master.
    pub(super) fn withdraw(&mut self) {
        if let Some(master) = self.master {
            self.world.withdraw(master);
        }
    }

    /// Ends all disturbances and leaves a device alone with the master, at the bit rate of the device.
    pub(super) fn calm(&mut self, unit: usize) {
        self.events_left = u32::MAX;
        self.world.clear_injectors();
        self.world.disturb(Disturbance::default());
        self.connect_master(true);
        self.stop_flood();
        self.withdraw();
        for number in 0..self.units.len() {
            let Unit { node, kind, .. } = self.units[number];
            let healthy = Plant::healthy(kind).words(self.world.now()).collect::<Vec<_>>();
            self.world.set_plants(node, &healthy).expect("words of its own product");
            self.world.force_bus_off(node, number != unit);
            let flash = self.world.memory_mut(node).flash_mut();
            flash.restore_power();
            flash.fail_once_after(NEVER_FAILS);
            self.power_on(number);
        }
        self.follow_bit_rate(unit);
    }
}
