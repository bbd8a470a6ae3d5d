//! Goes through a use case on a bench, and compares every frame.

use std::fmt;

use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};

use super::script::{Position, Step, UseCase};
use crate::world::Plant;

/// Where a use case can be played: devices on a bus, and a master that is told what to send.
pub trait Bench {
    /// Cuts the power of all devices and gives it back; the first time, switches them on.
    fn power_cycle(&mut self);
    /// Sends a frame of the master, as soon as the bus lets it.
    fn send(&mut self, frame: Frame);
    /// Returns the next frame of a device, as soon as it comes, at the latest at `until`.
    fn receive(&mut self, until: Instant) -> Option<Frame>;
    /// Changes what acts on all devices from outside.
    fn set_plant(&mut self, plant: Plant);
    /// Changes the bit rate of the master.
    fn set_bit_rate(&mut self, bit_rate: BitRate);
    /// Returns the present instant.
    fn now(&self) -> Instant;
}

/// How long the master waits for an answer.
const PATIENCE: Duration = Duration::from_millis(1000);

/// How long the bus must be quiet at the end.
const QUIET: Duration = Duration::from_millis(50);

/// Where a device did something else than the manual says.
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
            None => write!(f, "expected no frame")?,
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
    let last_sent = bench.now();
    let mut player = Player {
        bench,
        print,
        last_sent,
        cyclic: None,
        steady: None,
        frames: 0,
        latest: Vec::new(),
        again: Vec::new(),
    };
    player.line(&format!("use case {}: {}", case.name, case.title));
    for step in case.steps {
        player.step(step)?;
    }
    player.wait(after(player.bench.now(), QUIET))?;
    let frames = player.frames;
    player.line(&format!("{frames} frames as expected"));
    Ok(())
}

/// The frame that the master sends in a cycle.
#[derive(Clone, Copy, Debug)]
struct Cyclic {
    frame: Frame,
    meaning: &'static str,
    period: Duration,
    /// When it is its turn.
    due: Instant,
    /// How often it was sent, since it is this frame.
    sent: u32,
}

struct Player<'a, B> {
    bench: &'a mut B,
    print: &'a mut dyn FnMut(&str),
    last_sent: Instant,
    cyclic: Option<Cyclic>,
    /// The frame that may come again at any time.
    steady: Option<Frame>,
    /// How many frames of the valves were compared.
    frames: u32,
    /// The frame of each identifier that was printed last, with its meaning.
    latest: Vec<(Frame, String)>,
    /// Frames that went or came again as they were, and how often: not printed yet.
    again: Vec<(Frame, u32)>,
}

impl<B: Bench> Player<'_, B> {
    fn step(&mut self, step: &Step) -> Result<(), Deviation> {
        match *step {
            Step::Note(text) => self.line(&format!("-- {text}")),
            Step::PowerCycle => {
                self.line("-- power-up");
                self.steady = None;
                self.bench.power_cycle();
            }
            Step::Send(text, meaning) => self.send(text, meaning),
            Step::Expect(text, meaning) => self.expect(text, meaning)?,
            Step::ExpectPosition(text, position, meaning) => self.expect_position(text, position, meaning)?,
            Step::Steady(text, meaning) => {
                self.expect(text, meaning)?;
                self.steady = Some(parse(text));
            }
            Step::Unsteady => self.steady = None,
            Step::Cycle(ms) => self.wait(after(self.last_sent, Duration::from_millis(ms)))?,
            Step::Wait(ms) => self.wait(after(self.bench.now(), Duration::from_millis(ms)))?,
            Step::Cyclic(count, period, request, answer) => {
                for cycle in 0..count {
                    if cycle > 0 {
                        self.wait(after(self.last_sent, Duration::from_millis(period)))?;
                    }
                    self.send(request.0, request.1);
                    self.expect(answer.0, answer.1)?;
                }
            }
            Step::Repeat(period, text, meaning) => {
                let due = self.cyclic.map_or(self.bench.now(), |cyclic| cyclic.due);
                let period = Duration::from_millis(period);
                self.cyclic = Some(Cyclic { frame: parse(text), meaning, period, due, sent: 0 });
            }
            Step::Cycles(count) => {
                for _ in 0..count {
                    let due = self.cyclic.map_or(self.bench.now(), |cyclic| cyclic.due);
                    self.wait(due)?;
                }
            }
            Step::Pause => self.cyclic = None,
            Step::Plant(plant) => {
                self.line(&format!("-- plant: {plant}"));
                self.bench.set_plant(plant);
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

    /// Sends the master's cyclic frame, whose turn it is.
    fn send_cyclic(&mut self) {
        let Some(cyclic) = &mut self.cyclic else { return };
        cyclic.due = after(cyclic.due, cyclic.period);
        cyclic.sent += 1;
        let Cyclic { frame, meaning, period, sent, .. } = *cyclic;
        if sent == 1 {
            self.frame("->", &frame, &format!("{meaning}; every {} ms", period.as_millis()));
        } else {
            self.count(frame);
        }
        self.last_sent = self.bench.now();
        self.bench.send(frame);
    }

    fn expect(&mut self, text: &str, meaning: &'static str) -> Result<(), Deviation> {
        let expected = parse(text);
        let received = self.receive(Some(expected), self.patience());
        if received == Some(expected) {
            self.frames += 1;
            self.frame("<-", &expected, meaning);
            self.steady.take_if(|steady| steady.id() == expected.id());
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
        let received = self.receive(None, self.patience());
        let near = received.is_some_and(|frame| {
            let (start, rest) = frame.data().split_at(frame.data().len().min(head.data().len()));
            let reached = rest.try_into().map(i16::from_le_bytes);
            frame.id() == head.id()
                && start == head.data()
                && reached.is_ok_and(|reached| reached.abs_diff(position.0) <= Position::TOLERANCE.unsigned_abs())
        });
        match received {
            Some(frame) if near => {
                self.frames += 1;
                self.frame("<-", &frame, meaning);
                Ok(())
            }
            _ => Err(Deviation { expected: Some(format!("{head} and position {}", position.0)), received, meaning }),
        }
    }

    /// Lets time pass; nothing but what is steady may come.
    fn wait(&mut self, until: Instant) -> Result<(), Deviation> {
        match self.receive(None, until) {
            None => Ok(()),
            received => {
                let expected = self.steady.map(|steady| steady.to_string());
                Err(Deviation { expected, received, meaning: "and nothing else" })
            }
        }
    }

    fn patience(&self) -> Instant {
        after(self.bench.now(), PATIENCE)
    }

    /// Returns the next frame of a device that is the one wanted or not the steady one. The master's cyclic frame goes
    /// on.
    fn receive(&mut self, wanted: Option<Frame>, until: Instant) -> Option<Frame> {
        loop {
            let turn = self.cyclic.map(|cyclic| cyclic.due).filter(|due| *due <= until);
            match self.bench.receive(turn.unwrap_or(until)) {
                Some(frame) if Some(frame) == self.steady && wanted != Some(frame) => {
                    self.frames += 1;
                    self.count(frame);
                }
                Some(frame) => return Some(frame),
                None if turn.is_some() => self.send_cyclic(),
                None => return None,
            }
        }
    }

    /// Counts a frame that came or went as it did before.
    fn count(&mut self, frame: Frame) {
        match self.again.iter_mut().find(|(counted, _)| *counted == frame) {
            Some((_, count)) => *count += 1,
            None => self.again.push((frame, 1)),
        }
    }

    /// Prints a frame, or counts it when the one before of its identifier was the same.
    fn frame(&mut self, direction: &str, frame: &Frame, meaning: &str) {
        match self.latest.iter_mut().find(|(latest, _)| latest.id() == frame.id()) {
            Some((latest, meant)) if latest == frame && meant == meaning => return self.count(*frame),
            Some(latest) => *latest = (*frame, meaning.to_owned()),
            None => self.latest.push((*frame, meaning.to_owned())),
        }
        let ms = since(self.bench.now(), Instant::from_ticks(0)).as_micros();
        let text = format!("{:>6}.{:03} ms  {direction}  {:<35}  {meaning}", ms / 1000, ms % 1000, frame.to_string());
        self.tell_again(|again| again.id() == frame.id());
        (self.print)(&text);
    }

    /// Prints a line that is no frame; repeats are not counted beyond it.
    fn line(&mut self, text: &str) {
        self.tell_again(|_| true);
        self.latest.clear();
        (self.print)(text);
    }

    fn tell_again(&mut self, which: impl Fn(&Frame) -> bool) {
        for (frame, count) in self.again.extract_if(.., |(frame, _)| which(frame)) {
            let times = if count == 1 { "once".to_owned() } else { format!("{count} times") };
            (self.print)(&format!("{:>17}{:<35}  {times} more", "", frame.to_string()));
        }
    }
}

/// Returns the frame of a script's text.
///
/// # Panics
/// When it is none: scripts are part of the program, and the tests read every one.
fn parse(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text:?}: {error}"))
}
