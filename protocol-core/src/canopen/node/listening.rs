//! The identifiers that the node listens to: found when one of them changes, not for every frame on the bus.

use super::objects::Communication;
use super::product::Rules;
use crate::controller::{FILTERS, Filter, Filters};
use crate::frame::Frame;
use crate::wire::cob_id::{Function, LSS_REQUEST, NMT};

/// The service that a frame is for.
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
    /// The EMCY that the node listens to.
    EmcyConsumer,
    /// LSS.
    Lss,
    /// Another protocol of the device.
    OtherProtocol,
}

/// The number of services of CANopen.
const SERVICES: usize = 6;

/// The key of no frame.
const NONE: u32 = u32::MAX;

// One for each service, and one for the other protocol.
const _: () = assert!(SERVICES < FILTERS);

/// Returns the bit of the group that a key is in: of a standard identifier, its function code.
#[inline(always)]
const fn group(key: u32) -> u32 {
    1_u32.wrapping_shl(key >> 7)
}

/// The [keys](crate::frame::key) of the frames that the node listens to.
#[derive(Clone, Debug)]
pub(super) struct Listening {
    /// By service, the most frequent first.
    keys: [u32; SERVICES],
    /// Another protocol's frames.
    other: Filter,
    /// The [groups](group) of all of them: most frames are in none.
    groups: u32,
    /// The node ID; 0 without one.
    node: u8,
    /// The controller has these filters.
    told: bool,
}

impl Listening {
    /// Listens to nothing.
    pub(super) const NOTHING: Self =
        Self { keys: [NONE; SERVICES], other: Filter::exactly(NONE), groups: 0, node: 0, told: true };

    /// Returns what a node listens to; without a node ID that is LSS alone.
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
            // (A) An emergency stop is not lost to a PDO or SYNC that was given its identifier.
            for key in [rpdo, sync] {
                if *key == *emcy_consumer {
                    *key = NONE;
                }
            }
        }
        // The mask may leave a bit of the group open.
        let others = group(new.other.key) | group(new.other.key | !new.other.mask);
        // `NONE` is in the last group, where hardly a frame is.
        new.groups = new.keys.into_iter().fold(others, |groups, key| groups | group(key));
        new
    }

    /// Takes changed identifiers from the objects.
    pub(super) fn update(&mut self, objects: &Communication, rules: &Rules) {
        let new = Self::of(objects, rules);
        if new.keys != self.keys {
            *self = new;
        }
    }

    /// Returns the filters of the controller when they have changed.
    #[inline(always)]
    pub(super) fn take_filters(&mut self) -> Option<Filters> {
        if self.told {
            return None;
        }
        self.told = true;
        Some(self.filters())
    }

    #[inline(never)]
    fn filters(&self) -> Filters {
        let mut filters = Filters::new();
        let mut add = |filter: Filter| {
            if filter.key != NONE {
                // There is a place for every service, and for the other protocol.
                let _ = filters.push(filter);
            }
        };
        self.keys.map(Filter::exactly).into_iter().for_each(&mut add);
        add(self.other);
        filters
    }

    /// Returns the service that a frame is for; an RPDO comes before a SYNC with the same identifier (A).
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

    /// Returns whether an NMT command is for this node or for all: most are for one of many.
    fn is_addressed(&self, frame: &Frame) -> bool {
        let [_, node, ..] = frame.bytes();
        *node == 0 || *node == self.node
    }
}
