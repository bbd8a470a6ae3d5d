//! The identifiers that the node receives, computed when an identifier changes rather than for every frame.

use super::objects::Communication;
use super::product::Rules;
use crate::controller::{FILTERS, Filter, Filters};
use crate::frame::Frame;
use crate::wire::cob_id::{Function, LSS_REQUEST, NMT};

/// The service that a frame belongs to.
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
    /// The consumed EMCY of another node.
    EmcyConsumer,
    /// LSS.
    Lss,
    /// A non-CANopen protocol of the device.
    OtherProtocol,
}

/// The number of CANopen services.
const SERVICES: usize = 6;

/// A key that no frame has.
const NONE: u32 = u32::MAX;

// One filter for each service, and one filter for the other protocol.
const _: () = assert!(SERVICES < FILTERS);

/// Returns a mask with the group bit of a key. The group of a standard identifier is its function code.
const fn group(key: u32) -> u32 {
    1_u32.wrapping_shl(key >> 7)
}

/// The [keys](crate::frame::key) of the frames that the node receives.
#[derive(Clone, Debug)]
pub(super) struct Listening {
    /// The key of each service, most frequent service first.
    keys: [u32; SERVICES],
    /// The filter for the frames of the non-CANopen protocol.
    other: Filter,
    /// A bit mask of the [groups](group) of all keys. Most frames on the bus belong to none of these groups.
    groups: u32,
    /// The node ID; 0 if there is none.
    node: u8,
    /// Whether these filters have been handed out to the controller.
    told: bool,
}

impl Listening {
    /// No frames.
    pub(super) const NOTHING: Self =
        Self { keys: [NONE; SERVICES], other: Filter::exactly(NONE), groups: 0, node: 0, told: true };

    /// Computes the identifiers of a node; without a node ID the node receives only LSS.
    pub(super) fn of(objects: &Communication, rules: &Rules) -> Self {
        let mut new = Self { told: false, ..Self::NOTHING };
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
            // (A) The consumed EMCY, an emergency stop, has precedence over an RPDO or SYNC configured with the same
            // identifier.
            for key in [rpdo, sync] {
                if *key == *emcy_consumer {
                    *key = NONE;
                }
            }
        }
        // The mask may ignore a bit of the group: both values of that bit are included.
        let others = group(new.other.key) | group(new.other.key | !new.other.mask);
        // `NONE` falls into the last group, where frames are rare.
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

    /// Returns the controller filters if they have changed.
    // −9 instructions on each frame that the image takes.
    #[inline(always)]
    pub(super) fn take_filters(&mut self) -> Option<Filters> {
        if self.told {
            return None;
        }
        self.told = true;
        Some(self.filters())
    }

    fn filters(&self) -> Filters {
        let mut filters = Filters::new();
        let mut add = |filter: Filter| {
            if filter.key != NONE {
                // The capacity covers every service and the other protocol.
                let _ = filters.push(filter);
            }
        };
        self.keys.map(Filter::exactly).into_iter().for_each(&mut add);
        add(self.other);
        filters
    }

    /// Returns the service that a frame belongs to. An RPDO has precedence over a SYNC with the same identifier (A).
    // −8 instructions on a frame for nobody.
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

    /// Returns whether an NMT command addresses this node or all nodes; most commands address other nodes.
    fn is_addressed(&self, frame: &Frame) -> bool {
        let [_, node, ..] = frame.bytes();
        *node == 0 || *node == self.node
    }
}
