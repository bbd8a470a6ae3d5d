//! The handling of received frames, service by service.

use super::listening::Service;
use super::object::{NodeObject, Object};
use super::objects::number;
use super::product::{Product, Rules};
use super::{Demand, Node};
use crate::canopen::dictionary::Entries;
use crate::canopen::lss::{self, Identity};
use crate::canopen::nmt::{NmtSlave, Reset};
use crate::canopen::pdo::AtSync;
use crate::canopen::sdo_server::Step;
use crate::frame::Frame;
use crate::outcome::Outcome;
use crate::time::Instant;
use crate::wire::emcy::Emcy;
use crate::wire::lss::Request;
use crate::wire::nmt::{self, Command, State, Target};
use crate::wire::sdo::AbortCode;

/// The demand that a frame causes, if any.
type Served<P> = Option<Demand<<P as Product>::Task>>;

impl<P: Product> Node<P> {
    /// Returns the service that handles a frame.
    #[inline]
    pub(crate) fn service(&self, frame: &Frame) -> Option<Service> {
        self.listening.service(frame)
    }

    /// Handles a frame for a service. Returns the resulting demand on the device.
    #[inline]
    pub(crate) fn handle(&mut self, service: Service, frame: &Frame, product: &mut P, now: Instant) -> Served<P> {
        if frame.is_remote() {
            return None;
        }
        match service {
            Service::Rpdo => self.serve_rpdo(frame, product, now),
            Service::Nmt => return self.serve_nmt(frame, product, now),
            Service::Sync => self.serve_sync(product, now),
            Service::Sdo => return self.serve_sdo(frame, product, now),
            Service::EmcyConsumer => self.serve_emcy(frame, product, now),
            Service::Lss => return self.serve_lss(frame, product, now),
            Service::OtherProtocol => {}
        }
        None
    }

    /// Returns the reset that an NMT command requests; `None` for other commands and other frames.
    pub(crate) fn reset_demanded(&self, frame: &Frame) -> Option<Reset> {
        if self.listening.service(frame) != Some(Service::Nmt) {
            return None;
        }
        nmt::parse(frame.data()).and_then(|(command, _)| Reset::of(command))
    }

    fn serve_nmt(&mut self, frame: &Frame, product: &mut P, now: Instant) -> Served<P> {
        let (command, target) = nmt::parse(frame.data())?;
        if target != Target::All && self.objects.node_id.map(Target::Node) != Some(target) {
            return None;
        }
        match self.nmt.execute(command) {
            Outcome::Demand(reset) => {
                self.leave_bus();
                return Some(Demand::Reset(reset));
            }
            Outcome::Done(entered) => {
                self.entered(entered, product, now);
                if entered == State::Stopped {
                    self.pending.drop_emcys(self.objects.emcy.key());
                }
            }
            Outcome::Nothing => {}
        }
        self.starts_itself = false;
        if command == Command::Start {
            self.lss.start(&P::RULES.lss);
        }
        None
    }

    /// Enters a state without an NMT command.
    pub(super) fn enter_by_itself(&mut self, state: State, product: &mut P, now: Instant) {
        self.starts_itself = false;
        if self.nmt.enter(state) {
            self.entered(state, product, now);
        }
        if state == State::Operational {
            self.lss.start(&P::RULES.lss);
        }
    }

    /// Handles the entry into an NMT state.
    fn entered(&mut self, state: State, product: &mut P, now: Instant) {
        // A heartbeat already in the controller carries the previous state.
        self.pending.renew_heartbeat();
        match state {
            State::Operational => self.objects.tpdo.restart(now),
            State::Stopped => {
                self.sdo.cancel();
                self.pending.clear_tpdo();
                product.stopped(now);
            }
            State::PreOperational | State::Initialising => self.pending.clear_tpdo(),
        }
    }

    /// Stops communication until the restart. Queued answers and EMCYs are still sent.
    fn leave_bus(&mut self) {
        self.nmt = NmtSlave::new();
        self.starts_itself = false;
        self.sdo.cancel();
        self.objects.heartbeat.stop();
        self.pending.clear_heartbeat();
        self.pending.clear_tpdo();
    }

    fn serve_sync(&mut self, product: &P, now: Instant) {
        if !self.nmt.is_operational() {
            return;
        }
        let at_sync = self.objects.tpdo.sync();
        if at_sync == AtSync::Nothing || self.is_mute() {
            return;
        }
        let sample = self.sample_when_due(product, now);
        // A pending TPDO must not carry the data of an earlier SYNC.
        if at_sync == AtSync::Due || self.pending.has_tpdo() || self.objects.tpdo.has_changed(sample) {
            self.pending.queue_tpdo(sample);
        }
    }

    fn serve_emcy(&mut self, frame: &Frame, product: &mut P, now: Instant) {
        if let Some(bytes) = frame.eight()
            && self.nmt.serves()
        {
            product.consume_emcy(Emcy::parse(bytes), now);
        }
    }

    fn serve_rpdo(&mut self, frame: &Frame, product: &mut P, now: Instant) {
        if !self.nmt.is_operational() {
            return;
        }
        let Some(values) = self.objects.rpdo.unpack(frame) else { return };
        let own = values.filter_map(|(position, raw)| match P::DICTIONARY.behind(position) {
            Some(Object::Product(object)) => Some((object, raw)),
            _ => None,
        });
        product.receive(own, now);
        if self.objects.tpdo.is_event_driven() {
            self.queue_tpdo(product, now);
        }
    }

    fn serve_sdo(&mut self, frame: &Frame, product: &mut P, now: Instant) -> Served<P> {
        let bytes = frame.eight().filter(|_| self.nmt.serves())?;
        let objects = P::DICTIONARY.entries();
        let answer = match self.sdo.handle(bytes, objects, now) {
            Step::Nothing => return None,
            Step::Answer(answer) => answer,
            Step::Read(place) => self.sdo.uploaded(place, self.objects.read(place, product, now), now),
            Step::Write { place, value, done } => {
                let written = match P::DICTIONARY.behind(place.position) {
                    Some(Object::Product(object)) => product.write(object, value, now).map(|()| self.renew_tpdo()),
                    Some(Object::Node(object)) => {
                        let number = number(value);
                        self.write_own((object, place.entry.sub()), number, &P::RULES, objects, now)
                    }
                    Some(Object::Signature(task)) => {
                        if value.number() == Some(place.entry.number()) {
                            self.sdo.wait(place, done);
                            return Some(Demand::Task(task));
                        }
                        Err(AbortCode::CANNOT_STORE)
                    }
                    _ => Err(AbortCode::READ_ONLY),
                };
                self.sdo.written(place, done, written)
            }
        };
        self.answer_sdo(answer);
        None
    }

    /// Writes an object of the node, and applies new identifiers. Drops the pending frames of a service that the write
    /// switched off.
    fn write_own(
        &mut self,
        object: (NodeObject, u8),
        number: u32,
        rules: &Rules,
        objects: Entries,
        now: Instant,
    ) -> Result<(), AbortCode> {
        let emcys = self.objects.emcy.key();
        self.objects.write_own(object, number, rules, objects, now)?;
        if object.0.is_cob_id() {
            self.listening.update(&self.objects, rules);
        }
        // The identifier of the TPDO changes only while the TPDO is off.
        if self.objects.tpdo.key().is_none() {
            self.pending.clear_tpdo();
        }
        if emcys.is_some() && emcys != self.objects.emcy.key() {
            self.pending.drop_emcys(emcys);
        }
        if self.objects.heartbeat.time() == 0 {
            self.pending.clear_heartbeat();
        }
        Ok(())
    }

    /// Handles an LSS request, in every NMT state except operational. A node without a node ID is in initialisation.
    fn serve_lss(&mut self, frame: &Frame, product: &P, now: Instant) -> Served<P> {
        let bytes = frame.eight().filter(|_| !self.nmt.is_operational())?;
        let identity = Identity { address: product.identity(), node_id: self.objects.node_id, bit_rate: self.bit_rate };
        let outcome = self.lss.handle(Request::parse(bytes), identity, &P::RULES.lss, now);
        if self.lss.is_silent() {
            // The node is silent until the end of the second delay.
            self.pending.silence();
        }
        match outcome {
            Outcome::Nothing => None,
            Outcome::Done(answer) => {
                self.answer_lss(answer);
                None
            }
            Outcome::Demand(lss::Demand::Store) => {
                self.lss_stores = self.lss_stores.saturating_add(1);
                self.to_store = self.lss.unstored().or(self.to_store);
                Some(Demand::StoreConfiguration)
            }
            Outcome::Demand(lss::Demand::Boot) => {
                self.leave_bus();
                Some(Demand::Reset(Reset::Communication))
            }
            Outcome::Demand(lss::Demand::Restart(node_id)) => {
                self.activated = Some(node_id);
                self.leave_bus();
                Some(Demand::Reset(Reset::Application))
            }
        }
    }
}
