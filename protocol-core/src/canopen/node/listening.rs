//! The identifiers that the node listens to: found when one of them changes, not for every frame on the bus.

use super::objects::Communication;
use super::product::Product;
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
}

/// The number of services.
const SERVICES: usize = 6;

/// The key of no frame.
const NONE: u32 = u32::MAX;

// One for each service, and one for another service of the device.
const _: () = assert!(SERVICES < FILTERS);

/// The [keys](crate::frame::key) of the frames that the node listens to.
#[derive(Debug)]
pub(super) struct Listening {
    /// By service, the most frequent first.
    keys: [u32; SERVICES],
    /// The node ID; 0 without one.
    node: u8,
    /// Whether the controller has been told.
    told: bool,
}

impl Listening {
    /// Listens to nothing.
    pub(super) const NOTHING: Self = Self { keys: [NONE; SERVICES], node: 0, told: true };

    /// Returns what a node listens to; without a node ID that is LSS alone.
    pub(super) fn of<P: Product>(objects: &Communication<P>) -> Self {
        let lss = u32::from(LSS_REQUEST);
        let Some(node_id) = objects.node_id else {
            return Self { keys: [NONE, NONE, NONE, NONE, NONE, lss], node: 0, told: false };
        };
        let keys = [
            objects.rpdo.key().unwrap_or(NONE),
            NMT.into(),
            objects.sync.key(),
            node_id.raw_id(Function::SdoRequest).into(),
            objects.emcy_consumer.key().unwrap_or(NONE),
            lss,
        ];
        Self { keys, node: node_id.get(), told: false }
    }

    /// Listens to what the objects say now.
    pub(super) fn update<P: Product>(&mut self, objects: &Communication<P>) {
        let new = Self::of(objects);
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
        self.keys.iter().filter(|key| **key != NONE).map(|key| Filter::exactly(*key)).collect()
    }

    /// Returns the service that a frame is for; of two with the same identifier the first.
    #[inline(always)]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        let key = frame.key();
        let [rpdo, nmt, sync, sdo, emcy_consumer, lss] = self.keys;
        match key {
            _ if key == rpdo => Some(Service::Rpdo),
            _ if key == nmt => self.is_addressed(frame).then_some(Service::Nmt),
            _ if key == sync => Some(Service::Sync),
            _ if key == sdo => Some(Service::Sdo),
            _ if key == emcy_consumer => Some(Service::EmcyConsumer),
            _ if key == lss => Some(Service::Lss),
            _ => None,
        }
    }

    /// Returns whether an NMT command is for this node or for all: most are for one of many.
    fn is_addressed(&self, frame: &Frame) -> bool {
        let [_, node, ..] = frame.bytes();
        *node == 0 || *node == self.node
    }
}
