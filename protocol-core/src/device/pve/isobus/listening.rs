//! Which frames the device listens to (SPEC 5, 7): told by the identifier alone, for most frames on a bus are not for it.

use crate::frame::{Frame, Id};
use crate::wire::j1939_id::{Address, Format, J1939Id, Pgn};
use crate::wire::{request, uds};

/// The service that a frame is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Service {
    /// An auxiliary valve command.
    Avc,
    /// A request for the claim of the address.
    ClaimRequest,
    /// Another request.
    Request,
    /// Somebody claims the address.
    Claim,
    /// A broadcast message in packets.
    Transport,
    /// UDS.
    Uds,
}

/// What to look for.
#[derive(Debug)]
pub(super) struct Listening {
    own: Address,
    avc: Pgn,
    /// UDS requests from any source.
    uds: u32,
}

impl Listening {
    /// What the valve at this address listens to.
    pub(super) fn at(own: Address) -> Self {
        Self { own, avc: Pgn::avc(own.get()), uds: uds::key_to(uds::Address::node(own.get())) }
    }

    /// The service that a frame is for.
    #[inline]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        let Id::Extended(id) = frame.id() else { return None };
        let id = J1939Id::from_raw(id.as_raw());
        match id.format() {
            Format::GROUPS_FE => (id.pgn() == self.avc).then_some(Service::Avc),
            Format::ADDRESS_CLAIMED => (id.source() == self.own).then_some(Service::Claim),
            Format::REQUEST => {
                let destination = id.destination();
                if destination != Address::GLOBAL && destination != self.own {
                    return None;
                }
                let claim = request::parse(frame)? == Pgn::ADDRESS_CLAIMED;
                Some(if claim { Service::ClaimRequest } else { Service::Request })
            }
            Format::TP_CONNECTION | Format::TP_DATA => {
                (id.destination() == Address::GLOBAL).then_some(Service::Transport)
            }
            _ => (frame.key() & uds::ANY_SOURCE == self.uds).then_some(Service::Uds),
        }
    }
}
