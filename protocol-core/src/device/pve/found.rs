//! The records that a valve finds in the memory at a start (SPEC 6).

use super::Setup;
use super::records::{Factory, FaultLog, LocalLayer, VERSION};
use crate::actuator::{InternalCause, Valve};
use crate::device::reading::Reading;
use crate::memory::{Memory, RecordKey};
use crate::time::Instant;

/// The records of a valve. Defaults replace missing and corrupt records.
pub(super) struct Found<'a> {
    pub(super) reading: Reading<'a>,
    pub(super) factory: Factory,
    pub(super) local_layer: LocalLayer,
    pub(super) fault_log: FaultLog,
}

impl<'a> Found<'a> {
    /// Reads the records that all valves have.
    pub(super) fn read(setup: &Setup, memory: &'a dyn Memory) -> Self {
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
            // Damage must not remove the node ID: only a new memory can lack a node ID.
            found.local_layer = LocalLayer::new(Setup::new(kind));
        }
        if let Some(log) = found.payload(RecordKey::FaultLog, FaultLog::decode) {
            found.fault_log = log;
        }
        found
    }

    /// Decodes a record. Returns `None` for a record that was never written or is corrupt. [`Reading::is_corrupt`]
    /// distinguishes the two cases.
    pub(super) fn payload<T>(&mut self, key: RecordKey, decode: impl FnOnce(&'a [u8]) -> Option<T>) -> Option<T> {
        self.reading.record(key, VERSION, decode)
    }

    /// Raises the internal error of a valve for corrupt records and for a damaged memory.
    pub(super) fn raise_faults(&self, valve: &mut Valve, now: Instant) {
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
