//! The frames that a node receives, selected by their identifiers. Most frames on the bus are for other nodes.

use core::ops::RangeInclusive;

use super::Rules;
use crate::controller::{Filter, Filters};
use crate::frame::{Frame, extended, key};
use crate::wire::j1939_id::{Address, Format, J1939Id, Pgn};

/// The service that handles a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// The command group of the product.
    Command,
    /// A request to this node or to all.
    Request,
    /// A claim of the node's address.
    Claim,
    /// A frame of a multi-packet broadcast.
    Broadcast,
    /// A frame of a transport connection with this node.
    Connection,
    /// No service: another node uses the node's address as its source address.
    Objection,
    /// The protocol of the product other than J1939.
    OtherProtocol,
}

/// Bits 8–25 of an identifier, not shifted: the group and, in PDU1 format, the destination.
type Group = u32;

/// The groups and the address that the services of the node receive.
#[derive(Clone, Debug)]
pub(super) struct Groups {
    own: Address,
    command: Group,
    request: Group,
    connection: Group,
    other_protocol: Filter,
    /// Set once the filters are handed to the controller.
    handed_out: bool,
}

const REQUEST_TO_ALL: Group = group(Pgn::REQUEST, Address::GLOBAL);

/// The range of groups that holds TP.DT, TP.CM and address claimed, for any destination. Most frames are outside this
/// range.
const TRANSPORT_AND_CLAIMS: RangeInclusive<Group> =
    group(Pgn::TP_DATA, Address::new(0))..=group(Pgn::ADDRESS_CLAIMED, Address::GLOBAL);

/// The bits of a key that hold a [`Group`].
const GROUP: u32 = 0x3_FFFF << 8;
/// A group that no frame has.
const NONE: Group = u32::MAX;
/// The bits of a key that hold the source.
const SOURCE: u32 = 0xFF;
/// The bits of a key above the 29 bits of an identifier. Bit 29 marks a 29-bit identifier.
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
            handed_out: false,
        }
    }

    /// Stops the reception of commands, after the loss of the address.
    pub(super) const fn lose(&mut self) {
        self.command = NONE;
    }

    /// Returns the service that handles a frame. Another node can use the node's address in a frame of any service.
    #[inline]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        // The key of an 11-bit identifier has at most three bits in the group field, and so matches no group of the
        // node.
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

    /// Returns the service for a frame in the groups of transport and claims.
    fn neighbour(&self, frame: &Frame, group: Group) -> Option<Service> {
        let id = J1939Id::from_raw(frame.key());
        match id.format() {
            Format::ADDRESS_CLAIMED => (id.source() == self.own).then_some(Service::Claim),
            Format::TP_CONNECTION | Format::TP_DATA if id.destination() == Address::GLOBAL => Some(Service::Broadcast),
            Format::TP_CONNECTION if group == self.connection => Some(Service::Connection),
            _ => self.is_foreign_use(frame).then_some(Service::Objection),
        }
    }

    /// Returns the service for a frame in any other group. The frame's identifier must end in the node's address.
    #[inline]
    fn ends_in_own_address(&self, frame: &Frame) -> Option<Service> {
        if self.other_protocol.passes(frame) {
            return Some(Service::OtherProtocol);
        }
        self.is_foreign_use(frame).then_some(Service::Objection)
    }

    /// Returns whether another node uses the node's address as the source address of a J1939 frame. Identifiers of
    /// other protocols, such as UDS, have both page bits set and no source address there.
    #[inline]
    pub(super) fn is_foreign_use(&self, frame: &Frame) -> bool {
        let id = J1939Id::from_raw(frame.key());
        id.source() == self.own && frame.is_extended() && id.is_j1939()
    }

    /// Returns the filters for the controller, once after every start.
    #[inline]
    pub(super) fn take_filters(&mut self) -> Option<Filters> {
        if self.handed_out {
            return None;
        }
        self.handed_out = true;
        Some(self.filters())
    }

    fn filters(&self) -> Filters {
        let of = |raw: u32, mask: u32| Filter { key: key(extended(raw).into()), mask: EXTENDED | mask };
        let to_all = |pgn: Pgn| group(pgn, Address::GLOBAL);
        let broadcasts = [to_all(Pgn::TP_CONNECTION), to_all(Pgn::TP_DATA)];
        let groups = [self.command, self.request, REQUEST_TO_ALL, self.connection].into_iter().chain(broadcasts);
        // The identifiers of address claims and of the other protocol's frames end in the node's address, too.
        let under_own = of(self.own.get().into(), SOURCE);
        groups.map(|group| of(group, GROUP)).chain([under_own]).collect()
    }
}
