//! The identifiers that the node receives. They are computed at a change of an identifier, not for every frame.

use super::objects::Communication;
use super::product::Rules;
use crate::controller::{FILTERS, Filter, Filters};
use crate::frame::Frame;
use crate::wire::cob_id::{Function, LSS_REQUEST, NMT};

/// The service that handles a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// RPDO 1.
    Rpdo,
    /// NMT.
    Nmt,
    /// SYNC.
    Sync,
    /// SDO.
    Sdo,
    /// The EMCY consumer.
    EmcyConsumer,
    /// LSS.
    Lss,
    /// A protocol other than CANopen.
    OtherProtocol,
}

/// The number of CANopen services.
const SERVICES: usize = 6;

/// A key that no frame has.
const NONE: u32 = u32::MAX;

// Each service has a filter, and so has the other protocol.
const _: () = assert!(SERVICES < FILTERS);

/// Returns a mask with the bit of a key's group. The group of an 11-bit identifier is its function code.
const fn group(key: u32) -> u32 {
    1_u32.wrapping_shl(key >> 7)
}

/// The [keys](crate::frame::key) of the frames that the node receives.
#[derive(Clone, Debug)]
pub(super) struct Listening {
    /// The key of each service.
    keys: [u32; SERVICES],
    /// The filter for the frames of the other protocol.
    other: Filter,
    /// The mask of the [groups](group) of all keys. Most frames on the bus belong to other groups.
    groups: u32,
    /// The node ID; 0 if there is none.
    node: u8,
    /// Set once the filters are handed to the controller.
    handed_out: bool,
}

impl Listening {
    /// No identifiers: the node receives no frames.
    pub(super) const NOTHING: Self =
        Self { keys: [NONE; SERVICES], other: Filter::exactly(NONE), groups: 0, node: 0, handed_out: true };

    /// Computes the identifiers of a node. Without a node ID the node receives only LSS.
    pub(super) fn of(objects: &Communication, rules: &Rules) -> Self {
        let mut new = Self { handed_out: false, ..Self::NOTHING };
        let [rpdo, sync, nmt, sdo, emcy_consumer, lss] = &mut new.keys;
        *lss = LSS_REQUEST.into();
        if let Some(node_id) = objects.node_id {
            *rpdo = objects.rpdo.key().unwrap_or(NONE);
            *sync = objects.sync.key();
            *nmt = NMT.into();
            *sdo = node_id.raw_id(Function::SdoRequest).into();
            *emcy_consumer = objects.emcy_consumer.key().unwrap_or(NONE);
            new.other = rules.other_protocol.map_or(new.other, |filter| filter(node_id));
            new.node = node_id.get();
            // (A) The EMCY consumer, an emergency stop, has precedence over an RPDO or SYNC with the same identifier.
            for key in [rpdo, sync] {
                if *key == *emcy_consumer {
                    *key = NONE;
                }
            }
        }
        // The mask may ignore one bit of the group, so both values of this bit count.
        let others = group(new.other.key) | group(new.other.key | !new.other.mask);
        // `NONE` belongs to the last group, where frames are rare.
        new.groups = new.keys.into_iter().fold(others, |groups, key| groups | group(key));
        new
    }

    /// Recomputes the identifiers after a change of the objects.
    pub(super) fn update(&mut self, objects: &Communication, rules: &Rules) {
        let new = Self::of(objects, rules);
        if new.keys != self.keys {
            *self = new;
        }
    }

    /// Returns new filters for the controller, once.
    // Inlining saves 9 instructions on each frame that the image takes.
    #[inline(always)]
    pub(super) fn take_filters(&mut self) -> Option<Filters> {
        if self.handed_out {
            return None;
        }
        self.handed_out = true;
        Some(self.filters())
    }

    fn filters(&self) -> Filters {
        let mut filters = Filters::new();
        let mut add = |filter: Filter| {
            if filter.key != NONE {
                // There is room for every service and the other protocol.
                let _ = filters.push(filter);
            }
        };
        self.keys.map(Filter::exactly).into_iter().for_each(&mut add);
        add(self.other);
        filters
    }

    /// Returns the service that handles a frame. An RPDO has precedence over a SYNC with the same identifier (A).
    // Inlining saves 8 instructions on a frame for another node.
    #[inline(always)]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        let key = frame.key();
        if self.groups & group(key) == 0 {
            return None;
        }
        let [rpdo, sync, nmt, sdo, emcy_consumer, lss] = self.keys;
        match key {
            _ if key == rpdo => Some(Service::Rpdo),
            _ if key == sync => Some(Service::Sync),
            _ if key == nmt => self.is_addressed(frame).then_some(Service::Nmt),
            _ if key == sdo => Some(Service::Sdo),
            _ if key == emcy_consumer => Some(Service::EmcyConsumer),
            _ if key == lss => Some(Service::Lss),
            _ if key & self.other.mask == self.other.key => Some(Service::OtherProtocol),
            _ => None,
        }
    }

    /// Returns whether an NMT command addresses this node or all nodes. Most commands address other nodes.
    fn is_addressed(&self, frame: &Frame) -> bool {
        let [_, node, ..] = frame.bytes();
        *node == 0 || *node == self.node
    }
}
