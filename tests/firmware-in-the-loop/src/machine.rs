//! An emulated board under power. The emulator runs on a thread of its own, up to a given time.
//!
//! Only one of the two threads runs at a time. The emulator stops at the given time, or after an access by which the
//! firmware changes the state of its CAN controller on the bus.

use std::num::{NonZeroU32, NonZeroU64};
use std::ops::Range;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use rigless::cpu::armv7m::windows;
use rigless::device::ResetCause;
use rigless::emulator::{self, Driver, Hit, Host, Settled, Start, Stop, StopReason, Watch};
use rigless::machine::{Board, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::session::Session;
use rigless::snapshot::Store;
use rigless::soc::{RegionKind, Width};
use rigless::time::VirtualNanos;

use crate::board::Board as Description;
use crate::image::Image;
use crate::part::{Can1, Connections, Part, Port, SharedFlash};
use crate::warm::{self, CoreView};

/// The clock of the processor.
const CORE_HZ: u64 = 160_000_000;
/// The number of instructions in a second: one and a half cycles each, with the flash accelerator on (A).
const INSTRUCTIONS_PER_SECOND: u64 = CORE_HZ * 2 / 3;
/// The addresses of CAN1.
const CAN1: Range<u64> = 0x4000_6400..0x4000_6800;

/// A time under power, in nanoseconds since the first power-up.
pub type Nanos = u64;

/// The state at which the emulator has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reached {
    /// The time of the stop.
    pub at: Nanos,
    /// The number of executed instructions until then.
    pub instructions: u64,
    /// The number of instructions when the processor was first asleep since the previous stop.
    pub asleep: Option<u64>,
    /// The number of resets.
    pub resets: usize,
}

/// A reset of the part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reset {
    /// The time of the reset.
    pub at: Nanos,
    /// The cause, in the words of the emulator.
    pub cause: String,
}

/// An arrival of the processor at a [watched](Machine::watch) function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// The address of the function.
    pub address: u64,
    /// The time of the arrival.
    pub at: Nanos,
    /// The number of executed instructions until then.
    pub instructions: u64,
}

/// The results of a run.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// All resets.
    pub resets: Vec<Reset>,
    /// The complaints: actions of the firmware that the part lacks or forbids.
    pub complaints: Vec<String>,
}

/// An emulated board under power.
pub struct Machine {
    image: &'static Image,
    orders: Sender<Order>,
    answers: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
    reached: Reached,
}

enum Order {
    RunUntil(Nanos),
    Read(Range<u64>),
    Write(u64, Vec<u8>),
    Drive(Port, u8, bool),
    IsHigh(Port, u8),
    /// A register of a peripheral.
    Register(u64),
    Supply(u32),
    Watch(u64),
    Hits,
    Power(bool),
    /// The RAM loses its content, because it has no supply.
    Forget,
    Sum,
    End,
}

enum Answer {
    Reached(Reached),
    Bytes(Vec<u8>),
    Level(bool),
    Register(u32),
    Summary(Summary),
    Hits(Vec<Arrival>),
    Done,
}

impl Machine {
    /// Creates a board that is switched on, before its first instruction.
    ///
    /// # Panics
    /// Panics if the image cannot be loaded into the part.
    #[must_use]
    pub fn power_on(image: &'static Image, connections: Connections) -> Self {
        let (orders, received) = channel();
        let (answer, answers) = channel();
        let thread = std::thread::spawn(move || run(image, connections, received, answer));
        let mut machine = Self {
            image,
            orders,
            answers,
            thread: Some(thread),
            reached: Reached { at: 0, instructions: 0, asleep: None, resets: 0 },
        };
        machine.reached = machine.wait_for_stop();
        machine.ask(Order::Forget);
        machine
    }

    /// Returns the image.
    #[must_use]
    pub const fn image(&self) -> &'static Image {
        self.image
    }

    /// Returns the state at the last stop.
    #[must_use]
    pub const fn reached(&self) -> Reached {
        self.reached
    }

    /// Starts a run up to a time. [`wait`](Self::wait) must follow.
    pub fn start(&self, until: Nanos) {
        self.order(Order::RunUntil(until));
    }

    /// Waits until the run has stopped.
    pub fn wait(&mut self) -> Reached {
        self.reached = self.wait_for_stop();
        self.reached
    }

    /// Reads memory as the processor does, but not the memory behind the flash interface.
    #[must_use]
    pub fn read(&self, range: Range<u64>) -> Vec<u8> {
        match self.ask(Order::Read(range)) {
            Answer::Bytes(bytes) => bytes,
            _ => unreachable!("a read is answered by bytes"),
        }
    }

    /// Writes RAM, or breaks the image.
    pub fn write(&self, address: u64, bytes: &[u8]) {
        self.ask(Order::Write(address, bytes.to_vec()));
    }

    /// Drives a pin from outside.
    pub fn drive(&self, port: Port, pin: u8, high: bool) {
        self.ask(Order::Drive(port, pin, high));
    }

    /// Returns whether the firmware drives a pin high.
    #[must_use]
    pub fn is_high(&self, port: Port, pin: u8) -> bool {
        matches!(self.ask(Order::IsHigh(port, pin)), Answer::Level(true))
    }

    /// Reads a register of a peripheral as a debugger does, without an effect.
    ///
    /// # Panics
    /// Panics for an unknown register.
    #[must_use]
    pub fn register(&self, address: u64) -> u32 {
        match self.ask(Order::Register(address)) {
            Answer::Register(value) => value,
            _ => unreachable!("a register is answered by its value"),
        }
    }

    /// Sets the supply voltage of the part.
    pub fn supply(&self, millivolts: u32) {
        self.ask(Order::Supply(millivolts));
    }

    /// Watches the function at an address from now on.
    pub fn watch(&self, address: u64) {
        self.ask(Order::Watch(address));
    }

    /// Returns the arrivals at [watched](Self::watch) functions since the previous call.
    #[must_use]
    pub fn arrivals(&self) -> Vec<Arrival> {
        match self.ask(Order::Hits) {
            Answer::Hits(hits) => hits,
            _ => unreachable!("hits are answered by hits"),
        }
    }

    /// Cuts the power. The RAM loses its content.
    pub fn cut_power(&mut self) -> Reached {
        self.ask(Order::Power(false));
        self.ask(Order::Forget);
        self.start(self.reached.at + 1);
        self.wait()
    }

    /// Gives the power back. The board is before its first instruction.
    pub fn give_power(&self) {
        self.ask(Order::Power(true));
    }

    /// Returns the results of all runs so far.
    #[must_use]
    pub fn summary(&self) -> Summary {
        match self.ask(Order::Sum) {
            Answer::Summary(summary) => summary,
            _ => unreachable!("a sum is answered by one"),
        }
    }

    fn order(&self, order: Order) {
        // If the emulator is gone, the waiting thread reports the cause.
        let _ = self.orders.send(order);
    }

    fn ask(&self, order: Order) -> Answer {
        self.order(order);
        self.answers.recv().expect("the emulator has ended by itself: see its thread's message")
    }

    fn wait_for_stop(&mut self) -> Reached {
        match self.answers.recv() {
            Ok(Answer::Reached(reached)) => reached,
            Ok(_) => unreachable!("nothing was asked"),
            Err(_) => {
                let thread = self.thread.take().expect("it runs until it is switched off");
                match thread.join() {
                    Ok(()) => panic!("the emulator has ended by itself"),
                    Err(panic) => std::panic::resume_unwind(panic),
                }
            }
        }
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            self.order(Order::End);
            let _ = thread.join();
        }
    }
}

fn run(image: &'static Image, connections: Connections, orders: Receiver<Order>, answers: Sender<Answer>) {
    let can = connections.can.clone();
    let (core, flash) = (connections.core.clone(), connections.flash.clone());
    let board = image.board();
    let part = Part::new(board, connections).expect("the part is described without contradiction");
    let session = Session::new(Box::new(Nucleo { board, part, core, flash }), 0, VirtualNanos(0))
        .expect("the board has one part");
    let conductor = Conductor { board, orders, answers, can, asleep: None, arrivals: Vec::new() };
    let start = Start::new(image.for_emulator());
    emulator::run(session, &start, conductor).expect("the image fits the part");
}

/// Returns all resets other than power-ups.
fn resets(session: &Session<Nucleo>) -> impl Iterator<Item = &rigless::session::Reset> {
    session.resets().iter().filter(|reset| reset.cause != ResetCause::PowerOn)
}

fn summary(session: &Session<Nucleo>) -> Summary {
    let reset = |reset: &rigless::session::Reset| Reset { at: reset.at.0, cause: format!("{:?}", reset.cause) };
    Summary { resets: resets(session).map(reset).collect(), complaints: complaints(session) }
}

/// Returns the actions of the firmware that the part lacks or forbids.
fn complaints(session: &Session<Nucleo>) -> Vec<String> {
    let unmapped = session.unmapped().into_iter().map(|gap| format!("nothing is there: {gap}"));
    let refused = session.refused().iter().map(|(address, fault)| format!("refused: {address:#x}, {fault}"));
    let unrouted = session.unrouted().iter().map(|line| format!("an interrupt that goes nowhere: {line:?}"));
    let told = session.told().map(|told| format!("{} {}: {}", told.instance, told.register, told.reason));
    unmapped.chain(refused).chain(unrouted).chain(told).collect()
}

/// Fills the RAM with noise.
fn forget(board: &Description, host: &mut dyn Host) {
    let mut random = fastrand::Rng::with_seed(0);
    for ram in board.memory.iter().filter(|region| region.kind == RegionKind::Ram) {
        for address in (ram.base..ram.base + ram.size).step_by(4) {
            host.write(address, Width::W32, random.u32(..).into()).expect("there is memory");
        }
    }
}

/// The board, for the emulator.
#[derive(Debug)]
struct Nucleo {
    board: &'static Description,
    part: Part,
    core: CoreView,
    flash: SharedFlash,
}

impl Store for Nucleo {}

impl Board for Nucleo {
    fn name(&self) -> &'static str {
        self.board.name
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![self.board.part]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.part)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let mut core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: NonZeroU64::new(CORE_HZ).expect("it runs"),
            interrupt_lines: NonZeroU32::new(u32::from(self.part.cpu().interrupt_lines)).expect("it has some"),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).expect("PM0214 4.5"),
            instructions_per_second: NonZeroU64::new(INSTRUCTIONS_PER_SECOND).expect("it runs"),
            boot: self.board.boot,
        }
        .spec_with_parts(&windows(self.part.bus()), armv7m::Fpu::FpV4Sp, armv7m::MpuRegions::Eight);
        core.processor = warm::kept(core.processor, self.core.clone(), self.flash.clone());
        vec![Target::new(self.board.part, &mut self.part, core)]
    }
}

/// Executes orders while the emulator stands.
struct Conductor {
    board: &'static Description,
    orders: Receiver<Order>,
    answers: Sender<Answer>,
    can: Can1,
    asleep: Option<u64>,
    arrivals: Vec<Arrival>,
}

impl Conductor {
    fn carry_out(
        &mut self,
        order: Order,
        session: &mut Session<Nucleo>,
        now: VirtualNanos,
        host: &mut dyn Host,
    ) -> Answer {
        match order {
            Order::Read(range) => {
                let byte = |address| host.read(address, Width::W8).map_or(0, |value| value as u8);
                Answer::Bytes(range.map(byte).collect())
            }
            Order::Write(address, bytes) => {
                for (address, byte) in (address..).zip(bytes) {
                    let written = host.write(address, Width::W8, byte.into());
                    written.or_else(|_| host.program(address, Width::W8, byte.into())).expect("there is memory");
                }
                Answer::Done
            }
            Order::Drive(port, pin, high) => {
                session.board_mut().part.drive(port, pin, high, now);
                Answer::Done
            }
            Order::IsHigh(port, pin) => Answer::Level(session.board().part.is_high(port, pin)),
            Order::Register(address) => {
                let part = &mut session.board_mut().part;
                let value = part.peek(now, address, Width::W32);
                Answer::Register(value.unwrap_or_else(|_| panic!("there is no register at {address:#x}")) as u32)
            }
            Order::Supply(millivolts) => {
                session.board_mut().part.supply(millivolts);
                Answer::Done
            }
            Order::Watch(address) => {
                session.watch(Watch::Instruction(address));
                session.settle_watches(host);
                Answer::Done
            }
            Order::Hits => Answer::Hits(std::mem::take(&mut self.arrivals)),
            Order::Power(on) => {
                session.board_mut().part.power(on, now);
                Answer::Done
            }
            Order::Forget => {
                forget(self.board, host);
                Answer::Done
            }
            Order::Sum => Answer::Summary(summary(session)),
            Order::RunUntil(_) | Order::End => unreachable!("these end the stop"),
        }
    }
}

impl Driver<Nucleo> for Conductor {
    fn on_settled(&mut self, session: &mut Session<Nucleo>, _: &mut dyn Host, settled: Settled) {
        match settled {
            Settled::Access { access, .. } if CAN1.contains(&access.address) && self.can.lock().changed => {
                session.run_until(access.virtual_time);
            }
            Settled::Stop(stop) => {
                if stop.reason == StopReason::Idle {
                    self.asleep.get_or_insert(stop.instruction_count);
                }
                if self.can.lock().changed {
                    session.run_until(stop.at);
                }
            }
            Settled::Hit(hit) => {
                let Hit { address, at, instruction_count: instructions, .. } = hit;
                self.arrivals.push(Arrival { address, at: at.0, instructions });
            }
            _ => {}
        }
    }

    fn on_stop(&mut self, session: &mut Session<Nucleo>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        let reached = Reached {
            at: stop.at.0,
            instructions: stop.instruction_count,
            asleep: self.asleep.take(),
            resets: resets(session).count(),
        };
        self.answers.send(Answer::Reached(reached)).ok()?;
        loop {
            match self.orders.recv().ok()? {
                Order::RunUntil(until) => return Some(VirtualNanos(until)),
                Order::End => return None,
                order => {
                    let answer = self.carry_out(order, session, stop.at, host);
                    self.answers.send(answer).ok()?;
                }
            }
        }
    }
}
