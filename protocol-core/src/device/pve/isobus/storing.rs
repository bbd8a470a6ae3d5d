//! Writes to the memory: what is handed out, and who is told when it is done (SPEC 5, 6).

use super::super::records::{FaultLog, LayerChange, version};
use super::super::storage::{self, Job as _};
use super::PveIsobus;
use crate::actuator::{FaultSet, InternalCause};
use crate::device::Effect;
use crate::isobus::request::Request;
use crate::memory::{Record, RecordKey, StoreError, seal};
use crate::time::Instant;
use crate::uds::node_id_written;

/// Who waits for the local layer to be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LayerFor {
    /// Nobody: the first start.
    Nobody,
    /// UDS, write of the node ID.
    Uds,
    /// Commanded address: a restart follows.
    CommandedAddress,
}

/// One write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Job {
    /// The factory data of a new memory.
    Factory,
    /// The address.
    LocalLayer(LayerChange, LayerFor),
    /// The fault log as it is.
    FaultLog,
    /// DM3: the fault log without these, which were previously active when it came.
    ClearPreviouslyActive(Request, FaultSet),
}

impl storage::Job for Job {
    fn key(self) -> RecordKey {
        match self {
            Self::Factory => RecordKey::Factory,
            Self::LocalLayer(..) => RecordKey::LocalLayer,
            Self::FaultLog | Self::ClearPreviouslyActive(..) => RecordKey::FaultLog,
        }
    }
}

impl PveIsobus {
    /// The next record to be written, encoded as things are now.
    pub(super) fn next_write(&mut self) -> Option<Effect> {
        loop {
            let job = self.storage.begin()?;
            match self.encode(job) {
                Ok(record) => return Some(Effect::Store(job.key(), record)),
                // Cannot happen with the records of this device: none is longer than a record holds.
                Err(StoreError) => self.written(job.key(), false, self.now),
            }
        }
    }

    /// The fault log is due.
    pub(super) fn store_fault_log(&mut self) {
        if self.storage.ask(Job::FaultLog) {
            self.fault_log.begun();
        }
    }

    /// The memory has answered.
    pub(super) fn written(&mut self, key: RecordKey, stored: bool, now: Instant) {
        let Some(job) = self.storage.end(key) else { return };
        let cause = InternalCause::Record(u8::try_from(key.position()).unwrap_or(u8::MAX));
        self.commander.valve.set_internal(cause, !stored, now);
        match job {
            Job::LocalLayer(change, asked_by) => {
                if stored {
                    self.local_layer = self.local_layer.with(change);
                }
                match asked_by {
                    // One that has lost its address meanwhile may tell nobody.
                    LayerFor::Uds if self.claim.is_lost() => {}
                    LayerFor::Uds => self.send(node_id_written(stored)),
                    LayerFor::CommandedAddress if stored => self.request_restart(),
                    LayerFor::CommandedAddress | LayerFor::Nobody => {}
                }
            }
            Job::FaultLog => self.fault_log.ended(stored, now),
            Job::ClearPreviouslyActive(request, asked) => {
                self.fault_log.ended(stored, now);
                if stored {
                    // One that occurred meanwhile has left the list, and keeps its counter.
                    let cleared = self.previously_active.intersection(asked);
                    self.previously_active = self.previously_active.difference(cleared);
                    self.commander.valve.clear_counters(cleared);
                    // The memory holds the zeros already.
                    self.commander.valve.take_counters_changed();
                    if let Some(frame) = self.claim.address().and_then(|own| request.acknowledge(own)) {
                        self.send(frame);
                    }
                }
            }
            Job::Factory => {}
        }
    }

    fn encode(&self, job: Job) -> Result<Record, StoreError> {
        let version = version(job.key());
        let counters = self.commander.valve.counters();
        match job {
            Job::Factory => seal(version, &self.factory.encode()),
            Job::LocalLayer(change, _) => seal(version, &self.local_layer.with(change).encode()),
            Job::FaultLog => seal(version, &FaultLog { counters, previously_active: self.previously_active }.encode()),
            Job::ClearPreviouslyActive(_, asked) => {
                let cleared = self.previously_active.intersection(asked);
                let previously_active = self.previously_active.difference(cleared);
                seal(version, &FaultLog { counters: counters.without(cleared), previously_active }.encode())
            }
        }
    }
}
