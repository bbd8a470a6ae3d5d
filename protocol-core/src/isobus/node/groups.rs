//! The frames that a node receives, selected by identifier only: most frames on the bus are for other nodes.

use core::ops::RangeInclusive;

use super::Rules;
use crate::controller::{Filter, Filters};
use crate::frame::{Frame, extended, key};
use crate::wire::j1939_id::{Address, Format, J1939Id, Pgn};

/// The service that a frame belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// The product's command group.
    Command,
    /// A request, to this node or to all.
    Request,
    /// A claim of the own address.
    Claim,
    /// A frame of a multi-packet broadcast.
    Broadcast,
    /// A frame of a transport connection with this node.
    Connection,
    /// No service: a foreign frame with the own source address.
    Objection,
    /// The product's non-J1939 protocol.
    OtherProtocol,
}

/// Bits 8–25 of an identifier, at their original positions: the group and, in PDU1 format, the destination.
type Group = u32;

/// The identifiers of the services.
#[derive(Clone, Debug)]
pub(super) struct Groups {
    own: Address,
    command: Group,
    request: Group,
    connection: Group,
    other_protocol: Filter,
    /// Whether these filters have been handed out to the controller.
    told: bool,
}

/// A request to all.
const REQUEST_TO_ALL: Group = group(Pgn::REQUEST, Address::GLOBAL);

/// The range of groups that contains TP.DT, TP.CM and address claimed, with any destination. Most frames are outside
/// this range.
const TRANSPORT_AND_CLAIMS: RangeInclusive<Group> =
    group(Pgn::TP_DATA, Address::new(0))..=group(Pgn::ADDRESS_CLAIMED, Address::GLOBAL);

/// The bits of a key that hold a [`Group`].
const GROUP: u32 = 0x3_FFFF << 8;
/// A group that no frame has.
const NONE: Group = u32::MAX;
/// The bits of a key that hold the source.
const SOURCE: u32 = 0xFF;
/// The bits of a key above the 29 bits of an identifier, which distinguish extended from standard identifiers.
const EXTENDED: u32 = !0x1FFF_FFFF;

const fn group(pgn: Pgn, destination: Address) -> Group {
    (pgn.raw() | destination.get() as u32) << 8
}

impl Groups {
    /// Computes the groups of a node with this address.
    pub(super) fn at(own: Address, rules: &Rules) -> Self {
        Self {
            own,
            command: (rules.command)(own).raw() << 8,
            request: group(Pgn::REQUEST, own),
            connection: group(Pgn::TP_CONNECTION, own),
            other_protocol: (rules.other_protocol)(own),
            told: false,
        }
    }

    /// Stops receiving commands after the loss of the address.
    pub(super) const fn lose(&mut self) {
        self.command = NONE;
    }

    /// Returns the service that a frame belongs to. A foreign frame with the own source address can belong to any
    /// service.
    #[inline]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        // The key of a standard identifier has at most three bits in the group field, so it matches no group.
        let group: Group = frame.key() & GROUP;
        if group == self.command {
            return Some(Service::Command);
        }
        if group == REQUEST_TO_ALL || group == self.request {
            return Some(Service::Request);
        }
        if TRANSPORT_AND_CLAIMS.contains(&group) {
            return self.neighbour(frame, group);
        }
        if J1939Id::from_raw(frame.key()).source() == self.own {
            return self.ends_in_own_address(frame);
        }
        None
    }

    /// Returns the service of a frame in the transport and claim groups.
    fn neighbour(&self, frame: &Frame, group: Group) -> Option<Service> {
        let id = J1939Id::from_raw(frame.key());
        match id.format() {
            Format::ADDRESS_CLAIMED => (id.source() == self.own).then_some(Service::Claim),
            Format::TP_CONNECTION | Format::TP_DATA if id.destination() == Address::GLOBAL => Some(Service::Broadcast),
            Format::TP_CONNECTION if group == self.connection => Some(Service::Connection),
            _ => self.is_foreign_use(frame).then_some(Service::Objection),
        }
    }

    /// Returns the service of a frame outside the transport and claim groups whose identifier ends in the own address.
    #[inline]
    fn ends_in_own_address(&self, frame: &Frame) -> Option<Service> {
        if self.other_protocol.passes(frame) {
            return Some(Service::OtherProtocol);
        }
        self.is_foreign_use(frame).then_some(Service::Objection)
    }

    /// Returns whether a frame that is not a claim uses the own address. Both page bits set mark other protocols, such
    /// as UDS, whose identifiers have no source address in that place.
    #[inline]
    pub(super) fn is_foreign_use(&self, frame: &Frame) -> bool {
        let id = J1939Id::from_raw(frame.key());
        id.source() == self.own && frame.is_extended() && id.is_j1939()
    }

    /// Returns the controller filters, once after every start.
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
        let to_all = |pgn: Pgn| group(pgn, Address::GLOBAL);
        let broadcasts = [to_all(Pgn::TP_CONNECTION), to_all(Pgn::TP_DATA)];
        let groups = [self.command, self.request, REQUEST_TO_ALL, self.connection].into_iter().chain(broadcasts);
        // Claims of the own address and the identifiers of the other protocol also end in the own address.
        let under_own = of(self.own.get().into(), SOURCE);
        groups.map(|group| of(group, GROUP)).chain([under_own]).collect()
    }
}
