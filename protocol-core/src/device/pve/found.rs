//! The records that a start finds in the memory: each checked, with the defaults for those that are missing (SPEC 6).

use super::Setup;
use super::records::{Factory, FaultLog, LocalLayer, VERSION};
use crate::actuator::{InternalCause, Valve};
use crate::device::reading::Reading;
use crate::memory::{Memory, RecordKey};
use crate::time::Instant;

/// The records as they were found.
pub(super) struct Found<'a> {
    pub(super) reading: Reading<'a>,
    pub(super) factory: Factory,
    pub(super) local_layer: LocalLayer,
    pub(super) fault_log: FaultLog,
}

impl<'a> Found<'a> {
    /// Reads the records common to all valves, with defaults for missing ones.
    pub(super) fn look(setup: &Setup, memory: &'a dyn Memory) -> Self {
        let kind = setup.kind;
        let mut found = Self {
            reading: Reading::new(memory),
            factory: Factory::new(kind, setup.serial),
            local_layer: LocalLayer::new(*setup),
            fault_log: FaultLog::default(),
        };
        if let Some(factory) = found.payload(RecordKey::Factory, Factory::decode) {
            found.factory = factory;
        }
        if let Some(layer) = found.payload(RecordKey::LocalLayer, |payload| LocalLayer::decode(kind, payload)) {
            found.local_layer = layer;
        } else if found.reading.is_corrupt(RecordKey::LocalLayer) && setup.node_id.is_none() {
            // It had a node ID: only a layer that was never written can be blank.
            found.local_layer = LocalLayer::new(Setup::new(kind));
        }
        if let Some(log) = found.payload(RecordKey::FaultLog, FaultLog::decode) {
            found.fault_log = log;
        }
        found
    }

    /// Returns the meaning of a record; `None` when it was never written, or is corrupt, which is noted.
    pub(super) fn payload<T>(&mut self, key: RecordKey, decode: impl FnOnce(&'a [u8]) -> Option<T>) -> Option<T> {
        self.reading.record(key, VERSION, decode)
    }

    /// Raises the internal error for what is damaged.
    pub(super) fn tell_faults(&self, valve: &mut Valve, now: Instant) {
        if self.reading.is_damaged() {
            valve.set_internal(InternalCause::Memory, true, now);
        }
        for (record, key) in (0..).zip(RecordKey::ALL) {
            if self.reading.is_corrupt(key) {
                valve.set_internal(InternalCause::Record(record), true, now);
            }
        }
    }
}
