//! Which frames the device listens to (SPEC 5, 7): told by the identifier alone, for most frames on a bus are not for it.

use crate::controller::{Filter, Filters};
use crate::frame::{Frame, extended, key};
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

/// Bits 8–25 of an identifier: the group, and in the format PDU1 the destination.
type Group = u32;

/// A request to all.
const REQUEST_TO_ALL: Group = Pgn::REQUEST.raw() | Address::GLOBAL.get() as u32;

/// What to look for.
#[derive(Debug)]
pub(super) struct Listening {
    own: Address,
    avc: Group,
    request: Group,
    /// UDS requests from any source.
    uds: u32,
    /// Whether the controller has been told.
    told: bool,
}

/// The bits of a key that hold a [`Group`].
const GROUP: u32 = 0x3_FFFF << 8;
/// The bits of a key that hold pages and PDU format.
const FORMAT: u32 = 0x3_FF00 << 8;
/// The bits of a key that hold the source.
const SOURCE: u32 = 0xFF;
/// The bits of a key above those of an identifier: what tells an extended one.
const EXTENDED: u32 = !0x1FFF_FFFF;

impl Listening {
    /// What the valve at this address listens to.
    pub(super) fn at(own: Address) -> Self {
        Self {
            own,
            avc: Pgn::avc(own.get()).raw(),
            request: Pgn::REQUEST.raw() | u32::from(own.get()),
            uds: uds::key_to(uds::Address::node(own.get())),
            told: false,
        }
    }

    /// The same for the controller, once.
    #[inline]
    pub(super) fn take_filters(&mut self) -> Option<Filters> {
        if self.told {
            return None;
        }
        self.told = true;
        Some(self.filters())
    }

    fn filters(&self) -> Filters {
        let of = |raw: u32, mask: u32| Filter { key: key(extended(raw).into()), mask: EXTENDED | mask };
        let to_all = |pgn: Pgn| pgn.raw() | u32::from(Address::GLOBAL.get());
        let groups = [self.avc, self.request, REQUEST_TO_ALL, to_all(Pgn::TP_CONNECTION), to_all(Pgn::TP_DATA)];
        let claim = of(Pgn::ADDRESS_CLAIMED.raw() << 8 | u32::from(self.own.get()), FORMAT | SOURCE);
        let uds = Filter { key: self.uds, mask: uds::ANY_SOURCE };
        groups.map(|group| of(group << 8, GROUP)).into_iter().chain([claim, uds]).collect()
    }

    /// The service that a frame is for. A standard identifier has no bits of a group, and is for none.
    #[inline]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        let group: Group = frame.key() >> 8 & 0x3_FFFF;
        if group == self.avc {
            return Some(Service::Avc);
        }
        if group == REQUEST_TO_ALL || group == self.request {
            let claim = request::parse(frame)? == Pgn::ADDRESS_CLAIMED;
            return Some(if claim { Service::ClaimRequest } else { Service::Request });
        }
        let id = J1939Id::from_raw(frame.key());
        let format = id.format();
        // The groups of the data link and of network management are neighbours: most frames are none of them.
        if !(Format::TP_DATA..=Format::ADDRESS_CLAIMED).contains(&format) {
            return (frame.key() & uds::ANY_SOURCE == self.uds).then_some(Service::Uds);
        }
        match format {
            Format::ADDRESS_CLAIMED => (id.source() == self.own).then_some(Service::Claim),
            Format::TP_CONNECTION | Format::TP_DATA => {
                (id.destination() == Address::GLOBAL).then_some(Service::Transport)
            }
            _ => None,
        }
    }
}
