//! The host device in the place of the image: the same core behind mailboxes of its own, on the image's bus.
//!
//! It gets the frames on the wire, and the time. Of the image it learns only what no bus shows: the instants at which the
//! device was started or restarted, the memory answered, and a typed line took effect. Every frame of the image has to
//! be the one that the host would send then.

use std::collections::{BTreeMap, VecDeque};

use firmware_in_the_loop::boards::Noticed;
use firmware_in_the_loop::rig::Device;
use hal_sim::bus::INTERMISSION;
use hal_sim::world::SimDevice;
use hal_sim::{Memory, WireEvent, memory};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::plant::{Change, Plant};
use protocol_core::device::{AnyDevice, Effect, Restart, Setup, StartCause};
use protocol_core::frame::Frame;
use protocol_core::memory::{Record, RecordKey, StoreError};
use protocol_core::pump::pump;
use protocol_core::time::Instant;

use super::mailboxes::Mailboxes;
use super::recorder::{Call, Event, Run};

/// The longest time by which the image may act later than the host, in microseconds: two of the dearest frames of
/// [`budgets`] one after the other, 1530 instructions each, and the interrupts of clock, memory and console between.
///
/// [`budgets`]: super::super::budgets
pub const REACTION: u64 = 40;
/// The longest time in which the image completes a record with its CRC, and acts on nothing else, in microseconds.
const RECORD: u64 = 100;
/// The longest time in which the memory stores a record: 4 erases.
const STORE: u64 = 3_000_000;
/// The longest time in which the memory is read.
const READ: u64 = 100_000;
/// The longest time that a typed line takes.
const LINE: u64 = 100_000;
/// The longest time in which the image leaves the bus, at the end of a frame, and joins it at another bit rate.
const REJOIN: u64 = 50_000;
/// The bits for which an error-passive sender waits after its own frame (ISO 11898-1).
const SUSPEND: u32 = 8;

/// A reason for which the device acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trigger {
    /// An event of the run, by its number.
    Event(usize),
    /// A deadline of the device, by its instant.
    Timer(u64),
}

/// The time from a trigger to what the image does, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delay {
    /// Until the platform reads the clock.
    pub clock: u64,
    /// Until the frames of the device are in the mailboxes.
    pub act: u64,
}

impl Trigger {
    /// Returns the delay of the image as a rule.
    pub const fn usual(self) -> Delay {
        match self {
            Self::Event(_) => Delay { clock: 5, act: 8 },
            Self::Timer(_) => Delay { clock: 1, act: 4 },
        }
    }
}

/// The delays that are not as [usual](Trigger::usual).
pub type Delays = BTreeMap<Trigger, Delay>;

/// A difference between image and host.
#[derive(Clone, Debug)]
pub struct Difference {
    /// The number of the event at which it was found.
    pub event: usize,
    /// The instant of that event.
    pub at: u64,
    /// The difference, in words.
    pub what: String,
    /// The triggers before it, and those that were about to come, the last one last.
    pub triggers: Vec<Trigger>,
}

/// A record on its way into the memory.
struct Write {
    key: RecordKey,
    record: Record,
    since: u64,
    fails: bool,
}

/// The host device, and its platform.
pub struct Host<'a> {
    setup: &'a Device,
    run: &'a Run,
    delays: &'a Delays,
    device: Option<Box<dyn SimDevice>>,
    /// The device has no inputs yet.
    starting: bool,
    can: Mailboxes,
    memory: Memory,
    plant: Plant,
    /// The error mode of the image's controller.
    mode: BusErrorMode,
    /// The lines that have not taken effect, each with its instant.
    typed: VecDeque<(u64, Change)>,
    /// The shaft turns, or has turned since the power came.
    turned: bool,
    write: Option<Write>,
    /// A restart that waits for the memory, and since when.
    restart: Option<(Restart, u64)>,
    /// Frames that wait for the device.
    received: Vec<Frame>,
    /// The passes of the pump to come: each by this clock, with its frames in the mailboxes at the second instant.
    passes: VecDeque<(u64, u64, Trigger)>,
    triggers: Vec<Trigger>,
    /// The number of the present event.
    event: usize,
    /// The clock of the last pass.
    clock: u64,
    /// The instant until which the image may complete a record.
    busy: u64,
    bits_per_second: u64,
    /// The instant since which the bus is free; `None` while it is not.
    free: Option<u64>,
    /// The instant since which the image takes part in the bus.
    joined: u64,
    /// The instant since which the image is to join the bus anew. It waits for nothing else then.
    leaving: Option<u64>,
    lost_arbitration: bool,
    compared: u64,
}

impl<'a> Host<'a> {
    /// Returns a host without power, at the beginning of a run of the image.
    pub fn new(setup: &'a Device, run: &'a Run, delays: &'a Delays) -> Self {
        Self {
            setup,
            run,
            delays,
            device: None,
            starting: false,
            can: Mailboxes::default(),
            memory: memory_of(&run.found),
            plant: Plant::healthy(setup.kind),
            mode: BusErrorMode::ErrorActive,
            typed: VecDeque::new(),
            turned: false,
            write: None,
            restart: None,
            received: Vec::new(),
            passes: VecDeque::new(),
            triggers: Vec::new(),
            event: 0,
            clock: 0,
            busy: 0,
            bits_per_second: 0,
            free: None,
            joined: 0,
            leaving: None,
            lost_arbitration: false,
            compared: 0,
        }
    }

    /// Goes through the run; returns the number of frames that were compared.
    pub fn play(mut self) -> Result<u64, Difference> {
        for (number, (at, event)) in self.run.events.iter().enumerate() {
            self.event = number;
            self.run_until(*at)?;
            self.take(*at, event)?;
        }
        self.event = self.run.events.len();
        self.run_until(self.run.end)?;
        if self.write.is_none() && self.device.is_some() {
            let (host, image) = (self.memory.peek_image(), memory_of(&self.run.left).peek_image());
            if host != image {
                return self.differ(self.run.end, format!("stored is {image:?}, by the host {host:?}"));
            }
        }
        Ok(self.compared)
    }

    fn take(&mut self, at: u64, event: &Event) -> Result<(), Difference> {
        match *event {
            Event::Typed(change) => self.typed.push_back((at, change)),
            Event::Mode(mode) => self.mode = mode,
            Event::Called(call) => self.called(at, call)?,
            Event::Noticed(Noticed::OnBus(rate)) => {
                self.free = None;
                self.bits_per_second = rate.unwrap_or(0);
                if rate.is_some() && self.leaving.take().is_some() {
                    self.trigger(at);
                }
            }
            Event::Noticed(Noticed::Sends(frame)) => {
                (self.lost_arbitration, self.free) = (false, None);
                self.sends(at, frame)?;
            }
            Event::Noticed(Noticed::Wire(event)) => self.notice(at, event)?,
        }
        Ok(())
    }

    fn sends(&mut self, at: u64, frame: Frame) -> Result<(), Difference> {
        if !self.can.begin(&frame, at) {
            let host = self.can.head().map_or("nothing".to_owned(), Frame::to_string);
            return self.differ(at, format!("the image sends {frame}, the host {host}"));
        }
        let rate = self.device.as_ref().map_or(0, |device| device.bit_rate().bits_per_second().into());
        if rate != self.bits_per_second {
            return self.differ(at, format!("the image sends at {} bit/s, the host at {rate}", self.bits_per_second));
        }
        self.compared += 1;
        Ok(())
    }

    fn notice(&mut self, at: u64, event: WireEvent) -> Result<(), Difference> {
        match event {
            WireEvent::Joined => (self.joined, self.free) = (at, Some(at)),
            WireEvent::LostArbitration => self.lost_arbitration = true,
            WireEvent::Begins { .. } => {
                let is_allowed = self.free.take().is_none_or(|free| free <= at);
                let is_late = self.can.since().is_some_and(|since| since.max(self.joined) + REACTION < at);
                if !std::mem::take(&mut self.lost_arbitration) && is_allowed && is_late {
                    return self.miss(at);
                }
            }
            WireEvent::Received(frame) => {
                self.received.push(frame);
                self.trigger(at);
            }
            WireEvent::Sent => {
                self.can.end(true);
                self.trigger(at);
            }
            WireEvent::NotSent(_) => self.can.end(false),
            WireEvent::Ends => {
                let suspended = if self.mode == BusErrorMode::ErrorPassive { SUSPEND } else { 0 };
                self.free = Some(at + self.bits(INTERMISSION + suspended));
            }
            WireEvent::NotReceived { .. } | WireEvent::Recovered => {}
        }
        Ok(())
    }

    /// Returns the time of so many bits, in microseconds.
    fn bits(&self, bits: u32) -> u64 {
        (u64::from(bits) * 1_000_000).div_ceil(self.bits_per_second.max(1))
    }

    /// Has the device act on the present event.
    fn trigger(&mut self, at: u64) {
        let trigger = Trigger::Event(self.event);
        let delay = self.delay(trigger);
        let last = self.passes.back().map_or(0, |(_, done, _)| *done);
        self.passes.push_back((at + delay.clock, last.max(at + delay.act), trigger));
    }

    fn delay(&self, trigger: Trigger) -> Delay {
        self.delays.get(&trigger).copied().unwrap_or(trigger.usual())
    }

    /// Does what the platform of the image has done.
    fn called(&mut self, at: u64, call: Call) -> Result<(), Difference> {
        let trigger = Trigger::Event(self.event);
        // The platform has read the clock before it called.
        let before = self.delays.get(&trigger).map_or(0, |delay| delay.clock);
        let clock = at.saturating_sub(before).max(self.clock);
        let now = Instant::from_micros(clock);
        match (call, &mut self.device) {
            (Call::Start, _) => {
                let Device { kind, node_id, serial } = *self.setup;
                let setup = Setup { node_id: Some(node_id), serial, ..Setup::from(kind) };
                let image = self.memory.read_image();
                self.device = Some(AnyDevice::power_on(setup, &image, StartCause::PowerOn, now).into());
                (self.starting, self.leaving) = (true, Some(at));
                return Ok(());
            }
            (Call::Sense, Some(device)) => {
                if std::mem::take(&mut self.starting) {
                    // The senses that end the start.
                } else if self.plant.inputs.bus != self.mode {
                    self.plant.inputs.bus = self.mode;
                } else if let Some((_, change)) = self.typed.pop_front() {
                    let _ = self.plant.change(change, now);
                    self.turned |= matches!(change, Change::SpeedRpm(_));
                } else {
                    return self.differ(at, "the image senses a change, the host none".to_owned());
                }
                device.sense(&self.plant.inputs, now);
            }
            (Call::Stored, Some(device)) => {
                let Some(Write { key, record, fails, .. }) = self.write.take() else {
                    return self.differ(at, "the image has stored a record, the host has not".to_owned());
                };
                let result = if fails { Err(StoreError) } else { self.memory.store(key, &record) };
                device.stored(key, result, now);
            }
            (Call::Restart, Some(device)) => {
                let Some((scope, _)) = self.restart.take() else {
                    return self.differ(at, "the image restarts, the host does not".to_owned());
                };
                device.restart(scope, &self.memory.read_image(), now);
                self.can.clear();
                self.leaving = Some(at);
                return Ok(());
            }
            (_, None) => return self.differ(at, "the image has not started its device".to_owned()),
        }
        self.passes.push_back((clock, at + self.delay(trigger).act, trigger));
        Ok(())
    }

    /// Has the device act on everything that is due, and looks whether the image has done what the host asked for.
    fn run_until(&mut self, until: u64) -> Result<(), Difference> {
        loop {
            let next = self.passes.front().copied();
            let timer = self.device.as_ref().filter(|_| self.is_served()).map(|device| {
                let due = device.deadline().as_micros();
                let delay = self.delay(Trigger::Timer(due));
                let clock = due.saturating_add(delay.clock).max(self.clock + 1);
                (clock, due.saturating_add(delay.act).max(clock), Trigger::Timer(due))
            });
            let is_first = |(_, done, _): &(u64, u64, Trigger)| timer.is_none_or(|(_, rings, _)| *done <= rings);
            let (clock, done, trigger) = match next.filter(is_first).or(timer) {
                Some(pass) if pass.1 <= until => pass,
                _ => break,
            };
            self.passes.pop_front_if(|pass| pass.2 == trigger);
            self.triggers.push(trigger);
            self.pump(clock, done);
        }
        self.check_patience(until)
    }

    /// Returns whether the image pumps its device.
    const fn is_served(&self) -> bool {
        self.restart.is_none() && self.leaving.is_none() && !self.starting
    }

    /// Pumps the device at an instant of its clock; its frames are in the mailboxes at `done`.
    fn pump(&mut self, clock: u64, done: u64) {
        self.clock = clock.max(self.clock);
        let now = Instant::from_micros(self.clock);
        while self.is_served()
            && let Some(device) = &mut self.device
        {
            self.can.set(done.max(self.busy), device.view(now).position, self.turned);
            self.received.drain(..).for_each(|frame| _ = device.handle(&frame, now));
            match pump(&mut **device, &mut self.can, now) {
                None => break,
                Some(Effect::Store(key, record)) => {
                    self.busy = done + RECORD;
                    self.write = Some(Write { key, record, since: done, fails: self.plant.memory_fails });
                }
                Some(Effect::SetBitRate(_)) => {
                    self.can.clear();
                    self.leaving = Some(done);
                }
                Some(Effect::Restart(scope)) => self.restart = Some((scope, done)),
            }
        }
    }

    /// Returns the first thing that the host has asked for too long ago.
    fn check_patience(&self, now: u64) -> Result<(), Difference> {
        let is_over = |since: Option<u64>, most: u64| since.is_some_and(|since| since + most < now);
        let sendable = self.free.and_then(|free| Some(free.max(self.can.since()?)));
        if is_over(sendable, REACTION) {
            return self.miss(now);
        }
        let waits = [
            (self.write.as_ref().map(|write| write.since), STORE, "the host stores a record, the image does not"),
            (self.restart.map(|(_, since)| since), READ, "the host restarts, the image does not"),
            (self.leaving, REJOIN, "the image has not joined the bus anew"),
            (self.typed.front().map(|(since, _)| *since), LINE, "the image does not take a line"),
        ];
        let overdue = waits.into_iter().find(|(since, most, _)| is_over(*since, *most));
        overdue.map_or(Ok(()), |(_, _, what)| self.differ(now, what.to_owned()))
    }

    /// Returns that the image does not send a frame that it should have sent.
    fn miss(&self, now: u64) -> Result<(), Difference> {
        let head = self.can.head().map_or("nothing".to_owned(), Frame::to_string);
        let since = self.can.since().unwrap_or(now);
        self.differ(now, format!("the host sends {head} at {since} us, the image does not"))
    }

    fn differ<T>(&self, at: u64, what: String) -> Result<T, Difference> {
        let due = self.device.as_ref().map(|device| Trigger::Timer(device.deadline().as_micros()));
        let to_come = self.passes.iter().map(|(_, _, trigger)| *trigger);
        let triggers = self.triggers.iter().copied().chain(to_come).chain(due).collect();
        Err(Difference { event: self.event, at, what, triggers })
    }
}

fn memory_of(flash: &[u8]) -> Memory {
    Memory::with_flash(memory::Flash::from_image(flash.to_vec()).expect("it is as long as a flash"))
}
