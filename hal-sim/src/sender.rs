//! Frames sent on command by a controller of their own: one after the other, each once or again and again.

use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, NEVER, after};

use crate::world::{TapId, World};

/// How long a frame waits for the bus before it is withdrawn.
const PATIENCE: Duration = Duration::from_secs(1);

/// Why a cyclic frame was not sent.
const STOPPED: &str = "the cyclic frame was stopped";

/// Why a frame was not sent in time.
const LATE: &str = "the frame was not on the bus within 1 s of virtual time: it was withdrawn";

/// The most frames that wait for the bus.
const WAITING: usize = 256;

/// The most cyclic frames.
const CYCLIC: usize = 64;

/// The way of an answer back to the one who gave a frame to be sent.
pub trait Receipt {
    /// Tells the end of the frame on the bus, or why it was not sent.
    fn tell(self, sent: Result<Instant, Unsent>);

    /// Returns whether nobody waits for the answer any more.
    fn is_given_up(&self) -> bool;
}

/// Why a frame was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsent {
    /// There is no room for it.
    TooMany(&'static str),
    /// It was cyclic and stopped before it was sent, or the bus did not take it in time.
    Withdrawn(&'static str),
}

/// The name of the control interface in traces: a device has another one.
pub const CONTROL: &str = "http";

/// A controller with its frames, and receipts of type `R` for them.
#[derive(Debug)]
pub struct Sender<R> {
    tap: TapId,
    /// The frame that the controller has.
    sending: Option<Outgoing<R>>,
    /// The frames after it.
    waiting: Vec<Outgoing<R>>,
    cyclic: Vec<Cyclic>,
}

/// A frame on its way.
#[derive(Debug)]
struct Outgoing<R> {
    frame: Frame,
    /// When it is withdrawn.
    deadline: Instant,
    /// The way of the answer; a cyclic frame answers once.
    answer: Option<R>,
    /// Whether it is one of a cyclic frame.
    is_cyclic: bool,
}

/// A frame that is sent again and again.
#[derive(Debug)]
struct Cyclic {
    frame: Frame,
    period: Duration,
    next: Instant,
}

impl<R: Receipt> Sender<R> {
    /// Puts the controller on the bus, by its name in traces.
    pub fn new(name: &str, world: &mut World) -> Self {
        Self { tap: world.add_gateway(name), sending: None, waiting: Vec::new(), cyclic: Vec::new() }
    }

    /// Sends a frame, again and again with a period: in the place of an earlier cyclic frame of the same identifier.
    pub fn send(&mut self, frame: Frame, period: Option<Duration>, answer: R, world: &mut World) {
        if self.waiting.len() >= WAITING {
            return answer.tell(Err(Unsent::TooMany("too many frames wait for the bus")));
        }
        if let Some(period) = period {
            self.stop(Some(frame.id()), world);
            if self.cyclic.len() >= CYCLIC {
                return answer.tell(Err(Unsent::TooMany("too many cyclic frames")));
            }
            self.cyclic.push(Cyclic { frame, period, next: after(world.now(), period) });
        }
        let deadline = after(world.now(), PATIENCE);
        self.waiting.push(Outgoing { frame, deadline, answer: Some(answer), is_cyclic: period.is_some() });
        self.load(world);
    }

    /// Ends the cyclic frames of an identifier, or all; returns how many there were.
    pub fn stop(&mut self, id: Option<Id>, world: &mut World) -> usize {
        let meant = |frame: &Frame| id.is_none_or(|id| frame.id() == id);
        let before = self.cyclic.len();
        self.cyclic.retain(|cyclic| !meant(&cyclic.frame));
        let stopped = |outgoing: &mut Outgoing<R>| outgoing.is_cyclic && meant(&outgoing.frame);
        for outgoing in self.waiting.extract_if(.., stopped) {
            outgoing.refuse(Unsent::Withdrawn(STOPPED));
        }
        if let Some(outgoing) = self.sending.as_mut().filter(|outgoing| outgoing.is_cyclic && meant(&outgoing.frame)) {
            if world.is_sending(self.tap) {
                // A frame on the wire goes to its end. One that is destroyed there is not sent again.
                outgoing.is_cyclic = false;
                outgoing.deadline = world.now();
            } else if let Some(outgoing) = self.sending.take() {
                world.withdraw(self.tap);
                outgoing.refuse(Unsent::Withdrawn(STOPPED));
                self.load(world);
            }
        }
        before - self.cyclic.len()
    }

    /// Answers for what was sent, withdraws what waits for too long, and sends what is due.
    pub fn attend(&mut self, world: &mut World) {
        let now = world.now();
        if world.pending(self.tap) == 0
            && let Some(sent) = self.sending.take()
            && let Some(answer) = sent.answer
        {
            answer.tell(Ok(now));
        }
        let is_late = |outgoing: &mut Outgoing<R>| outgoing.deadline <= now;
        let mut late: Vec<Outgoing<R>> = self.waiting.extract_if(.., is_late).collect();
        if !world.is_sending(self.tap)
            && let Some(outgoing) = self.sending.take_if(is_late)
        {
            world.withdraw(self.tap);
            late.push(outgoing);
        }
        for outgoing in late {
            if outgoing.is_cyclic && outgoing.answer.is_some() {
                self.cyclic.retain(|cyclic| cyclic.frame.id() != outgoing.frame.id());
            }
            outgoing.refuse(Unsent::Withdrawn(LATE));
        }
        self.repeat(now);
        self.load(world);
    }

    /// Puts cyclic frames that are due behind the others. One that has not gone out since the last time does so once.
    fn repeat(&mut self, now: Instant) {
        let Self { sending, waiting, cyclic, .. } = self;
        for Cyclic { frame, period, next } in cyclic.iter_mut().filter(|cyclic| cyclic.next <= now) {
            *next = after(*next, *period);
            let mut on_way = sending.iter().chain(waiting.iter());
            if !on_way.any(|outgoing| outgoing.is_cyclic && outgoing.frame.id() == frame.id()) {
                let deadline = after(now, PATIENCE);
                waiting.push(Outgoing { frame: *frame, deadline, answer: None, is_cyclic: true });
            }
        }
    }

    /// Gives the controller its next frame, the most urgent one, of equals the one that waits longest.
    fn load(&mut self, world: &mut World) {
        if self.sending.is_some() {
            return;
        }
        let urgency = |(place, outgoing): &(usize, &Outgoing<R>)| (outgoing.frame.arbitration(), *place);
        let Some((next, _)) = self.waiting.iter().enumerate().min_by_key(urgency) else { return };
        let outgoing = self.waiting.remove(next);
        world.send(self.tap, outgoing.frame);
        self.sending = Some(outgoing);
    }

    /// Returns when there is next something to do, after now.
    pub fn due(&self, now: Instant) -> Instant {
        let deadlines = self.sending.iter().chain(&self.waiting).map(|outgoing| outgoing.deadline);
        let repeats = self.cyclic.iter().map(|cyclic| cyclic.next);
        deadlines.chain(repeats).filter(|due| *due > now).min().unwrap_or(NEVER)
    }

    /// Returns the end of the time in which a client still waits for an answer; `None` when none does. A frame on the
    /// wire has no such end.
    pub fn awaited(&self, now: Instant) -> Option<Instant> {
        let answers = |outgoing: &&Outgoing<R>| outgoing.answer.as_ref().is_some_and(|answer| !answer.is_given_up());
        let deadlines = self.sending.iter().chain(&self.waiting).filter(answers).map(|outgoing| outgoing.deadline);
        deadlines.map(|deadline| if deadline > now { deadline } else { NEVER }).max()
    }

    /// Returns whether nothing is to be sent.
    pub const fn is_idle(&self) -> bool {
        self.sending.is_none() && self.waiting.is_empty() && self.cyclic.is_empty()
    }
}

impl<R: Receipt> Outgoing<R> {
    fn refuse(self, reason: Unsent) {
        if let Some(answer) = self.answer {
            answer.tell(Err(reason));
        }
    }
}
