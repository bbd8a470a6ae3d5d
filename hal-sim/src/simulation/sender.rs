//! The command sender: a separate controller that sends the frames of commands, once or cyclically.

use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::command::{Refusal, Reply, Sent, Ticket};
use crate::world::{ClientPortId, World};

/// The time after which an unsent frame is withdrawn.
const PATIENCE: Duration = Duration::from_secs(1);

/// The error of a send command whose cyclic frame was stopped.
const STOPPED: &str = "the cyclic frame was stopped";

/// The error of a send command whose frame was not sent in time.
const LATE: &str = "the frame was not sent within 1 s of virtual time and was withdrawn";

/// The maximum number of pending frames.
const WAITING: usize = 256;

/// The maximum number of cyclic frames.
const CYCLIC: usize = 64;

/// The completed commands.
pub(super) type Completed = Vec<(Ticket, Result<Reply, Refusal>)>;

/// The command sender, with its pending and cyclic frames.
#[derive(Clone, Debug)]
pub(super) struct Sender {
    port: ClientPortId,
    /// The frame in the controller's transmit queue.
    sending: Option<Outgoing>,
    /// The frames that wait until the controller's queue is empty.
    waiting: Vec<Outgoing>,
    cyclic: Vec<Cyclic>,
}

/// A frame that has not been sent yet.
#[derive(Clone, Debug)]
struct Outgoing {
    frame: Frame,
    /// The time at which the frame is withdrawn if still unsent.
    deadline: Instant,
    /// The command that completes when the frame is sent; `None` for later transmissions of a cyclic frame.
    ticket: Option<Ticket>,
    /// True if the frame is a transmission of a cyclic frame.
    is_cyclic: bool,
    /// The error if the frame is withdrawn at its deadline.
    withdrawal: &'static str,
}

/// A cyclic frame.
#[derive(Clone, Debug)]
struct Cyclic {
    frame: Frame,
    period: Duration,
    next: Instant,
}

impl Sender {
    /// Creates a sender and adds its controller to the bus. `name` identifies the controller in traces.
    pub(super) fn new(name: &str, world: &mut World) -> Self {
        Self { port: world.add_sender(name), sending: None, waiting: Vec::new(), cyclic: Vec::new() }
    }

    /// Sends a frame once or, with a period, cyclically. A cyclic frame replaces an earlier cyclic frame with the same
    /// identifier.
    pub(super) fn send(
        &mut self,
        frame: Frame,
        period: Option<Duration>,
        ticket: Ticket,
        world: &mut World,
        completed: &mut Completed,
    ) -> Result<(), Refusal> {
        if self.waiting.len() >= WAITING {
            return Err(Refusal::TooMany("256 frames are already pending"));
        }
        if let Some(period) = period {
            self.stop(Some(frame.id()), world, completed);
            if self.cyclic.len() >= CYCLIC {
                return Err(Refusal::TooMany("64 cyclic frames are already active; stop one first"));
            }
            self.cyclic.push(Cyclic { frame, period, next: after(world.now(), period) });
        }
        let deadline = after(world.now(), PATIENCE);
        self.waiting.push(Outgoing {
            frame,
            deadline,
            ticket: Some(ticket),
            is_cyclic: period.is_some(),
            withdrawal: LATE,
        });
        self.load(world);
        Ok(())
    }

    /// Stops the cyclic frames with an identifier, or all if `None`. Returns the number of stopped cyclic frames.
    pub(super) fn stop(&mut self, id: Option<Id>, world: &mut World, completed: &mut Completed) -> usize {
        let meant = |frame: &Frame| id.is_none_or(|id| frame.id() == id);
        let before = self.cyclic.len();
        self.cyclic.retain(|cyclic| !meant(&cyclic.frame));
        let stopped = |outgoing: &mut Outgoing| outgoing.is_cyclic && meant(&outgoing.frame);
        for outgoing in self.waiting.extract_if(.., stopped) {
            outgoing.refuse(STOPPED, completed);
        }
        if let Some(outgoing) = self.sending.as_mut().filter(|outgoing| outgoing.is_cyclic && meant(&outgoing.frame)) {
            if world.is_sending(self.port) {
                // The current attempt to send the frame continues, but a destroyed frame is not retransmitted.
                outgoing.is_cyclic = false;
                outgoing.deadline = world.now();
                outgoing.withdrawal = STOPPED;
            } else if let Some(outgoing) = self.sending.take() {
                world.drop_waiting(self.port);
                outgoing.refuse(STOPPED, completed);
                self.load(world);
            }
        }
        before - self.cyclic.len()
    }

    /// Completes sent frames, withdraws late frames, and sends due frames.
    pub(super) fn poll(&mut self, world: &mut World, completed: &mut Completed) {
        if self.is_idle() {
            return;
        }
        let now = world.now();
        self.complete(world, completed);
        let is_late = |outgoing: &mut Outgoing| outgoing.deadline <= now;
        let mut late: Vec<Outgoing> = self.waiting.extract_if(.., is_late).collect();
        if !world.is_sending(self.port)
            && let Some(outgoing) = self.sending.take_if(is_late)
        {
            world.drop_waiting(self.port);
            late.push(outgoing);
        }
        for outgoing in late {
            if outgoing.is_cyclic && outgoing.ticket.is_some() {
                self.cyclic.retain(|cyclic| cyclic.frame.id() != outgoing.frame.id());
            }
            let reason = outgoing.withdrawal;
            outgoing.refuse(reason, completed);
        }
        self.repeat(now);
        self.load(world);
        while self.complete(world, completed) {
            self.load(world);
        }
    }

    /// Completes the command whose frame is in the controller if the frame was sent or is delayed by a fault. Returns
    /// whether the frame has left the controller.
    fn complete(&mut self, world: &World, completed: &mut Completed) -> bool {
        let Some(sent) = self.sending.take_if(|_| world.client_port(self.port).is_controller_empty()) else {
            return false;
        };
        if let Some(ticket) = sent.ticket {
            completed.push((ticket, Ok(Reply::Sent(Sent { t_us: world.now().as_micros() }))));
        }
        true
    }

    /// Queues the due cyclic frames. A frame still queued from its previous period is not queued again.
    fn repeat(&mut self, now: Instant) {
        let Self { sending, waiting, cyclic, .. } = self;
        for Cyclic { frame, period, next } in cyclic.iter_mut().filter(|cyclic| cyclic.next <= now) {
            *next = after(*next, *period);
            let mut on_way = sending.iter().chain(waiting.iter());
            if !on_way.any(|outgoing| outgoing.is_cyclic && outgoing.frame.id() == frame.id()) {
                let deadline = after(now, PATIENCE);
                waiting.push(Outgoing { frame: *frame, deadline, ticket: None, is_cyclic: true, withdrawal: LATE });
            }
        }
    }

    /// Hands the most urgent frame to the controller; among equally urgent frames, the oldest.
    fn load(&mut self, world: &mut World) {
        if self.sending.is_some() || !world.client_port(self.port).can_delay() {
            return;
        }
        let urgency = |(place, outgoing): &(usize, &Outgoing)| (outgoing.frame.arbitration(), *place);
        let Some((next, _)) = self.waiting.iter().enumerate().min_by_key(urgency) else { return };
        let outgoing = self.waiting.remove(next);
        world.send(self.port, outgoing.frame);
        self.sending = Some(outgoing);
    }

    /// Drops the result of a command; the frame is still sent.
    pub(super) fn forget(&mut self, ticket: Ticket) {
        for outgoing in self.sending.iter_mut().chain(&mut self.waiting) {
            outgoing.ticket.take_if(|known| *known == ticket);
        }
    }

    /// Returns the next time after `now` at which the sender must be polled.
    pub(super) fn due(&self, now: Instant) -> Instant {
        let deadlines = self.sending.iter().chain(&self.waiting).map(|outgoing| outgoing.deadline);
        let repeats = self.cyclic.iter().map(|cyclic| cyclic.next);
        deadlines.chain(repeats).filter(|due| *due > now).min().unwrap_or(NEVER)
    }

    /// Returns the latest deadline of the pending commands, if any. A frame still on the wire after its deadline has no
    /// time limit.
    pub(super) fn advance_limit(&self, now: Instant) -> Option<Instant> {
        let awaited = self.sending.iter().chain(&self.waiting).filter(|outgoing| outgoing.ticket.is_some());
        awaited.map(|outgoing| if outgoing.deadline > now { outgoing.deadline } else { NEVER }).max()
    }

    /// Returns whether no frame is pending and no cyclic frame is active.
    pub(super) const fn is_idle(&self) -> bool {
        self.sending.is_none() && self.waiting.is_empty() && self.cyclic.is_empty()
    }
}

impl Outgoing {
    fn refuse(self, reason: &str, completed: &mut Completed) {
        if let Some(ticket) = self.ticket {
            completed.push((ticket, Err(Refusal::Conflict(reason.to_owned()))));
        }
    }
}
