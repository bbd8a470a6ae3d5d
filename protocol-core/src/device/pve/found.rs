//! What a start finds in the memory: each record checked, with the defaults in the place of what is not there (SPEC 6).

use super::Setup;
use super::records::{Factory, FaultLog, LocalLayer, version};
use crate::actuator::{InternalCause, Valve};
use crate::memory::{Image, RecordKey};
use crate::time::Instant;

/// The records as they were found.
pub(super) struct Found<'a> {
    image: &'a Image,
    pub(super) factory: Factory,
    pub(super) local_layer: LocalLayer,
    pub(super) fault_log: FaultLog,
    corrupt: [bool; RecordKey::ALL.len()],
}

impl<'a> Found<'a> {
    /// Looks at what every valve keeps.
    pub(super) fn look(setup: &Setup, image: &'a Image) -> Self {
        let kind = setup.kind;
        let mut found = Self {
            image,
            factory: Factory::new(kind, setup.serial),
            local_layer: LocalLayer::new(kind, setup.node_id),
            fault_log: FaultLog::default(),
            corrupt: [false; RecordKey::ALL.len()],
        };
        if let Some(factory) = found.payload(RecordKey::Factory, Factory::decode) {
            found.factory = factory;
        }
        if let Some(layer) = found.payload(RecordKey::LocalLayer, |payload| LocalLayer::decode(kind, payload)) {
            found.local_layer = layer;
        } else if found.is_corrupt(RecordKey::LocalLayer) && setup.node_id.is_none() {
            // It had a node ID: only a layer that was never written can be blank.
            found.local_layer = LocalLayer::new(kind, Some(kind.default_node_id()));
        }
        if let Some(log) = found.payload(RecordKey::FaultLog, FaultLog::decode) {
            found.fault_log = log;
        }
        found
    }

    /// The meaning of a record; `None` when it was never written, or is corrupt, which is noted.
    pub(super) fn payload<T>(&mut self, key: RecordKey, decode: impl FnOnce(&'a [u8]) -> Option<T>) -> Option<T> {
        let payload = match self.image.payload(key, version(key)) {
            Ok(payload) => payload?,
            Err(_) => return self.mark_corrupt(key),
        };
        decode(payload).or_else(|| self.mark_corrupt(key))
    }

    /// Whether a record was never written.
    pub(super) fn is_absent(&self, key: RecordKey) -> bool {
        self.image.payload(key, version(key)) == Ok(None)
    }

    /// Raises the internal error for what is damaged.
    pub(super) fn tell_faults(&self, valve: &mut Valve, now: Instant) {
        if self.image.is_damaged() {
            valve.set_internal(InternalCause::Memory, true, now);
        }
        for (record, _) in (0..).zip(self.corrupt).filter(|(_, corrupt)| *corrupt) {
            valve.set_internal(InternalCause::Record(record), true, now);
        }
    }

    fn is_corrupt(&self, key: RecordKey) -> bool {
        self.corrupt.get(key.position()) == Some(&true)
    }

    fn mark_corrupt<T>(&mut self, key: RecordKey) -> Option<T> {
        if let Some(corrupt) = self.corrupt.get_mut(key.position()) {
            *corrupt = true;
        }
        None
    }
}
