//! The CANopen node, which combines the product-independent services (CiA 301, CiA 305).
//!
//! ```text
//! mod        interface of the node
//! product    trait of a product
//! object     kinds of objects                    objects      communication objects
//! services   handling of received frames         listening    identifiers of received frames
//! pending    frames to send                      description  objects as an EDS describes them
//! ```
//!
//! The node does not own the product. Functions that need the product take a reference to it.

#[cfg(feature = "names")]
mod description;
mod listening;
mod object;
mod objects;
mod pending;
mod product;
mod services;

#[cfg(feature = "names")]
pub(crate) use description::describe;
pub(crate) use listening::Service;
pub(crate) use object::{ErrorClass, LOAD, NodeObject, Object, PdoParameter, SAVE};
pub(crate) use product::{Product, Rules};

use core::marker::PhantomData;

use heapless::VecView;

use listening::Listening;
use objects::Communication;
use pending::Pending;

use super::dictionary::Group;
use super::lss::{Configuration, LssSlave};
use super::nmt::{NmtSlave, Reset};
use super::parameters::{self, Stored};
use super::pdo::Sample;
use super::sdo_server::{Bytes, SdoServer};
use crate::controller::{BitRate, Filters};
use crate::frame::{Frame, standard};
use crate::time::{Instant, NEVER};
use crate::wire::cob_id::{Function, LSS_ANSWER, NodeId};
use crate::wire::emcy::Emcy;
use crate::wire::lss::{self, LssNodeId};
use crate::wire::nmt::State;
use crate::wire::pdo_mapping::MappingEntry;
use crate::wire::sdo::AbortCode;

/// An action that the node demands of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Demand<T> {
    /// Execute a task of the product for an SDO client, then call [`Node::end_task`].
    Task(T),
    /// Store the configuration that [`Node::begin_lss_store`] returns, then call [`Node::end_lss_store`].
    StoreConfiguration,
    /// Restart the node.
    Reset(Reset),
}

/// A node on the bus, with the services of CiA 301 and CiA 305.
#[derive(Clone, Debug)]
pub(crate) struct Node<P: Product> {
    objects: Communication,
    nmt: NmtSlave,
    sdo: SdoServer,
    lss: LssSlave,
    listening: Listening,
    pending: Pending,
    /// Whether the controller is bus-off.
    bus_off: bool,
    /// The bit rate in force.
    bit_rate: BitRate,
    /// Set until the platform has taken a new `bit_rate`.
    rate_is_new: bool,
    /// The node ID that takes effect at the restart which LSS has demanded.
    activated: Option<LssNodeId>,
    /// The LSS configuration that is in force but not stored. The node ID lasts until power-off, the bit rate until
    /// reset application.
    held: Configuration,
    /// The number of LSS store requests not yet answered.
    lss_stores: u32,
    /// The configuration at the time of the store request. NMT start drops a pending configuration, but not a requested
    /// store (A).
    to_store: Configuration,
    /// Whether the node enters operational by itself once boot-up and EMCYs are sent. An NMT command before that
    /// cancels the automatic start (A).
    starts_itself: bool,
    product: PhantomData<P>,
}

impl<P: Product> Node<P> {
    /// Creates a node that has not started.
    pub(crate) const fn new() -> Self {
        Self {
            objects: Communication::new(const { &P::RULES.heartbeat }),
            nmt: NmtSlave::new(),
            sdo: SdoServer::new(),
            lss: LssSlave::new(),
            listening: Listening::NOTHING,
            pending: Pending::new(),
            bus_off: false,
            bit_rate: BitRate::Kbit250,
            rate_is_new: false,
            activated: None,
            held: Configuration::NONE,
            lss_stores: 0,
            to_store: Configuration::NONE,
            starts_itself: false,
            product: PhantomData,
        }
    }

    /// Begins a start: resets the communication, and applies the node ID that LSS has configured, or else the stored
    /// node ID. Returns the node ID in force.
    ///
    /// Reset application also applies the stored bit rate and clears the error history. Reset communication does not
    /// end a bit-rate activation.
    pub(crate) fn reset(&mut self, scope: Reset, stored: Configuration) -> Option<NodeId> {
        self.held.node_id = self.activated.take().or(self.held.node_id);
        match scope {
            Reset::Communication => {
                self.held.node_id = self.lss.pending_node_id().or(self.held.node_id);
                self.lss.end_configuration();
            }
            Reset::Application => {
                self.lss.restart();
                self.lss_stores = 0;
                self.to_store = Configuration::NONE;
                self.held.bit_rate = None;
                self.rate_is_new = false;
                self.bit_rate = stored.bit_rate.unwrap_or(self.bit_rate);
                self.objects.history.clear();
            }
        }
        self.held.node_id = self.held.node_id.filter(|held| Some(*held) != stored.node_id);
        self.objects.node_id = self.held.node_id.or(stored.node_id).and_then(|node_id| node_id.0);
        self.nmt = NmtSlave::new();
        self.starts_itself = false;
        self.sdo.cancel();
        self.pending.clear();
        self.objects.node_id
    }

    /// Completes a start: loads the parameters of each group and boots. Reset communication does not load the product's
    /// own objects. A node without a node ID stays in initialisation, and serves only LSS.
    pub(crate) fn boot<const GROUPS: usize>(
        &mut self,
        scope: Reset,
        parameters: [(Group, Option<Stored<'_>>); GROUPS],
        product: &mut P,
        now: Instant,
    ) {
        if let Some(node_id) = self.objects.node_id {
            self.objects.emcy.load(node_id.raw_id(Function::Emcy).into());
        }
        for group in parameters {
            self.objects.load(scope, group, product);
        }
        self.objects.start_pdos(&P::RULES, P::DICTIONARY.entries());
        self.listening = Listening::of(&self.objects, &P::RULES);
        if self.objects.node_id.is_some() {
            self.nmt.boot();
            self.objects.heartbeat.boot(now);
            self.pending.queue_boot_up();
            self.starts_itself = P::RULES.nmt.starts_itself == Some(self.objects.startup);
        }
    }

    /// Enters operational if 0x1F80 demands it and boot-up and all pending EMCYs are sent.
    #[inline]
    pub(crate) fn start_itself(&mut self, product: &mut P, now: Instant) {
        if self.starts_itself && self.pending.start_is_sent() {
            self.enter_by_itself(State::Operational, product, now);
        }
    }

    /// Applies the error behaviour (0x1029) of a node in operational. Pending EMCYs are still sent.
    pub(crate) fn apply_error_behaviour(&mut self, class: ErrorClass, product: &mut P, now: Instant) {
        if self.nmt.is_operational()
            && let Some(state) = self.objects.error_behaviour.of(class).state()
        {
            self.enter_by_itself(state, product, now);
        }
    }

    /// Handles the timers that are due.
    pub(crate) fn poll(&mut self, product: &P, now: Instant) {
        if let Some(switch) = self.lss.poll(now) {
            self.bit_rate = switch.bit_rate;
            self.rate_is_new = true;
            if switch.unstored {
                self.held.bit_rate = Some(switch.bit_rate);
            }
        }
        if let Some(abort) = self.sdo.poll(now) {
            self.answer_sdo(abort);
        }
        if self.objects.heartbeat.poll(now) && !self.is_mute() {
            self.pending.queue_heartbeat();
        }
        if P::RULES.tpdo.timers
            && self.nmt.is_operational()
            && let Some(at) = self.objects.tpdo.poll(now)
        {
            self.queue_tpdo(product, at);
        }
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    pub(crate) fn deadline(&self) -> Instant {
        let runs = P::RULES.tpdo.timers && self.nmt.is_operational();
        let tpdo = if runs { self.objects.tpdo.deadline() } else { NEVER };
        self.objects.heartbeat.deadline().min(self.sdo.deadline()).min(self.lss.deadline()).min(tpdo)
    }

    /// Records whether the controller is bus-off. At bus-off the controller drops its frames. The node then drops all
    /// answers not known to be sent, and counts them. It also drops the heartbeat and the TPDO, which are not counted.
    /// All EMCYs and the boot-up are requeued unless they are known to be sent. The NMT state does not change (A); a
    /// product with 0x1029 calls [`apply_error_behaviour`](Self::apply_error_behaviour).
    pub(crate) fn set_bus_off(&mut self, bus_off: bool) {
        if bus_off && !self.bus_off {
            self.pending.on_bus_off();
            self.objects.tpdo.lost();
        }
        self.bus_off = bus_off;
    }

    /// Returns a new bit rate, once.
    #[inline]
    pub(crate) fn take_bit_rate(&mut self) -> Option<BitRate> {
        if !self.rate_is_new {
            return None;
        }
        self.rate_is_new = false;
        Some(self.bit_rate)
    }

    /// Queues an EMCY without a history entry, for the end or the repetition of an error.
    pub(crate) fn send_emcy(&mut self, message: Emcy) {
        self.queue_emcy(message, false);
    }

    /// Queues an EMCY, unless the NMT state or 0x1014 forbids EMCYs.
    fn queue_emcy(&mut self, message: Emcy, entered: bool) {
        if self.nmt.serves() && self.objects.emcy.id().is_some() {
            self.pending.queue_emcy(message, entered);
        }
    }

    /// Returns the [key](Frame::key) of TPDO 1 and its mapped objects; `None` while the TPDO is off.
    pub(crate) fn tpdo(&self) -> Option<(u32, &[MappingEntry])> {
        let tpdo = &self.objects.tpdo;
        Some((tpdo.key()?, tpdo.mapping()))
    }

    /// Replaces a TPDO that the controller may hold, after a change of the mapped values. Has no effect for a product
    /// that samples TPDOs when due.
    pub(crate) fn renew_tpdo(&mut self) {
        if !P::RULES.tpdo.sampled_when_due {
            self.pending.renew_tpdo();
        }
    }

    /// Enters a new error into the history, with `manufacturer` in the upper 16 bits, and queues its EMCY if the NMT
    /// state permits EMCYs. Has no effect while 0x1014 is off or the node has no node ID. Returns whether the error was
    /// entered.
    pub(crate) fn report_error(&mut self, message: Emcy, manufacturer: u16) -> bool {
        let tells = self.objects.node_id.is_some() && self.objects.emcy.id().is_some();
        if tells {
            self.objects.history.enter(message.code, manufacturer);
            self.queue_emcy(message, true);
        }
        tells
    }

    /// Removes the unsent EMCYs that report the beginning and the end of an error, and their history entries (A).
    /// `register` holds the bits of the error in the error register.
    pub(crate) fn withdraw_error(&mut self, code: u16, register: u8) {
        for _ in 0..self.pending.withdraw_emcys(code, register) {
            self.objects.history.withdraw(code);
        }
    }

    /// Queues an answer from a non-CANopen service of the device.
    pub(crate) fn answer(&mut self, answer: Frame) {
        let mute = self.is_mute();
        self.pending.queue_answer(answer, mute);
    }

    /// Answers the SDO client, if any, that waits for this task. The answer is an abort unless `stored`.
    pub(crate) fn end_task(&mut self, task: P::Task, stored: bool) {
        let behind = self.sdo.waits_for().and_then(|place| P::DICTIONARY.behind(place.position));
        let is_awaited = matches!(behind, Some(Object::Signature(awaited)) if awaited == task);
        let result = if stored { Ok(()) } else { Err(AbortCode::HARDWARE) };
        if is_awaited && let Some(answer) = self.sdo.end(result) {
            self.answer_sdo(answer);
        }
    }

    /// Answers the oldest LSS store request. If `is_last`, no further write is pending, and all requests are answered.
    pub(crate) fn end_lss_store(&mut self, stored: bool, is_last: bool) {
        let error = if stored { lss::SUCCESS } else { P::RULES.lss.store_error };
        let answers = if is_last { self.lss_stores } else { self.lss_stores.min(1) };
        self.lss_stores = self.lss_stores.saturating_sub(answers);
        for _ in 0..answers {
            self.answer_lss(lss::Answer::Stored(error));
        }
    }

    /// Returns whether the node must reset communication, because LSS has stored its first node ID and is in waiting.
    pub(crate) fn must_boot(&self) -> bool {
        self.lss.must_boot(self.objects.node_id)
    }

    /// Begins an LSS store. Returns the configuration at the time of the request. Its missing values are the values in
    /// force but not stored, if any.
    pub(crate) fn begin_lss_store(&mut self) -> Configuration {
        core::mem::take(&mut self.to_store).or(self.held)
    }

    /// Records a configuration that LSS or another service has stored.
    pub(crate) fn configuration_stored(&mut self, stored: Configuration) {
        self.lss.stored(stored);
        if stored.node_id.is_some() {
            self.held.node_id = None;
        }
        if stored.bit_rate.is_some() {
            self.held.bit_rate = None;
        }
    }

    /// Appends the present parameters of a group to a payload. Returns `None` if they do not fit.
    pub(crate) fn parameters(&self, group: Group, product: &P, payload: &mut VecView<u8>) -> Option<()> {
        // Parameters do not depend on time.
        let value_of = |place| self.objects.read(place, product, Instant::MIN).ok();
        parameters::encode(P::DICTIONARY.entries(), group, &value_of, payload)
    }

    /// Appends the defaults of all parameters to a payload, for the node ID in force. Returns `None` without a node ID,
    /// or if they do not fit.
    pub(crate) fn default_parameters(&self, product: &P, payload: &mut VecView<u8>) -> Option<()> {
        let value_of = |place| self.objects.default(place, product);
        parameters::encode(P::DICTIONARY.entries(), Group::All, &value_of, payload)
    }

    /// Returns the NMT state.
    pub(crate) const fn nmt_state(&self) -> State {
        self.nmt.state()
    }

    /// Returns whether LSS is changing the bit rate. The node is silent during the change.
    pub(crate) const fn is_switching_bit_rate(&self) -> bool {
        self.lss.is_silent()
    }

    /// Returns the number of history entries of an error.
    pub(crate) fn times_entered(&self, code: u16, manufacturer: u16) -> u8 {
        self.objects.history.times(code, manufacturer)
    }

    /// Returns the node ID in force.
    #[inline]
    pub(crate) const fn node_id(&self) -> Option<NodeId> {
        self.objects.node_id
    }

    /// Returns the bit rate in force.
    pub(crate) const fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    /// Returns the number of frames dropped since the node was created.
    pub(crate) const fn frames_dropped(&self) -> u32 {
        self.pending.dropped()
    }

    /// Returns new filters for the controller, once.
    #[inline]
    pub(crate) fn take_filters(&mut self) -> Option<Filters> {
        self.listening.take_filters()
    }

    /// Queues a TPDO that became due at `at`. Has no effect while the node must not send.
    #[inline]
    fn queue_tpdo(&mut self, product: &P, at: Instant) {
        if !self.is_mute() {
            let sample = self.sample_when_due(product, at);
            self.pending.queue_tpdo(sample);
        }
    }

    /// Samples the mapped objects for a product that samples TPDOs when due. For other products returns
    /// [`Sample::NOTHING`].
    #[inline]
    fn sample_when_due(&self, product: &P, at: Instant) -> Sample {
        if P::RULES.tpdo.sampled_when_due { self.sample_tpdo(product, at) } else { Sample::NOTHING }
    }

    #[inline]
    fn sample_tpdo(&self, product: &P, at: Instant) -> Sample {
        let objects = &self.objects;
        objects.tpdo.sample(|position| objects.sample(position, product, at))
    }

    /// Returns whether the node must not send.
    const fn is_mute(&self) -> bool {
        self.bus_off || self.lss.is_silent()
    }

    fn answer_sdo(&mut self, answer: Bytes) {
        if let Some(node_id) = self.objects.node_id {
            self.answer(Frame::full(node_id.id(Function::SdoAnswer).into(), answer));
        }
    }

    fn answer_lss(&mut self, answer: lss::Answer) {
        self.answer(Frame::full(standard(LSS_ANSWER).into(), answer.emit()));
    }
}
