//! What each service does with a frame (SPEC 5, 7).

use super::super::identification::Identification;
use super::super::records::LayerChange;
use super::PveIsobus;
use super::listening::Service;
use super::storing::{Job, LayerFor};
use crate::frame::{Frame, Id};
use crate::isobus::address::Outcome;
use crate::isobus::request::Request;
use crate::time::{Instant, NEVER};
use crate::uds::{Reaction, node_id_written, serve};
use crate::wire::j1939_id::{Address, J1939Id, Pgn};
use crate::wire::name::Name;
use crate::wire::uds;

impl PveIsobus {
    pub(super) fn serve(&mut self, service: Service, frame: &Frame, now: Instant) {
        let Some(id) = J1939Id::of(frame) else { return };
        match service {
            // Taken on a way of its own.
            Service::Avc => {}
            Service::Claim => self.serve_claim(id, frame, now),
            Service::ClaimRequest | Service::Request => self.serve_request(id, frame, now),
            Service::Transport => self.serve_transport(id, frame, now),
            Service::Uds => self.serve_uds(frame),
        }
    }

    fn serve_claim(&mut self, id: J1939Id, frame: &Frame, now: Instant) {
        let Some(name) = frame.eight().map(|bytes| Name::from_bytes(*bytes)) else { return };
        match self.claim.contend(id.source(), name, now) {
            Outcome::Send(frame) => self.send(frame),
            Outcome::Lost => {
                self.next_avef = NEVER;
                self.fall_silent();
                self.commander.block(now);
            }
            Outcome::Nothing | Outcome::Claimed => {}
        }
    }

    fn serve_request(&mut self, id: J1939Id, frame: &Frame, now: Instant) {
        let Some(request) = Request::of(id, frame, self.claim.address()) else { return };
        if let Outcome::Send(claim) = self.claim.requested(&request, now) {
            self.send(claim);
        }
        let Some(own) = self.claim.address() else { return };
        if !self.claim.may_send() {
            return;
        }
        match request.pgn {
            Pgn::ADDRESS_CLAIMED => {}
            Pgn::DM1 => self.send(self.dm1.frame(own)),
            Pgn::DM2 => self.send_dm2(own, now),
            Pgn::DM3 => self.clear_previously_active(&request, own),
            pgn if pgn == Pgn::avef(own.get()) => self.send(self.avef(now)),
            _ => {
                if let Some(refusal) = request.refuse(own) {
                    self.send(refusal);
                }
            }
        }
    }

    /// A commanded address is stored, then the valve restarts under it.
    fn serve_transport(&mut self, id: J1939Id, frame: &Frame, now: Instant) {
        let Some(message) = self.receiver.handle(id, frame, now) else { return };
        let address = self.claim.commanded(&message.payload).map(Address::get);
        let Some(address) = address.filter(|address| self.setup.kind.node_ids().contains(address)) else { return };
        let change = LayerChange { node_id: Some(address), bit_rate: None };
        // With more writes waiting than there is room for, the command is lost like any broadcast message.
        let _ = self.storage.ask(Job::LocalLayer(change, LayerFor::CommandedAddress));
    }

    fn serve_uds(&mut self, frame: &Frame) {
        let (Id::Extended(id), Some(own)) = (frame.id(), self.claim.address()) else { return };
        if !self.claim.may_send() {
            return;
        }
        let Some((source, _)) = uds::parse_id(id.as_raw()) else { return };
        let identification = Identification {
            kind: self.setup.kind,
            factory: &self.factory,
            local_layer: self.local_layer,
            busy: !self.storage.is_idle(),
        };
        match serve(uds::Address::node(own.get()), source, frame.data(), &identification) {
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
