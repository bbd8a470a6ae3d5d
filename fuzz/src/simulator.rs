//! A simulator without sockets. Its wall clock advances only on demand of the attack, and clients use streams in
//! memory.

use std::cell::Cell;
use std::io::{self, Write};
use std::rc::Rc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use embedded_can::nb::Can as _;
use hal_sim::simulation::Simulation;
use hal_sim::{Client, Frame};
use pve_sim::inbox::{Arrival, Inbox, WorldSender};
use pve_sim::run::{Driver, Platform};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, DuplexStream, ReadHalf, WriteHalf, duplex, split};
use tokio::task::yield_now;

/// The number of bytes that a stream holds before they are read.
const STREAM: usize = 256 * 1024;

/// The number of turns of the tasks after which an answer has certainly come.
const YIELDS: usize = 160;

/// The number of turns of the tasks after which everything due is done.
const HOPS: usize = 16;

/// The number of turns of the driver after which a busy world is left alone.
const TURNS: usize = 200;

/// A simulator that an attack drives.
pub(crate) struct Simulator {
    driver: Driver<Clock>,
    state: Rc<ClockState>,
    /// The sender of messages to the world.
    pub(crate) world_sender: WorldSender,
    witness: Client,
    stderr: Receiver<Vec<u8>>,
}

/// The wall clock of a driver, which advances up to a limit.
pub(crate) struct Clock {
    state: Rc<ClockState>,
    inbox: Inbox,
}

struct ClockState {
    now: Cell<Instant>,
    limit: Cell<Instant>,
    /// Whether the driver waits at the limit.
    is_idle: Cell<bool>,
    /// The number of messages that the world has received.
    taken: Cell<u64>,
}

impl Platform for Clock {
    fn now(&mut self) -> Instant {
        self.state.now.get()
    }

    fn is_ending(&self) -> bool {
        false
    }

    fn take(&mut self) -> Option<Arrival> {
        let Arrival { message, .. } = self.inbox.messages.try_recv().ok()?;
        self.state.taken.set(self.state.taken.get() + 1);
        Some(Arrival { at: self.state.now.get(), message })
    }

    fn wait(&mut self, until: Option<Instant>, _: Duration) -> Option<Arrival> {
        let taken = self.take();
        if taken.is_none() {
            let limit = self.state.limit.get();
            let until = until.map_or(limit, |until| until.min(limit));
            self.state.is_idle.set(self.state.now.get() >= limit);
            self.state.now.set(self.state.now.get().max(until));
        }
        taken
    }
}

/// The content of stderr, which is handed over at the end.
struct Collected(Vec<u8>, Sender<Vec<u8>>);

impl Write for Collected {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Collected {
    fn drop(&mut self) {
        let _ = self.1.send(std::mem::take(&mut self.0));
    }
}

impl Simulator {
    /// Switches the devices of a simulation on. `prepare` may change its driver.
    pub(crate) fn new(mut simulation: Simulation, prepare: impl FnOnce(Driver<Clock>) -> Driver<Clock>) -> Self {
        let now = Cell::new(Instant::now());
        let (limit, is_idle, taken) = (now.clone(), Cell::new(false), Cell::new(0));
        let state = Rc::new(ClockState { now, limit, is_idle, taken });
        let (world_sender, inbox) = WorldSender::new();
        let witness = simulation.world_mut().client("witness");
        let (sender, stderr) = channel();
        let clock = Clock { state: Rc::clone(&state), inbox };
        let driver = Driver::embedded(simulation, clock, 1.0, io::sink(), Collected(Vec::new(), sender));
        let driver = prepare(driver.expect("a thread"));
        Self { driver, state, world_sender, witness, stderr }
    }

    /// Advances the wall clock. Returns `false` if the world is not ready after [`TURNS`].
    pub(crate) fn run(&mut self, span: Duration) -> bool {
        self.state.limit.set(self.state.limit.get() + span);
        let turns = TURNS + usize::try_from(span.as_millis()).unwrap_or(TURNS);
        for _ in 0..turns {
            self.state.is_idle.set(false);
            self.driver.turn();
            if self.state.is_idle.get() {
                return true;
            }
        }
        false
    }

    /// Waits until all messages of clients have taken effect and their answers have come.
    pub(crate) async fn settle(&mut self) {
        for _ in 0..TURNS {
            let before = self.state.taken.get();
            for _ in 0..YIELDS {
                yield_now().await;
            }
            self.run(Duration::ZERO);
            for _ in 0..YIELDS {
                yield_now().await;
            }
            if self.state.taken.get() == before {
                return;
            }
        }
    }

    /// Advances the time of the world and of its clients, with all effects.
    pub(crate) async fn pass(&mut self, span: Duration) {
        const STEP: Duration = Duration::from_millis(10);
        let mut left = span;
        while !left.is_zero() {
            let step = left.min(STEP);
            tokio::time::advance(step).await;
            self.run(step);
            for _ in 0..HOPS {
                yield_now().await;
            }
            left -= step;
        }
        self.settle().await;
    }

    /// Returns the frames on the bus since the previous call.
    pub(crate) fn witnessed(&mut self) -> Vec<Frame> {
        std::iter::from_fn(|| self.witness.receive().ok()).collect()
    }

    /// Sends a frame to all clients.
    pub(crate) fn send(&mut self, frame: &Frame) {
        self.witness.transmit(frame).expect("a world");
    }

    /// Ends the simulator. Returns the content of stderr.
    pub(crate) fn end(self) -> String {
        let Self { driver, stderr, .. } = self;
        drop(driver);
        String::from_utf8(stderr.recv().unwrap_or_default()).expect("text")
    }
}

/// A client over a stream in memory.
pub(crate) struct Stranger {
    writer: WriteHalf<DuplexStream>,
    heard: Arc<Mutex<(Vec<u8>, bool)>>,
}

impl Stranger {
    /// Creates a client, and returns it with the end of its server.
    pub(crate) fn new() -> (Self, DuplexStream) {
        let (near, far) = duplex(STREAM);
        let (mut reader, writer) = split(near);
        let heard = Arc::<Mutex<(Vec<u8>, bool)>>::default();
        let ear = Arc::clone(&heard);
        tokio::spawn(async move {
            let mut bytes = [0; 4096];
            while let Ok(len @ 1..) = ReadHalf::read(&mut reader, &mut bytes).await {
                ear.lock().unwrap_or_else(PoisonError::into_inner).0.extend_from_slice(&bytes[..len]);
            }
            ear.lock().unwrap_or_else(PoisonError::into_inner).1 = true;
        });
        (Self { writer, heard }, far)
    }

    /// Sends bytes. A server that has disconnected does not receive them.
    pub(crate) async fn say(&mut self, bytes: &[u8]) {
        let _ = self.writer.write_all(bytes).await;
    }

    /// Returns the bytes received so far, and whether the server has disconnected.
    pub(crate) fn heard(&self) -> (Vec<u8>, bool) {
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        (std::mem::take(&mut heard.0), heard.1)
    }

    /// Disconnects.
    pub(crate) async fn leave(mut self) {
        let _ = self.writer.shutdown().await;
    }
}

/// Plays an attack on a stopped clock.
pub(crate) fn play(attack: impl Future<Output = ()>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
    runtime.expect("a runtime").block_on(attack);
}
