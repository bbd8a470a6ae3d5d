//! Goes through a use case on a bench, and compares every frame.

use std::fmt;

use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};

use super::script::{Position, Step, UseCase};

/// Where a use case can be played: valves on a bus, and a master that is told what to send.
pub trait Bench {
    /// Cuts the power of all valves and gives it back; the first time, switches them on.
    fn power_cycle(&mut self);
    /// The master sends a frame, as soon as the bus lets it.
    fn send(&mut self, frame: Frame);
    /// The next frame of a valve, as soon as it comes, at the latest at `until`.
    fn receive(&mut self, until: Instant) -> Option<Frame>;
    /// Lets time pass until `until`.
    fn wait(&mut self, until: Instant);
    /// Changes the supply of all valves.
    fn set_supply(&mut self, millivolt: u32);
    /// The master changes its bit rate.
    fn set_bit_rate(&mut self, bit_rate: BitRate);
    /// The present instant.
    fn now(&self) -> Instant;
}

/// How long the master waits for an answer.
const PATIENCE: Duration = Duration::from_millis(1000);

/// How long the bus must be quiet at the end.
const QUIET: Duration = Duration::from_millis(50);

/// Where a valve did something else than the manual says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deviation {
    /// What had to come; `None` when nothing had to.
    pub expected: Option<String>,
    /// What came; `None` when nothing did.
    pub received: Option<Frame>,
    /// What the frame would have meant.
    pub meaning: &'static str,
}

impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.expected {
            Some(expected) => write!(f, "expected {expected} ({})", self.meaning)?,
            None => write!(f, "expected no more frames")?,
        }
        match &self.received {
            Some(frame) => write!(f, ", received {frame}"),
            None => write!(f, ", received nothing"),
        }
    }
}

impl std::error::Error for Deviation {}

/// Plays a use case; `print` is given each line of what happens.
///
/// # Errors
/// [`Deviation`] at the first frame that differs from the manual's.
pub fn play(case: &UseCase, bench: &mut impl Bench, print: &mut dyn FnMut(&str)) -> Result<(), Deviation> {
    let mut player = Player { bench, print, last_sent: Instant::from_ticks(0) };
    (player.print)(&format!("use case {}: {}", case.name, case.title));
    for step in case.steps {
        player.step(step)?;
    }
    let end = after(player.bench.now(), QUIET);
    match player.bench.receive(end) {
        None => Ok(()),
        Some(frame) => Err(Deviation { expected: None, received: Some(frame), meaning: "" }),
    }
}

struct Player<'a, B> {
    bench: &'a mut B,
    print: &'a mut dyn FnMut(&str),
    last_sent: Instant,
}

impl<B: Bench> Player<'_, B> {
    fn step(&mut self, step: &Step) -> Result<(), Deviation> {
        match *step {
            Step::Note(text) => self.line(&format!("-- {text}")),
            Step::PowerCycle => {
                self.line("-- power-up");
                self.bench.power_cycle();
            }
            Step::Send(text, meaning) => self.send(text, meaning),
            Step::Expect(text, meaning) => self.expect(text, meaning)?,
            Step::ExpectPosition(text, position, meaning) => self.expect_position(text, position, meaning)?,
            Step::Cycle(ms) => self.bench.wait(after(self.last_sent, Duration::from_millis(ms))),
            Step::Wait(ms) => self.bench.wait(after(self.bench.now(), Duration::from_millis(ms))),
            Step::Cyclic(count, period, request, answer) => {
                for cycle in 0..count {
                    if cycle > 0 {
                        self.bench.wait(after(self.last_sent, Duration::from_millis(period)));
                    }
                    self.send(request.0, request.1);
                    self.expect(answer.0, answer.1)?;
                }
            }
            Step::Supply(millivolt) => {
                self.line(&format!("-- supply {}.{} V", millivolt / 1000, millivolt % 1000 / 100));
                self.bench.set_supply(millivolt);
            }
            Step::MasterBitRate(bit_rate) => {
                self.line(&format!("-- the master goes to {} kbit/s", bit_rate.bits_per_second() / 1000));
                self.bench.set_bit_rate(bit_rate);
            }
        }
        Ok(())
    }

    fn send(&mut self, text: &str, meaning: &str) {
        let frame = parse(text);
        self.last_sent = self.bench.now();
        self.frame("->", &frame, meaning);
        self.bench.send(frame);
    }

    fn expect(&mut self, text: &str, meaning: &'static str) -> Result<(), Deviation> {
        let expected = parse(text);
        let received = self.receive();
        if received == Some(expected) {
            self.frame("<-", &expected, meaning);
            return Ok(());
        }
        Err(Deviation { expected: Some(expected.to_string()), received, meaning })
    }

    fn expect_position(
        &mut self,
        text: &'static str,
        position: Position,
        meaning: &'static str,
    ) -> Result<(), Deviation> {
        let head = parse(text);
        let received = self.receive();
        let near = received.is_some_and(|frame| {
            let (start, rest) = frame.data().split_at(frame.data().len().min(head.data().len()));
            let reached = rest.try_into().map(i16::from_le_bytes);
            frame.id() == head.id()
                && start == head.data()
                && reached.is_ok_and(|reached| reached.abs_diff(position.0) <= Position::TOLERANCE.unsigned_abs())
        });
        match received {
            Some(frame) if near => {
                self.frame("<-", &frame, meaning);
                Ok(())
            }
            _ => Err(Deviation { expected: Some(format!("{head} and position {}", position.0)), received, meaning }),
        }
    }

    fn receive(&mut self) -> Option<Frame> {
        let until = after(self.bench.now(), PATIENCE);
        self.bench.receive(until)
    }

    fn frame(&mut self, direction: &str, frame: &Frame, meaning: &str) {
        let ms = since(self.bench.now(), Instant::from_ticks(0)).as_micros();
        self.line(&format!("{:>6}.{:03} ms  {direction}  {:<30}  {meaning}", ms / 1000, ms % 1000, frame.to_string()));
    }

    fn line(&mut self, text: &str) {
        (self.print)(text);
    }
}

/// The frame of a script's text.
///
/// # Panics
/// When it is none: scripts are part of the program, and the tests read every one.
fn parse(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text:?}: {error}"))
}
