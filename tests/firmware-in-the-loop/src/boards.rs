//! Emulated boards on the bus of a world, in its virtual time.
//!
//! The world goes from event to event, and the boards run up to the next one. If a board changes the state of its
//! controller on the bus before, everything stops there. With one board this is exact to the microsecond of the world.
//! Several boards run in slices shorter than any frame, in which they do not see each other.

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

/// The slice in which several boards do not see each other. It is shorter than the shortest frame at the highest bit
/// rate.
const SLICE: Duration = Duration::from_micros(20);

/// A board of [`Boards`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardId(usize);

/// An event on the bus, from the view of the controller of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noticed {
    /// The controller joined the bus with this number of bits per second, or left it.
    OnBus(Option<u64>),
    /// The wire changed.
    Wire(WireEvent),
    /// The controller begins to send a frame.
    Sends(Frame),
}

/// A world with emulated boards.
pub struct Boards {
    /// The world. Time passes by [`Boards::run_until`] only.
    pub world: World,
    boards: Vec<Board>,
}

struct Board {
    image: &'static Image,
    controller: ControllerId,
    connections: Connections,
    /// The machine, once it was switched on. It stays without power, for the code that the emulator has compiled.
    machine: Option<Machine>,
    powered: bool,
    /// The time of the world, in nanoseconds, at which the machine began. Times without power are left out.
    began: u64,
    /// The state that the world knows: bits per second, and whether the controller is silent.
    on_bus: Option<(u64, bool)>,
    /// The length code of the next frames, instead of their own.
    length_code: Option<u8>,
    /// The start of its frame on the wire.
    sending_since: Instant,
    /// The duration of its last frame.
    last_sent: Option<Duration>,
    /// The events of its controller, if they are recorded.
    noticed: Option<Vec<(Instant, Noticed)>>,
    power_cuts: u64,
    /// The largest number of used bytes of the stack before the last power cut, if the stack is watched.
    stack: Option<u64>,
}

impl Boards {
    /// Creates an empty world at this bit rate.
    #[must_use]
    pub fn new(bit_rate: BitRate) -> Self {
        Self { world: World::new(bit_rate, 0), boards: Vec::new() }
    }

    /// Adds a board with this memory, switched off.
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

    /// Returns all boards.
    pub fn boards(&self) -> impl Iterator<Item = BoardId> + use<> {
        (0..self.boards.len()).map(BoardId)
    }

    /// Switches a board on, or cuts its power, at this time.
    ///
    /// # Panics
    /// Panics if the firmware did something that the part lacks or forbids.
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
            // The machine may have run a few nanoseconds beyond the cut.
            board.began = (now.as_micros() * 1000).saturating_sub(board.at());
        } else if let Some(machine) = &mut board.machine {
            let at = machine.reached().at;
            board.power_cuts += 1;
            board.stack = board.stack.map(|deepest| deepest.max(stack::used(machine)));
            // The cut tears the operation of the flash before the part starts again.
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

    /// Returns the emulated board, while it is powered.
    #[must_use]
    pub fn machine(&self, id: BoardId) -> Option<&Machine> {
        self.boards[id.0].running()
    }

    /// Returns the connections of a board.
    #[must_use]
    pub fn connections(&self, id: BoardId) -> &Connections {
        &self.boards[id.0].connections
    }

    /// Returns the controller of a board on the bus of the world.
    #[must_use]
    pub fn controller(&self, id: BoardId) -> ControllerId {
        self.boards[id.0].controller
    }

    /// Returns the time of the world at a time of a powered board.
    #[must_use]
    pub fn instant(&self, id: BoardId, nanos: Nanos) -> Instant {
        Instant::from_micros((self.boards[id.0].began + nanos) / 1000)
    }

    /// Returns the bit rate of the controller of a board on the bus.
    #[must_use]
    pub fn bits_per_second(&self, id: BoardId) -> Option<u64> {
        self.boards[id.0].on_bus.map(|(rate, _)| rate)
    }

    /// Returns the duration of the last frame of a board on the wire, in whole microseconds.
    #[must_use]
    pub fn last_sent(&self, id: BoardId) -> Option<Duration> {
        self.boards[id.0].last_sent
    }

    /// Sets the length code of the next frames to a board, instead of their own.
    pub fn set_length_code(&mut self, id: BoardId, code: Option<u8>) {
        self.boards[id.0].length_code = code;
    }

    /// Returns the resets of a board, other than power-ups.
    #[must_use]
    pub fn resets(&self, id: BoardId) -> Vec<Reset> {
        self.boards[id.0].machine.as_ref().map(|machine| machine.summary().resets).unwrap_or_default()
    }

    /// Takes the events that the controller of a board has seen since the previous call, oldest first. The first call
    /// begins the record.
    pub fn take_noticed(&mut self, id: BoardId) -> Vec<(Instant, Noticed)> {
        self.boards[id.0].noticed.replace(Vec::new()).unwrap_or_default()
    }

    /// Watches the stack of a board from its next power-up on.
    pub fn watch_stack(&mut self, id: BoardId) {
        self.boards[id.0].stack = Some(0);
    }

    /// Returns the largest number of used bytes of the stack of a board.
    ///
    /// # Panics
    /// Panics if the stack is not watched.
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

    /// Returns the output of the console of a board since the previous call.
    pub fn printed(&mut self, id: BoardId) -> String {
        let printed = std::mem::take(&mut self.boards[id.0].connections.terminal.lock().printed);
        String::from_utf8_lossy(&printed).into_owned()
    }

    /// Advances the time.
    pub fn run_until(&mut self, until: Instant) {
        while self.world.now() < until {
            self.step(until);
        }
    }

    /// Advances the time.
    pub fn run_for(&mut self, time: Duration) {
        self.run_until(after(self.world.now(), time));
    }

    /// Goes to the next event, at most to `until`.
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

    /// Offers the changes of a board up to `reached` to a frame that starts there. Otherwise the bus would send a frame
    /// that its controller has taken back, and the controller would take another one for sent.
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

    /// Runs the boards to `limit`. Returns the time that all of them have reached.
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

    /// Passes the events of the bus to the boards, and the demands of the boards to the bus.
    fn exchange(&mut self) {
        let now = self.world.now();
        for board in &mut self.boards {
            // A board that has run ahead waits for the others.
            if board.powered && board.passed() <= now {
                board.exchange(&mut self.world);
            }
        }
    }
}

/// Reports the errors of a board, as a power cut does.
impl Drop for Boards {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.boards().for_each(|board| self.power(board, false));
        }
    }
}

impl Board {
    /// Returns the first time of the world that the board has not passed.
    fn reached(&self) -> Instant {
        Instant::from_micros((self.began + self.at()).div_ceil(1000))
    }

    /// Returns the last time of the world that the board has reached. A board stops between two instructions, a little
    /// late.
    fn passed(&self) -> Instant {
        Instant::from_micros((self.began + self.at()) / 1000)
    }

    /// Returns the machine, while it is powered.
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

    /// Reports a reset of the part to the bus.
    fn follow_reset(&mut self, world: &mut World) {
        if std::mem::take(&mut self.connections.can.lock().was_reset) {
            world.reset_controller(self.controller);
            self.on_bus = None;
        }
    }

    /// Reports the state of the controller and its next frame to the bus.
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

/// Returns the frame with eight bytes, which a length code above 8 means.
fn full(frame: &Frame) -> Frame {
    if frame.is_remote() { Frame::remote(frame.id(), 8) } else { Frame::full(frame.id(), *frame.bytes()) }
}

/// Returns the bit rate of a bit timing.
///
/// # Panics
/// Panics for a bit rate that a bus of the world does not have.
fn bit_rate(bits_per_second: u64) -> BitRate {
    let bits = u32::try_from(bits_per_second).ok();
    bits.and_then(BitRate::from_bits_per_second)
        .unwrap_or_else(|| panic!("the firmware's bit timing gives {bits_per_second} bit/s, which no bus has"))
}
