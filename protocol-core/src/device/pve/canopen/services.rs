//! What each service does with a frame (SPEC 4.2, 4.4, 7).

use super::super::identification::Identification;
use super::super::objects::{Command, PveObjects, StoreRequest};
use super::super::records::LayerChange;
use super::super::state_machine::DeviceState;
use super::PveCanopen;
use super::listening::{Listening, Service};
use super::storing::{Job, LayerFor};
use crate::canopen::lss::{Identity, Outcome};
use crate::canopen::nmt::Order;
use crate::device::Restart;
use crate::frame::{Frame, Id, standard};
use crate::time::Instant;
use crate::uds::{Reaction, node_id_written, serve};
use crate::wire::cob_id::{Function, LSS_ANSWER, NodeId};
use crate::wire::emcy::{Emcy, GENERIC_ERROR};
use crate::wire::nmt::{self, Command as NmtCommand, State, Target};
use crate::wire::sdo::{AbortCode, Answer};
use crate::wire::{lss, uds};

impl PveCanopen {
    pub(super) fn serve(&mut self, service: Service, frame: &Frame, now: Instant) {
        match service {
            Service::Nmt => self.serve_nmt(frame, now),
            Service::Sync => self.serve_sync(),
            Service::EmcyConsumer => self.serve_emcy(frame, now),
            Service::Rpdo => self.serve_rpdo(frame, now),
            Service::Sdo => self.serve_sdo(frame, now),
            Service::Lss => self.serve_lss(frame, now),
            Service::Uds => self.serve_uds(frame),
        }
    }

    pub(super) fn send_sdo(&mut self, answer: Answer) {
        if let Some(node_id) = self.objects.node_id {
            self.send(Frame::full(node_id.id(Function::SdoAnswer).into(), answer.emit()));
        }
    }

    pub(super) fn send_lss(&mut self, answer: lss::Answer) {
        self.send(Frame::full(standard(LSS_ANSWER).into(), answer.emit()));
    }

    fn serve_nmt(&mut self, frame: &Frame, now: Instant) {
        let Some((command, target)) = nmt::parse(frame.data()) else { return };
        if !(target == Target::All || self.objects.node_id.map(Target::Node) == Some(target)) {
            return;
        }
        match self.nmt.obey(command) {
            Order::ResetApplication => self.request_restart(Restart::Application, None),
            Order::ResetCommunication => self.request_restart(Restart::Communication, None),
            Order::Entered { to: State::Operational, .. } => self.objects.tpdo.restart_sync_count(),
            Order::Entered { to: State::Stopped, .. } => {
                self.sdo.cancel();
                self.emcys.clear();
                self.objects.application.shut_down(now);
            }
            Order::Entered { .. } | Order::Nothing => {}
        }
        if command == NmtCommand::Start {
            self.lss.started();
        }
    }

    fn serve_sync(&mut self) {
        if self.nmt.is_operational() && self.objects.tpdo.sync() {
            self.send_tpdo();
        }
    }

    /// An EMCY with a generic error from the configured node is an emergency stop (SPEC 4.2).
    fn serve_emcy(&mut self, frame: &Frame, now: Instant) {
        let Some(bytes) = frame.eight() else { return };
        let active = self.objects.application.state() == DeviceState::Active;
        if self.nmt.serves() && active && Emcy::parse(bytes).code == GENERIC_ERROR {
            self.objects.application.shut_down(now);
        }
    }

    /// Of one RPDO: mode first, then control word, then set-point, whatever the mapping's order; what is invalid is
    /// dropped, the rest acts (SPEC 4.1).
    fn serve_rpdo(&mut self, frame: &Frame, now: Instant) {
        if !self.nmt.is_operational() {
            return;
        }
        let Some(values) = self.objects.rpdo.unpack(frame) else { return };
        let (mut mode, mut control, mut set_point) = (None, None, None);
        for (object, raw) in values {
            match PveObjects::command(object, raw) {
                Ok(Command::Mode(value)) => mode = Some(value),
                Ok(Command::Control(value)) => control = Some(value),
                Ok(Command::SetPoint(value)) => set_point = Some(value),
                Err(_) => {}
            }
        }
        let application = &mut self.objects.application;
        if let Some(mode) = mode {
            application.set_mode(mode, now);
        }
        if let Some(word) = control {
            application.control(word, now);
        }
        if let Some(set_point) = set_point {
            application.accept(set_point, now);
        }
        self.report_faults(now);
        if self.objects.tpdo.is_event_driven() {
            self.send_tpdo();
        }
    }

    fn send_tpdo(&mut self) {
        let objects = &self.objects;
        let frame = objects.tpdo.pack(|object| objects.feedback(object.index));
        if let Some(frame) = frame {
            self.send(frame);
        }
    }

    fn serve_sdo(&mut self, frame: &Frame, now: Instant) {
        if !self.nmt.serves() {
            return;
        }
        let Some(bytes) = frame.eight() else { return };
        let answer = self.sdo.handle(bytes, &mut self.objects, now);
        let cob_id_written = match answer {
            Some(Answer::DownloadDone(object)) => Listening::depends_on(object.index),
            Some(Answer::DownloadSegmentDone { .. }) => true,
            _ => false,
        };
        if cob_id_written {
            self.listening = Listening::of(&self.objects);
        }
        if let Some(answer) = answer {
            self.send_sdo(answer);
        }
        if let Some(request) = self.objects.store_request.take() {
            self.ticket = self.ticket.wrapping_add(1);
            let job = match request {
                StoreRequest::Save => Job::Save(self.ticket),
                StoreRequest::Load => Job::SetRestoreFlag(self.ticket),
                StoreRequest::ClearCounters => Job::ClearCounters(self.ticket, crate::actuator::FaultSet::EMPTY),
            };
            if !self.storage.ask(job)
                && let Some(abort) = self.sdo.stored(Err(AbortCode::HARDWARE))
            {
                self.send_sdo(abort);
            }
        }
    }

    fn serve_lss(&mut self, frame: &Frame, now: Instant) {
        // Everywhere but in operational; without a node ID the NMT state is initialising.
        if self.nmt.is_operational() {
            return;
        }
        let Some(bytes) = frame.eight() else { return };
        let identity = Identity {
            address: &self.objects.factory.identity,
            node_id: self.objects.node_id,
            bit_rate: self.bit_rate,
            bit_rates: self.objects.kind.bit_rates(),
        };
        match self.lss.handle(lss::Request::parse(bytes), identity, now) {
            Outcome::Nothing => {}
            Outcome::Answer(answer) => self.send_lss(answer),
            Outcome::Store { node_id, bit_rate } => {
                let change = LayerChange {
                    node_id: node_id.or(self.held_node_id).map(NodeId::get),
                    bit_rate: bit_rate.or(self.held_bit_rate),
                };
                let job = Job::LocalLayer(change, LayerFor::Lss);
                if !self.storage.ask(job) {
                    self.send_lss(lss::Answer::Stored(lss::StoreError::Access));
                }
            }
            Outcome::Restart(node_id) => self.request_restart(Restart::Application, Some(node_id)),
            Outcome::Silence => self.tx.clear(),
        }
    }

    fn serve_uds(&mut self, frame: &Frame) {
        let (Id::Extended(id), Some(node_id)) = (frame.id(), self.objects.node_id) else { return };
        let Some((source, _)) = uds::parse_id(id.as_raw()) else { return };
        let identification = Identification {
            kind: self.objects.kind,
            factory: &self.objects.factory,
            local_layer: self.local_layer,
            busy: !self.storage.is_idle(),
        };
        match serve(uds::Address::node(node_id.get()), source, frame.data(), &identification) {
            Reaction::Nothing => {}
            Reaction::Answer(frame) => self.send(frame),
            Reaction::StoreNodeId(raw) => {
                let change = LayerChange { node_id: Some(raw), bit_rate: None };
                if !self.storage.ask(Job::LocalLayer(change, LayerFor::Uds)) {
                    self.send(node_id_written(false));
                }
            }
        }
    }
}
