//! The ISOBUS node, which combines the product-independent services (SPEC 5).
//!
//! ```text
//! mod       interface: frames to send, time, bus state
//! groups    identifiers of received frames
//! messages  kinds of pending messages
//! serve     handling of received frames
//! ```
//!
//! When the controller can take a frame, the node encodes the most urgent pending message. A new message replaces an
//! older message of its kind. The controller aborts the older message.

mod groups;
mod messages;
mod serve;

pub use groups::Service;
pub use serve::Indication;

use groups::Groups;
use heapless::Vec;
use messages::{Message, MessageSet};

use super::Outcome;
use super::address::AddressClaim;
use super::diagnostics::{Dm1, next_in_grid, single};
use super::transport::{BamReceiver, BamSender};
use crate::answers::Answers;
use crate::controller::{Filter, Filters};
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER};
use crate::wire::dm::{self, Trouble};
use crate::wire::j1939_id::{Address, J1939Id, Pgn, Priority};
use crate::wire::name::{COMMANDED_ADDRESS_LEN, Name};

/// The number of senders from which the node can receive a commanded address at the same time.
const SENDERS: usize = 16;

/// The groups that the node receives as multi-packet broadcasts.
const BROADCASTS: &[Pgn] = &[Pgn::COMMANDED_ADDRESS];

/// The rules of a product for its node.
#[derive(Debug)]
pub struct Rules {
    /// Returns the command group of a node with this address.
    pub command: fn(Address) -> Pgn,
    /// Returns the filter for the product's protocol other than J1939. The identifiers of its frames end in the address
    /// of the node.
    pub other_protocol: fn(Address) -> Filter,
    /// Returns the group of the cyclic report of a node with this address.
    pub report: fn(Address) -> Pgn,
    /// The period of the report. The first report is sent at the end of the wait after the claim. The report has the
    /// most urgent identifier of all messages of the node.
    pub report_period: Duration,
}

/// The data that a product supplies for the messages of its node.
pub trait Product {
    /// Returns the data of the report at `now`.
    fn report(&self, now: Instant) -> [u8; 8];

    /// Returns the previously active trouble codes, in the order of DM2.
    fn previously_active(&self) -> impl Iterator<Item = Trouble> + Clone;
}

/// An ISOBUS node with up to `DM2` bytes in its DM2.
#[derive(Clone, Debug)]
pub struct Node<const DM2: usize> {
    rules: &'static Rules,
    groups: Groups,
    claim: AddressClaim,
    dm1: Dm1,
    bam: BamSender<DM2>,
    receiver: BamReceiver<SENDERS, COMMANDED_ADDRESS_LEN>,
    report: J1939Id,
    next_report: Instant,
    bus_off: bool,
    /// The messages that bus state and claim permit.
    permitted: MessageSet,
    pending: MessageSet,
    /// The messages whose frames the controller may hold.
    in_controller: MessageSet,
    /// The filters for frames that the controller must no longer send.
    aborts: Vec<Filter, { Message::ALL.len() }>,
    answers: Answers,
    dropped: u32,
    deadline: Instant,
}

impl<const DM2: usize> Node<DM2> {
    /// Creates a node that begins to claim its address.
    #[must_use]
    pub fn new(rules: &'static Rules, name: Name, own: Address) -> Self {
        Self {
            rules,
            groups: Groups::at(own, rules),
            claim: AddressClaim::new(name, own),
            dm1: Dm1::new(),
            bam: BamSender::new(),
            receiver: BamReceiver::new(BROADCASTS),
            report: J1939Id::global(Priority::CONTROL, (rules.report)(own), own),
            next_report: NEVER,
            bus_off: false,
            permitted: MessageSet::CLAIM,
            pending: MessageSet::CLAIM,
            in_controller: MessageSet::EMPTY,
            aborts: Vec::new(),
            answers: Answers::default(),
            dropped: 0,
            deadline: NEVER,
        }
    }

    /// Restarts the node with this NAME and address, as after power-up. A running broadcast is abandoned. The bus state
    /// and the count of dropped frames stay.
    pub fn restart(&mut self, name: Name, own: Address) {
        self.give_up_all(MessageSet::EMPTY);
        let Self { bus_off, dropped, .. } = *self;
        *self = Self::new(self.rules, name, own);
        self.bus_off = bus_off;
        self.dropped = dropped;
        self.permit();
    }

    /// Returns the address that the node has claimed or is claiming; `None` after its loss.
    #[inline]
    #[must_use]
    pub const fn address(&self) -> Option<Address> {
        self.claim.address()
    }

    /// Returns the address if messages other than claims may be sent.
    #[inline]
    #[must_use]
    pub const fn voice(&self) -> Option<Address> {
        if self.claim.may_send() && !self.bus_off { self.claim.address() } else { None }
    }

    /// Returns the number of answers and messages that were dropped or abandoned.
    #[must_use]
    pub const fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Sets whether the controller is bus-off. Bus-off drops all answers, and all pending messages except DM1 and claims.
    /// These report the state at the time of their transmission.
    pub fn set_bus_off(&mut self, bus_off: bool) {
        if bus_off && !self.bus_off {
            self.give_up_all(MessageSet::LASTING);
        }
        self.bus_off = bus_off;
        self.permit();
        self.schedule();
    }

    /// Sets the active trouble code of DM1. A change queues DM1.
    pub fn set_active(&mut self, active: Option<Trouble>, now: Instant) {
        let outcome = self.dm1.set(active, if self.bus_off { NEVER } else { now });
        self.note(outcome, Message::Dm1);
        self.schedule();
    }

    /// Queues an answer. If the queue is full or the node may not send, the answer is dropped and counted.
    pub fn answer(&mut self, frame: Frame) {
        if self.voice().is_none() || !self.answers.push(frame) {
            self.count_dropped(1);
        }
    }

    /// Handles the timers that are due.
    pub fn run_timers(&mut self, now: Instant) {
        match self.claim.poll(now) {
            Outcome::Claimed => {
                self.next_report = now;
                self.permit();
            }
            outcome => self.note(outcome, Message::Claim),
        }
        if now >= self.next_report {
            self.queue(Message::Report);
            self.next_report = next_in_grid(self.next_report, self.rules.report_period, now);
        }
        let outcome = self.dm1.poll(now);
        self.note(outcome, Message::Dm1);
        if now >= self.bam.deadline() {
            self.continue_broadcast(now);
        }
        self.schedule();
    }

    /// Returns the time at which [`run_timers`](Self::run_timers) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Returns the filters for the controller, once after every start.
    #[inline]
    pub fn take_filters(&mut self) -> Option<Filters> {
        self.groups.take_filters()
    }

    /// Returns a filter for frames that the controller must no longer send.
    #[inline]
    pub fn take_abort(&mut self) -> Option<Filter> {
        self.aborts.pop()
    }

    /// Encodes the most urgent pending message or answer.
    #[inline]
    pub fn next_frame(&mut self, now: Instant, product: &impl Product) -> Option<Frame> {
        if self.has_frame() { self.render_first(now, product) } else { None }
    }

    /// Requeues a frame that the controller returned. A frame that may no longer be sent is dropped.
    pub fn give_back(&mut self, frame: Frame) {
        match self.message_of(&frame) {
            Some(message) if self.in_controller.contains(message) => {
                self.in_controller.remove(message);
                self.pending.insert(message);
                if message == Message::Packet {
                    self.bam.take_back();
                }
            }
            None if self.voice().is_some() => {
                let had_room = self.answers.take_back(frame);
                self.count_dropped(u32::from(!had_room));
            }
            // The frame is outdated.
            _ => {}
        }
    }

    /// Records that the controller has sent all its frames by `now`.
    pub fn all_sent(&mut self, now: Instant) {
        self.note_sent(self.in_controller, now);
        self.answers.sent();
    }

    /// Records that the controller has sent the messages that it no longer holds by `now`. The answers stay, because
    /// several may have one identifier.
    pub fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, now: Instant) {
        let mut sent = self.in_controller;
        for message in Message::ALL {
            if sent.contains(message) && is_held(Filter::exactly(self.key_of(message))) {
                sent.remove(message);
            }
        }
        self.note_sent(sent, now);
    }

    fn note_sent(&mut self, sent: MessageSet, now: Instant) {
        if sent.contains(Message::Claim) {
            self.claim.sent(now);
        }
        if sent.contains(Message::Packet) {
            self.bam.sent(now);
        }
        if sent.contains(Message::Dm1) && self.dm1.sent() == Outcome::Pending {
            self.pending.insert(Message::Dm1);
        }
        self.in_controller = self.in_controller.without(sent);
        self.schedule();
    }

    /// Returns the trouble code in the last DM1 on the bus. Returns `None` while a DM1 is unsent.
    #[must_use]
    pub fn reported(&self) -> Option<Trouble> {
        let on_the_bus = !self.in_controller.contains(Message::Dm1) && !self.pending.contains(Message::Dm1);
        self.dm1.rendered().filter(|_| on_the_bus)
    }

    /// Updates the permitted messages, after a change of bus state or claim.
    fn permit(&mut self) {
        self.permitted = match self.bus_off {
            true => MessageSet::EMPTY,
            false if self.claim.may_send() => MessageSet::ALL,
            false => MessageSet::CLAIM,
        };
    }

    /// Returns the pending messages that may be sent.
    #[inline]
    const fn sendable(&self) -> MessageSet {
        self.pending.intersection(self.permitted)
    }

    /// Returns whether a frame can be sent now.
    #[inline]
    #[must_use]
    pub fn has_frame(&self) -> bool {
        !self.sendable().is_empty() || !self.answers.is_empty()
    }

    // `inline(never)` saves 20 instructions on a claim and on an AVEF.
    #[inline(never)]
    fn render_first(&mut self, now: Instant, product: &impl Product) -> Option<Frame> {
        if !self.answers.is_empty() {
            return self.render_among_answers(now, product);
        }
        let message = self.sendable().first()?;
        self.render(now, product, message)
    }

    /// Encodes the most urgent of the pending messages and answers. All of them are data frames with 29-bit
    /// identifiers, so their keys can be compared.
    fn render_among_answers(&mut self, now: Instant, product: &impl Product) -> Option<Frame> {
        let before_answers =
            |message: &Message| self.answers.first().is_none_or(|answer| self.key_of(*message) < answer.key());
        match self.sendable().first().filter(before_answers) {
            Some(message) => self.render(now, product, message),
            None => self.answers.pop(),
        }
    }

    fn render(&mut self, now: Instant, product: &impl Product, message: Message) -> Option<Frame> {
        match message {
            Message::Report => {
                self.hand_out(Message::Report);
                Some(Frame::full(self.report.id(), product.report(now)))
            }
            Message::Claim => {
                self.hand_out(Message::Claim);
                Some(self.claim.frame())
            }
            Message::Dm1 => self.render_dm1(now),
            Message::Dm2 => self.render_dm2(now, product),
            Message::Packet => self.render_packet(),
        }
    }

    fn render_dm1(&mut self, now: Instant) -> Option<Frame> {
        self.hand_out(Message::Dm1);
        let frame = self.dm1.render(self.own(), now);
        self.schedule();
        Some(frame)
    }

    /// Encodes DM2: a single frame for at most one trouble code, otherwise the announcement of a broadcast, even if the
    /// request was addressed (R).
    // `inline(never)` saves 11 instructions on a claim, 10 on an AVEF.
    #[inline(never)]
    fn render_dm2(&mut self, now: Instant, product: &impl Product) -> Option<Frame> {
        let mut codes = product.previously_active();
        let all = codes.clone();
        match (codes.next(), codes.next()) {
            (one, None) => {
                self.hand_out(Message::Dm2);
                Some(single(Pgn::DM2, one, self.own()))
            }
            _ => {
                self.pending.remove(Message::Dm2);
                // Cannot fail, because no broadcast is running and two codes exceed the minimum size.
                let _ = self.bam.start(Pgn::DM2, dm::payload(all), now);
                self.render_packet()
            }
        }
    }

    fn render_packet(&mut self) -> Option<Frame> {
        self.hand_out(Message::Packet);
        let frame = self.bam.render(self.own());
        self.schedule();
        frame
    }

    const fn hand_out(&mut self, message: Message) {
        self.pending.remove(message);
        self.in_controller.insert(message);
    }

    /// Returns the source address of sent frames: after the loss of the address, the null address.
    #[inline]
    fn own(&self) -> Address {
        self.claim.address().unwrap_or(Address::NULL)
    }

    #[inline]
    fn key_of(&self, message: Message) -> u32 {
        let global = |priority, pgn| J1939Id::global(priority, pgn, self.own()).key();
        match message {
            Message::Report => self.report.key(),
            Message::Claim => global(Priority::DEFAULT, Pgn::ADDRESS_CLAIMED),
            Message::Dm1 => global(Priority::DEFAULT, Pgn::DM1),
            Message::Dm2 => global(Priority::DEFAULT, Pgn::DM2),
            Message::Packet => global(Priority::TRANSPORT, self.bam.pgn()),
        }
    }

    /// Returns the message that a frame returned by the controller carries. Returns `None` for an answer and, after the
    /// loss of the address, for every frame except a cannot-claim.
    fn message_of(&self, frame: &Frame) -> Option<Message> {
        Message::ALL.into_iter().find(|message| self.key_of(*message) == frame.key())
    }

    fn schedule(&mut self) {
        let diagnostics = self.dm1.deadline().min(self.bam.deadline());
        self.deadline = self.claim.deadline().min(self.next_report).min(diagnostics);
    }
}
