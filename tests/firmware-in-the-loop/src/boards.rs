//! Emulated boards on the bus of a world, in its virtual time.
//!
//! The world goes from event to event, and the boards run up to the next one, unless a board changes what the bus sees
//! of its controller before: then everything stops there. With one board this is exact to the microsecond that the
//! world counts in. Several boards run in slices shorter than any frame, within which they do not see each other.

use hal_sim::{ControllerId, WireEvent, World};
use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};

use crate::board::Board as Description;
use crate::bxcan::Message;
use crate::flash::Flash;
use crate::image::Image;
use crate::machine::{Machine, Nanos, Reset};
use crate::part::{Connections, SharedFlash};
use crate::stack;

/// How long several boards run without seeing each other: shorter than the shortest frame at the highest bit rate.
const SLICE: Duration = Duration::from_micros(20);

/// A board of [`Boards`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardId(usize);

/// An event on the bus as a board's controller notices it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noticed {
    /// The controller began to listen at so many bits per second, or left the bus.
    OnBus(Option<u64>),
    /// The wire changed.
    Wire(WireEvent),
    /// A frame of the controller itself begins.
    Sends(Frame),
}

/// A world with emulated boards.
pub struct Boards {
    /// The world; whoever lets time pass does it by [`Boards::run_until`].
    pub world: World,
    boards: Vec<Board>,
}

struct Board {
    image: &'static Image,
    controller: ControllerId,
    connections: Connections,
    /// Once it was switched on; it stays when the power goes, for what the emulator has compiled of the image.
    machine: Option<Machine>,
    powered: bool,
    /// The world's time, in nanoseconds, at which the time of the machine began, if there had been no time without
    /// power.
    began: u64,
    /// What the world was told: at how many bits per second it is on the bus, and whether silent.
    on_bus: Option<(u64, bool)>,
    /// The length code that the next frames come with, in the place of their own.
    length_code: Option<u8>,
    /// When its frame on the wire began.
    sending_since: Instant,
    /// How long its last frame took.
    last_sent: Option<Duration>,
    /// The events of its controller, if they are recorded.
    noticed: Option<Vec<(Instant, Noticed)>>,
    power_cuts: u64,
    /// How many bytes of the stack were used at the most before the last power cut, if that is watched.
    stack: Option<u64>,
}

impl Boards {
    /// An empty world at this bit rate.
    #[must_use]
    pub fn new(bit_rate: BitRate) -> Self {
        Self { world: World::new(bit_rate, 0), boards: Vec::new() }
    }

    /// Adds a board whose memory holds these bytes, switched off.
    pub fn add_board(&mut self, board: &'static Description, name: &str, memory: &[u8]) -> BoardId {
        let controller = self.world.add_controller(name);
        let flash = SharedFlash::new(Flash::of(board.layout, memory));
        let connections = Connections { flash, ..Connections::default() };
        self.boards.push(Board {
            image: Image::of(board),
            controller,
            connections,
            machine: None,
            powered: false,
            began: 0,
            on_bus: None,
            length_code: None,
            sending_since: self.world.now(),
            last_sent: None,
            noticed: None,
            power_cuts: 0,
            stack: None,
        });
        BoardId(self.boards.len() - 1)
    }

    /// All boards.
    pub fn boards(&self) -> impl Iterator<Item = BoardId> + use<> {
        (0..self.boards.len()).map(BoardId)
    }

    /// Switches a board on, or cuts its power at this instant.
    ///
    /// # Panics
    /// When the firmware did something that the part does not have or does not allow.
    pub fn power(&mut self, id: BoardId, on: bool) {
        let now = self.world.now();
        let board = &mut self.boards[id.0];
        if std::mem::replace(&mut board.powered, on) == on {
            return;
        }
        if on {
            match &mut board.machine {
                None => board.machine = Some(Machine::power_on(board.image, board.connections.clone())),
                Some(machine) => machine.give_power(),
            }
            if let (Some(_), Some(machine)) = (board.stack, &board.machine) {
                stack::paint(machine);
            }
            // It may have gone a few nanoseconds beyond the cut.
            board.began = (now.as_micros() * 1000).saturating_sub(board.at());
        } else if let Some(machine) = &mut board.machine {
            let at = machine.reached().at;
            board.power_cuts += 1;
            board.stack = board.stack.map(|deepest| deepest.max(stack::used(machine)));
            // What was under way in the flash is torn by the cut, before the part is made anew.
            board.connections.flash.lock().reset(at, board.power_cuts);
            machine.cut_power();
            let mut complaints = machine.summary().complaints;
            complaints.extend(board.connections.flash.lock().take_complaints());
            complaints.extend(board.connections.can.lock().can.take_complaints());
            *board.connections.terminal.lock() = Default::default();
            board.connections.can.lock().was_reset = false;
            board.on_bus = None;
            self.world.reset_controller(board.controller);
            assert!(complaints.is_empty(), "{}", complaints.join("\n"));
        }
    }

    /// The emulated board itself, while it is powered.
    #[must_use]
    pub fn machine(&self, id: BoardId) -> Option<&Machine> {
        self.boards[id.0].running()
    }

    /// What is connected to a board.
    #[must_use]
    pub fn connections(&self, id: BoardId) -> &Connections {
        &self.boards[id.0].connections
    }

    /// The controller of a board on the world's bus.
    #[must_use]
    pub fn controller(&self, id: BoardId) -> ControllerId {
        self.boards[id.0].controller
    }

    /// The world's time at a time of a board under power.
    #[must_use]
    pub fn instant(&self, id: BoardId, nanos: Nanos) -> Instant {
        Instant::from_micros((self.boards[id.0].began + nanos) / 1000)
    }

    /// At how many bits per second the controller of a board is on the bus.
    #[must_use]
    pub fn bits_per_second(&self, id: BoardId) -> Option<u64> {
        self.boards[id.0].on_bus.map(|(rate, _)| rate)
    }

    /// How long the last frame of a board was on the wire, from its start to its end, to the microsecond.
    #[must_use]
    pub fn last_sent(&self, id: BoardId) -> Option<Duration> {
        self.boards[id.0].last_sent
    }

    /// The frames that come to a board from now on have this length code in the place of their own.
    pub fn set_length_code(&mut self, id: BoardId, code: Option<u8>) {
        self.boards[id.0].length_code = code;
    }

    /// The resets of a board but for those that came with the power.
    #[must_use]
    pub fn resets(&self, id: BoardId) -> Vec<Reset> {
        self.boards[id.0].machine.as_ref().map(|machine| machine.summary().resets).unwrap_or_default()
    }

    /// Takes the events that the controller of a board has noticed since the last call, oldest first. The first call
    /// begins the record.
    pub fn take_noticed(&mut self, id: BoardId) -> Vec<(Instant, Noticed)> {
        self.boards[id.0].noticed.replace(Vec::new()).unwrap_or_default()
    }

    /// From the next power-up on, it is watched how much of its stack a board uses.
    pub fn watch_stack(&mut self, id: BoardId) {
        self.boards[id.0].stack = Some(0);
    }

    /// How many bytes of its stack a board has used at the most.
    ///
    /// # Panics
    /// When that is not watched.
    #[must_use]
    pub fn stack(&self, id: BoardId) -> u64 {
        let board = &self.boards[id.0];
        let before = board.stack.expect("it is watched");
        board.running().map_or(before, |machine| before.max(stack::used(machine)))
    }

    /// Types a line at the console of a board.
    pub fn type_line(&mut self, id: BoardId, line: &str) {
        let mut terminal = self.boards[id.0].connections.terminal.lock();
        terminal.typed.extend(line.bytes().chain([b'\n']));
    }

    /// What the console of a board has printed since this was last asked.
    pub fn printed(&mut self, id: BoardId) -> String {
        let printed = std::mem::take(&mut self.boards[id.0].connections.terminal.lock().printed);
        String::from_utf8_lossy(&printed).into_owned()
    }

    /// Lets time pass.
    pub fn run_until(&mut self, until: Instant) {
        while self.world.now() < until {
            self.step(until);
        }
    }

    /// Lets time pass.
    pub fn run_for(&mut self, time: Duration) {
        self.run_until(after(self.world.now(), time));
    }

    /// Goes to the next instant at which something happens, at the latest to `until`.
    pub fn step(&mut self, until: Instant) {
        self.exchange();
        let now = self.world.now();
        let several = self.boards.iter().filter(|board| board.powered).count() > 1;
        let limit = if several { until.min(after(now, SLICE)) } else { until };
        let limit = self.world.next_event().clamp(now, limit.max(now));
        let reached = self.run_boards(limit);
        self.offer_anew(reached);
        self.world.run_until(reached);
        self.exchange();
    }

    /// What a board has changed by `reached` counts for a frame that starts there: told later, the bus would send a
    /// frame that its controller has taken back, and the controller would think of another one that it was sent.
    fn offer_anew(&mut self, reached: Instant) {
        let before = Instant::from_ticks(reached.as_ticks().saturating_sub(1));
        for board in &mut self.boards {
            let changed = board.powered && board.reached() <= reached && board.connections.can.lock().changed;
            if changed {
                self.world.run_until(before.max(self.world.now()));
                board.offer(&mut self.world);
            }
        }
    }

    /// Runs the boards to `limit`; returns the instant that all of them have reached.
    fn run_boards(&mut self, limit: Instant) -> Instant {
        let running = |board: &mut &mut Board| board.powered && board.reached() < limit;
        let mut started: Vec<&mut Board> =
            self.boards.iter_mut().filter_map(|mut board| running(&mut board).then_some(board)).collect();
        for board in &mut started {
            let until = limit.as_micros() * 1000 - board.began;
            if let Some(machine) = &board.machine {
                machine.start(until);
            }
        }
        for board in &mut started {
            if let Some(machine) = &mut board.machine {
                machine.wait();
            }
        }
        let reached = self.boards.iter().filter(|board| board.powered).map(Board::reached);
        reached.min().unwrap_or(limit).min(limit)
    }

    /// Tells the boards what happened on the bus, and the bus what the boards want.
    fn exchange(&mut self) {
        let now = self.world.now();
        for board in &mut self.boards {
            // One that has run ahead is looked at when the others have caught up.
            if board.powered && board.passed() <= now {
                board.exchange(&mut self.world);
            }
        }
    }
}

/// What a board has done wrong is told at a power cut: that at the end is the last one.
impl Drop for Boards {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.boards().for_each(|board| self.power(board, false));
        }
    }
}

impl Board {
    /// The first instant of the world's time that it has not passed.
    fn reached(&self) -> Instant {
        Instant::from_micros((self.began + self.at()).div_ceil(1000))
    }

    /// The last instant of the world's time that it has come to. It stops between two instructions, a little late.
    fn passed(&self) -> Instant {
        Instant::from_micros((self.began + self.at()) / 1000)
    }

    /// The machine, while it is powered.
    fn running(&self) -> Option<&Machine> {
        self.machine.as_ref().filter(|_| self.powered)
    }

    fn at(&self) -> u64 {
        self.machine.as_ref().map_or(0, |machine| machine.reached().at)
    }

    fn exchange(&mut self, world: &mut World) {
        self.follow_reset(world);
        let mut shared = self.connections.can.lock();
        for (at, event) in world.take_wire_events(self.controller).into_iter().flatten() {
            match event {
                WireEvent::Begins { own: true } => self.sending_since = at,
                WireEvent::Sent => self.last_sent = Some(since(at, self.sending_since)),
                _ => {}
            }
            if let Some(noticed) = &mut self.noticed {
                let own = if event == (WireEvent::Begins { own: true }) { shared.can.offer() } else { None };
                noticed.push((at, own.map_or(Noticed::Wire(event), |message| Noticed::Sends(message.frame))));
            }
            match (event, self.length_code) {
                (WireEvent::Received(frame), Some(dlc)) => shared.can.receive(Message { frame: full(&frame), dlc }),
                _ => shared.can.hear(event),
            }
        }
        drop(shared);
        self.offer(world);
    }

    /// Tells the bus of a reset of the part.
    fn follow_reset(&mut self, world: &mut World) {
        if std::mem::take(&mut self.connections.can.lock().was_reset) {
            world.reset_controller(self.controller);
            self.on_bus = None;
        }
    }

    /// Tells the bus what the controller is to it and would send next.
    fn offer(&mut self, world: &mut World) {
        self.follow_reset(world);
        let mut shared = self.connections.can.lock();
        shared.changed = false;
        let on_bus = shared.on_bus();
        if on_bus != self.on_bus {
            self.on_bus = on_bus;
            if let Some(noticed) = &mut self.noticed {
                noticed.push((world.now(), Noticed::OnBus(on_bus.map(|(rate, _)| rate))));
            }
            match on_bus {
                Some((rate, silent)) => world.attach(self.controller, bit_rate(rate), silent),
                None => world.detach(self.controller),
            }
        }
        world.offer(self.controller, shared.can.offer().map(|message| message.frame));
        if shared.can.is_recovering() {
            world.start_recovery(self.controller);
        }
    }
}

/// The frame with eight bytes, as a length code above 8 means.
fn full(frame: &Frame) -> Frame {
    if frame.is_remote() { Frame::remote(frame.id(), 8) } else { Frame::full(frame.id(), *frame.bytes()) }
}

/// The bit rate of a bit timing.
///
/// # Panics
/// When it is none of those that a bus of the world can have.
fn bit_rate(bits_per_second: u64) -> BitRate {
    let bits = u32::try_from(bits_per_second).ok();
    bits.and_then(BitRate::from_bits_per_second)
        .unwrap_or_else(|| panic!("the firmware's bit timing gives {bits_per_second} bit/s, which no bus has"))
}
