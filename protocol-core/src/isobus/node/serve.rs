//! The reception of a frame: what each service makes of it, and what the product learns.

use super::Node;
use super::groups::Service;
use super::messages::{Message, MessageSet};
use crate::controller::Filter;
use crate::frame::Frame;
use crate::isobus::Outcome;
use crate::isobus::request::Request;
use crate::isobus::transport::refuse_connection;
use crate::time::{Instant, NEVER};
use crate::wire::j1939_id::{Address, J1939Id, Pgn};
use crate::wire::name::Name;
use crate::wire::request::Control;

/// The indication of a frame to the product.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Indication {
    /// Nothing: the frame was for the node, or for nobody here.
    Nothing,
    /// The frame is one of the product's command group.
    Command,
    /// The frame belongs to the product's non-J1939 protocol, such as UDS.
    OtherProtocol,
    /// DM3 asks to clear the previously active trouble codes; [`Node::acknowledge`] answers.
    ClearPreviouslyActive(Request),
    /// A commanded address is for the node's NAME.
    CommandedAddress(Address),
    /// The address is lost. The node sends nothing more but cannot-claims, and aborts every frame in the controller.
    AddressLost,
}

impl<const DM2: usize> Node<DM2> {
    /// Returns the service that a frame is for, by its identifier alone.
    #[inline]
    #[must_use]
    pub fn service(&self, frame: &Frame) -> Option<Service> {
        self.groups.service(frame)
    }

    /// Takes a frame for one of the services. A remote frame means nothing on ISOBUS.
    #[inline]
    pub fn handle(&mut self, service: Service, frame: &Frame, now: Instant) -> Indication {
        if service != Service::Claim && self.groups.is_foreign_use(frame) {
            self.object(frame, now);
        }
        let id = J1939Id::from_raw(frame.key());
        match service {
            Service::Command => Indication::Command,
            Service::OtherProtocol => Indication::OtherProtocol,
            Service::Request => self.serve_request(id, frame, now),
            Service::Claim => self.serve_claim(id, frame, now),
            Service::Broadcast => self.serve_broadcast(id, frame, now),
            Service::Connection => self.serve_connection(id, frame),
            Service::Objection => Indication::Nothing,
        }
    }

    /// Answers an order that was carried out or could not be: nothing for one to all.
    pub fn acknowledge(&mut self, request: &Request, done: bool) {
        self.respond(request, if done { Control::Positive } else { Control::Negative });
    }

    #[inline(never)]
    fn object(&mut self, frame: &Frame, now: Instant) {
        if !frame.is_remote() {
            let outcome = self.claim.object(now);
            self.note(outcome, Message::Claim);
        }
    }

    #[inline]
    fn serve_request(&mut self, id: J1939Id, frame: &Frame, now: Instant) -> Indication {
        let Some(request) = Request::of(id, frame) else { return Indication::Nothing };
        if request.pgn != Pgn::ADDRESS_CLAIMED {
            return self.serve_other_request(request);
        }
        let outcome = self.claim.requested(&request, now);
        self.note(outcome, Message::Claim);
        if self.claim.is_lost() {
            self.schedule();
        }
        Indication::Nothing
    }

    #[inline(never)]
    fn serve_other_request(&mut self, request: Request) -> Indication {
        if self.voice().is_none() {
            return Indication::Nothing;
        }
        match request.pgn {
            Pgn::DM1 => self.queue(Message::Dm1),
            // Another one during a running broadcast is dropped: its requester hears that one.
            Pgn::DM2 if self.bam.is_busy() => {}
            Pgn::DM2 => self.queue(Message::Dm2),
            Pgn::DM3 => return Indication::ClearPreviouslyActive(request),
            pgn if pgn == self.report.pgn() => self.queue(Message::Report),
            _ => self.respond(&request, Control::Negative),
        }
        Indication::Nothing
    }

    #[inline(never)]
    fn serve_claim(&mut self, id: J1939Id, frame: &Frame, now: Instant) -> Indication {
        let Some(name) = frame.eight().map(|bytes| Name::from_bytes(*bytes)) else { return Indication::Nothing };
        match self.claim.contend(id.source(), name, now) {
            Outcome::Lost => {
                self.give_up_all();
                self.groups.lose();
                // One place is enough: the list was cleared.
                let _ = self.aborts.push(Filter::ALL);
                self.next_report = NEVER;
                self.permit();
                self.schedule();
                Indication::AddressLost
            }
            outcome => {
                self.note(outcome, Message::Claim);
                Indication::Nothing
            }
        }
    }

    #[inline(never)]
    fn serve_broadcast(&mut self, id: J1939Id, frame: &Frame, now: Instant) -> Indication {
        if frame.is_remote() {
            return Indication::Nothing;
        }
        let message = self.receiver.handle(id, frame, now);
        let commanded = message.and_then(|message| self.claim.commanded(&message.payload));
        commanded.map_or(Indication::Nothing, Indication::CommandedAddress)
    }

    #[inline(never)]
    fn serve_connection(&mut self, id: J1939Id, frame: &Frame) -> Indication {
        if let Some(abort) = self.voice().and_then(|own| refuse_connection(id, frame, own)) {
            self.answer(abort);
        }
        Indication::Nothing
    }

    #[inline(never)]
    fn respond(&mut self, request: &Request, control: Control) {
        if let Some(frame) = request.acknowledgement(control, self.own()) {
            self.answer(frame);
        }
    }
}

/// The pending messages.
impl<const DM2: usize> Node<DM2> {
    /// Queues the message of a service that has one.
    #[inline]
    pub(super) fn note(&mut self, outcome: Outcome, message: Message) {
        if outcome == Outcome::Pending {
            self.queue(message);
        }
    }

    /// Queues a message. An older frame of it that waits in the controller must not go out any more.
    ///
    /// In bus-off nothing is pending but DM1, which tells the state of the time when the bus is back.
    pub(super) fn queue(&mut self, message: Message) {
        if self.bus_off && message != Message::Dm1 {
            return;
        }
        self.abort(message);
        self.pending.insert(message);
    }

    /// Lets the controller abort the frame of this message that may wait there.
    #[inline]
    fn abort(&mut self, message: Message) {
        if self.in_controller.contains(message) {
            self.in_controller.remove(message);
            // There is a place for each kind.
            let _ = self.aborts.push(Filter::exactly(self.key_of(message)));
        }
    }

    /// Queues the frame of the running broadcast that is due, or gives up a broadcast that the bus kept waiting.
    pub(super) fn continue_broadcast(&mut self, now: Instant) {
        // The identifier of the frame in the controller, which is forgotten with the broadcast.
        let key = self.key_of(Message::Packet);
        let announced = self.bam.pgn() == Pgn::TP_DATA;
        match self.bam.poll(now) {
            Outcome::GivenUp => {
                self.pending.remove(Message::Packet);
                if self.in_controller.contains(Message::Packet) {
                    self.in_controller.remove(Message::Packet);
                    let _ = self.aborts.push(Filter::exactly(key));
                }
                if announced {
                    self.count_dropped(1);
                } else {
                    // The bus has heard nothing of it: the list as it is now takes its place.
                    self.queue(Message::Dm2);
                }
            }
            outcome => self.note(outcome, Message::Packet),
        }
    }

    /// Forgets all pending messages but DM1, and those that the controller has.
    pub(super) fn give_up_all(&mut self) {
        let dm1 = self.pending.contains(Message::Dm1) || self.in_controller.contains(Message::Dm1);
        self.pending = MessageSet::EMPTY;
        self.in_controller = MessageSet::EMPTY;
        if dm1 {
            self.pending.insert(Message::Dm1);
        }
        self.aborts.clear();
        let dropped = self.answers.clear().saturating_add(u32::from(self.bam.cancel()));
        self.count_dropped(dropped);
    }

    /// Counts answers and messages that were dropped or given up.
    pub const fn count_dropped(&mut self, count: u32) {
        self.dropped = self.dropped.saturating_add(count);
    }
}
