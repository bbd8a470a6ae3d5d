//! Plays steps on the emulated board, and records what happened to its image.

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::boards::Noticed;
use firmware_in_the_loop::rig::ImageRig;
use hal_sim::world::Change;
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::time::{Duration, Instant, after, since};

use super::traffic::Step;

/// The longest time from power-up to the bus.
const BOOT: Duration = Duration::from_millis(100);
/// The time without power between two runs.
const POWER_OFF: Duration = Duration::from_millis(20);
/// The longest time that the bus gets for the last frames of the master; the rest is withdrawn.
const LAST_FRAMES: Duration = Duration::from_millis(300);
/// The time for the last answers.
const LAST_ANSWERS: Duration = Duration::from_millis(40);

/// A call of the device by the image's platform that no bus shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Call {
    /// The board makes its device: it has read the clock for the start.
    Start,
    /// `Device::sense`: the first one ends the start, each further one follows a typed line or an error mode.
    Sense,
    /// `Device::stored`
    Stored,
    /// `Device::restart`
    Restart,
}

/// The functions of the image whose calls are recorded, and how many of each there are: of a method, that of the valve
/// on CANopen, on ISOBUS, and of the sensor.
const CALLS: [(&str, usize, Call); 4] = [
    ("firmware::board::device::new_device", 1, Call::Start),
    ("as protocol_core::device::Device>::sense", 3, Call::Sense),
    ("as protocol_core::device::Device>::stored", 3, Call::Stored),
    ("as protocol_core::device::Device>::restart", 3, Call::Restart),
];

/// An event in the life of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// Its controller noticed something.
    Noticed(Noticed),
    /// Its controller has this error mode now.
    Mode(BusErrorMode),
    /// A line was typed.
    Typed(Change),
    /// Its platform has called the device.
    Called(Call),
}

/// The time from power-up to power cut.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// The content of the flash at power-up.
    pub found: Vec<u8>,
    /// The events, each with the microseconds since power-up.
    pub events: Vec<(u64, Event)>,
    /// The microseconds to the power cut.
    pub end: u64,
    /// The content of the flash after the power cut.
    pub left: Vec<u8>,
}

/// The emulated board and its master.
pub struct Recorder {
    rig: ImageRig,
    content: Vec<u8>,
    bit_rate: BitRate,
    /// The addresses of the functions of [`CALLS`].
    calls: Vec<(u64, Call)>,
    powered_on: Instant,
    mode: BusErrorMode,
    run: Run,
}

impl Recorder {
    /// Returns a board without power, with this content of its memory, which makes it start at this bit rate.
    pub fn new(content: &[u8], bit_rate: BitRate) -> Self {
        let mut rig = ImageRig::with_memory(&NUCLEO_F429ZI, bit_rate, content);
        // Acknowledges the frames of the master while the board is off the bus.
        rig.boards.world.add_gateway("listener");
        let (powered_on, mode) = (rig.boards.world.now(), BusErrorMode::ErrorActive);
        Self { rig, content: content.to_vec(), bit_rate, calls: Vec::new(), powered_on, mode, run: Run::default() }
    }

    /// Plays steps on the board, whose memory is as at first; returns its runs.
    pub fn play(&mut self, steps: &[Step]) -> Vec<Run> {
        let (board, master) = (self.rig.board, self.rig.master);
        self.rig.boards.connections(board).flash.lock().restore(&self.content);
        self.rig.boards.world.set_bit_rate(self.bit_rate);
        let mut runs = Vec::new();
        self.power_on();
        for step in steps {
            match step {
                Step::Send(frame) => self.rig.boards.world.send(master, *frame),
                Step::Pass(micros) => self.pass(Duration::from_micros(*micros)),
                Step::Type(plant) => {
                    let at = self.micros(self.rig.boards.world.now());
                    self.run.events.push((at, Event::Typed(*plant)));
                    self.rig.boards.type_line(board, &plant.to_string());
                }
                Step::PowerCycle => {
                    self.rig.boards.world.withdraw(master);
                    runs.push(self.power_off());
                    self.power_on();
                }
            }
        }
        let patience = after(self.rig.boards.world.now(), LAST_FRAMES);
        while self.rig.boards.world.pending(master) > 0 && self.rig.boards.world.now() < patience {
            self.pass(Duration::from_millis(1));
        }
        self.rig.boards.world.withdraw(master);
        self.pass(LAST_ANSWERS);
        runs.push(self.power_off());
        assert_eq!(self.rig.boards.resets(board), [], "the image was reset");
        runs
    }

    fn power_on(&mut self) {
        let board = self.rig.board;
        self.run = Run { found: self.flash(), ..Run::default() };
        self.powered_on = self.rig.boards.world.now();
        self.mode = BusErrorMode::ErrorActive;
        self.rig.boards.take_noticed(board);
        self.rig.boards.power(board, true);
        let machine = self.rig.boards.machine(board).expect("it is powered");
        if self.calls.is_empty() {
            for (name, count, call) in CALLS {
                let found = machine.image().symbols().functions(&[name]);
                assert_eq!(found.len(), count, "functions of the name {name}");
                self.calls.extend(found.iter().map(|symbol| (symbol.address, call)));
            }
            self.calls.iter().for_each(|(address, _)| machine.watch(*address));
        }
        // Those of the run before are recorded.
        let _ = machine.arrivals();
        let patience = after(self.powered_on, BOOT);
        while self.rig.boards.bits_per_second(board).is_none() && self.rig.boards.world.now() < patience {
            self.step(patience);
        }
    }

    fn power_off(&mut self) -> Run {
        let board = self.rig.board;
        let mut run = std::mem::take(&mut self.run);
        let noticed = self.rig.boards.take_noticed(board);
        run.events.extend(noticed.into_iter().map(|(at, noticed)| (self.micros(at), Event::Noticed(noticed))));
        for arrival in self.rig.boards.machine(board).map(|machine| machine.arrivals()).unwrap_or_default() {
            let call = self.calls.iter().find(|(address, _)| *address == arrival.address);
            let (_, call) = call.expect("no other function is watched");
            run.events.push((self.micros(self.rig.boards.instant(board, arrival.at)), Event::Called(*call)));
        }
        run.events.sort_by_key(|(at, _)| *at);
        run.end = self.micros(self.rig.boards.world.now());
        self.rig.boards.power(board, false);
        run.left = self.flash();
        self.pass(POWER_OFF);
        run
    }

    fn flash(&self) -> Vec<u8> {
        let flash = self.rig.boards.connections(self.rig.board).flash.lock();
        flash.content(self.content.len()).to_vec()
    }

    /// Returns the microseconds since power-up.
    fn micros(&self, instant: Instant) -> u64 {
        since(instant, self.powered_on).as_micros()
    }

    fn pass(&mut self, time: Duration) {
        let end = after(self.rig.boards.world.now(), time);
        while self.rig.boards.world.now() < end {
            self.step(end);
        }
    }

    /// Goes to the next instant at which something happens. The master follows the bit rate of the board at once, before
    /// the board has joined the bus.
    fn step(&mut self, limit: Instant) {
        let boards = &mut self.rig.boards;
        boards.step(limit);
        let rate = boards.bits_per_second(self.rig.board).and_then(|rate| u32::try_from(rate).ok());
        if let Some(rate) = rate.and_then(BitRate::from_bits_per_second).filter(|rate| *rate != boards.world.bit_rate())
        {
            boards.world.set_bit_rate(rate);
        }
        boards.world.take_received(self.rig.master);
        let mode = boards.world.controller_port(boards.controller(self.rig.board)).mode();
        if std::mem::replace(&mut self.mode, mode) != mode {
            let at = since(boards.world.now(), self.powered_on).as_micros();
            self.run.events.push((at, Event::Mode(mode)));
        }
    }
}
