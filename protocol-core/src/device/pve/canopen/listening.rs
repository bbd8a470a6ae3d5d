//! Which frames the device listens to: found once, when something changes, not for every frame on the bus.

use super::super::objects::PveObjects;
use crate::controller::{FILTERS, Filter, Filters};
use crate::frame::Frame;
use crate::wire::cob_id::{Function, LSS_REQUEST, NMT};
use crate::wire::uds;

/// The service that a frame is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Service {
    Lss,
    Sdo,
    Rpdo,
    Nmt,
    Sync,
    EmcyConsumer,
    Uds,
}

/// The services that go by an 11-bit identifier; where two were given the same one, the first is served.
const BY_STANDARD: [Service; 6] =
    [Service::Lss, Service::Sdo, Service::Rpdo, Service::Nmt, Service::Sync, Service::EmcyConsumer];

/// The highest key of a standard frame.
const MAX_STANDARD: u32 = 0x7FF;

/// The key of no frame.
const NONE: u32 = u32::MAX;

// One for each service, and one for UDS.
const _: () = assert!(BY_STANDARD.len() < FILTERS);

/// The [keys](crate::frame::key) of the frames that the device listens to.
#[derive(Debug)]
pub(super) struct Listening {
    standard: [u32; BY_STANDARD.len()],
    /// From any source.
    uds: u32,
    /// The node ID; 0 without one.
    node: u8,
    /// Whether the controller has been told.
    told: bool,
}

impl Listening {
    /// What a device listens to; without a node ID that is LSS alone.
    pub(super) fn of(objects: &PveObjects) -> Self {
        let lss = u32::from(LSS_REQUEST);
        let Some(node_id) = objects.node_id else {
            return Self { standard: [lss, NONE, NONE, NONE, NONE, NONE], uds: NONE, node: 0, told: false };
        };
        Self {
            standard: [
                lss,
                node_id.raw_id(Function::SdoRequest).into(),
                objects.rpdo.key().unwrap_or(NONE),
                NMT.into(),
                objects.sync.key(),
                objects.emcy_consumer.key().unwrap_or(NONE),
            ],
            uds: uds::key_to(uds::Address::node(node_id.get())),
            node: node_id.get(),
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
        let standard = self.standard.iter().filter(|key| **key != NONE).map(|key| Filter::exactly(*key));
        let uds = (self.uds != NONE).then_some(Filter { key: self.uds, mask: uds::ANY_SOURCE });
        standard.chain(uds).collect()
    }

    /// Whether an object holds one of the identifiers.
    pub(super) const fn depends_on(index: u16) -> bool {
        matches!(index, 0x1005 | 0x1028 | 0x1400)
    }

    /// The service that a frame is for.
    #[inline]
    pub(super) fn service(&self, frame: &Frame) -> Option<Service> {
        let key = frame.key();
        if key > MAX_STANDARD {
            return (key & uds::ANY_SOURCE == self.uds).then_some(Service::Uds);
        }
        let position = self.standard.iter().position(|listened| *listened == key)?;
        let service = *BY_STANDARD.get(position)?;
        (service != Service::Nmt || self.is_addressed(frame)).then_some(service)
    }

    /// Whether an NMT command is for this node or for all: most are for one of many.
    fn is_addressed(&self, frame: &Frame) -> bool {
        let [_, node, ..] = frame.bytes();
        *node == 0 || *node == self.node
    }
}
