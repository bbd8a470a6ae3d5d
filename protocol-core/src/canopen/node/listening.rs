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
#[derive(Debug)]
pub(super) struct Listening {
    /// By service, the most frequent first.
    keys: [u32; SERVICES],
    /// Another protocol's frames.
    other: Filter,
    /// The [groups](group) of all of them: most frames are in none.
    groups: u32,
    /// The node ID; 0 without one.
    node: u8,
    /// Whether the controller has been told.
    told: bool,
}

impl Listening {
    /// Listens to nothing.
    pub(super) const NOTHING: Self =
        Self { keys: [NONE; SERVICES], other: Filter::exactly(NONE), groups: 0, node: 0, told: true };

    /// Returns what a node listens to; without a node ID that is LSS alone.
    pub(super) fn of(objects: &Communication, rules: &Rules) -> Self {
        let lss = u32::from(LSS_REQUEST);
        let Some(node_id) = objects.node_id else {
            return Self::to([NONE, NONE, NONE, NONE, NONE, lss], Filter::exactly(NONE), 0);
        };
        let keys = [
            objects.rpdo.key().unwrap_or(NONE),
            objects.sync.key(),
            NMT.into(),
            node_id.raw_id(Function::SdoRequest).into(),
            objects.emcy_consumer.key().unwrap_or(NONE),
            lss,
        ];
        let other = rules.other_protocol.map_or(Filter::exactly(NONE), |filter| filter(node_id));
        Self::to(keys, other, node_id.get())
    }

    fn to(keys: [u32; SERVICES], other: Filter, node: u8) -> Self {
        // The mask may leave a bit of the group open.
        let all = keys.into_iter().chain([other.key, other.key | !other.mask]).filter(|key| *key != NONE);
        Self { keys, other, groups: all.fold(0, |groups, key| groups | group(key)), node, told: false }
    }

    /// Listens to what the objects say now.
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
        let services = self.keys.iter().map(|key| Filter::exactly(*key));
        services.chain([self.other]).filter(|filter| filter.key != NONE).collect()
    }

    /// Returns the service that a frame is for; of two with the same identifier the first.
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
