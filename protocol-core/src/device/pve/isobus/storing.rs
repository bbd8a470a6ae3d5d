//! Writes to the memory, and who waits for them (SPEC 5, 6).

use super::super::records::{FaultLog, LayerChange, version};
use super::IsobusValve;
use crate::actuator::{FaultSet, InternalCause};
use crate::device::Restart;
use crate::device::host::{Base, Body};
use crate::device::writes;
use crate::isobus::request::Request;
use crate::memory::{Record, RecordKey, StoreError, seal};
use crate::uds::node_id_written;

/// Who waits for the local layer to be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerFor {
    /// Nobody: the first start.
    Nobody,
    /// UDS, write of the node ID.
    Uds,
    /// Commanded address: a restart follows.
    CommandedAddress,
}

/// One write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// The factory data of a new memory.
    Factory,
    /// The address.
    LocalLayer(LayerChange, LayerFor),
    /// The fault log as it is.
    FaultLog,
    /// DM3: the fault log without these, which were previously active when it came.
    ClearPreviouslyActive(FaultSet),
}

impl writes::Job for Job {
    fn key(self) -> RecordKey {
        match self {
            Self::Factory => RecordKey::Factory,
            Self::LocalLayer(..) => RecordKey::LocalLayer,
            Self::FaultLog | Self::ClearPreviouslyActive(..) => RecordKey::FaultLog,
        }
    }

    fn merged(self, newer: Self) -> Option<Self> {
        match (self, newer) {
            (Self::ClearPreviouslyActive(old), Self::ClearPreviouslyActive(new)) => {
                Some(Self::ClearPreviouslyActive(old.union(new)))
            }
            (Self::LocalLayer(_, old), Self::LocalLayer(_, new)) if old == new => Some(newer),
            _ => (self == newer).then_some(newer),
        }
    }
}

/// A DM3 that waits for the memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clearing {
    request: Request,
    /// The previously active faults when it came.
    asked: FaultSet,
}

impl IsobusValve {
    /// Takes DM3. An empty list needs no memory.
    pub(super) fn clear_previously_active(&mut self, request: Request, base: &mut Base<Job>) {
        let asked = self.auxiliary.previously_active_faults();
        if asked.is_empty() {
            self.node.acknowledge(&request, true);
        } else if self.clearing.push(Clearing { request, asked }).is_ok() {
            self.clearable = self.clearable.union(asked);
            base.writes.ask(Job::ClearPreviouslyActive(asked));
        } else {
            self.node.count_dropped(1);
        }
    }

    pub(super) fn encode_job(&self, job: Job) -> Result<Record, StoreError> {
        let counters = self.auxiliary.valve.counters();
        let version = version(writes::Job::key(job));
        match job {
            Job::Factory => seal(version, &self.factory.encode()),
            Job::LocalLayer(change, _) => seal(version, &self.local_layer.with(change).encode()),
            Job::FaultLog => seal(version, &FaultLog { counters }.encode()),
            Job::ClearPreviouslyActive(asked) => {
                let counters = counters.without(asked.intersection(self.clearable));
                seal(version, &FaultLog { counters }.encode())
            }
        }
    }

    /// Takes the memory's answer to a write.
    pub(super) fn end_job(&mut self, job: Job, stored: bool, base: &mut Base<Job>) {
        // While a restart waits no timer runs: a fault that is due by now is counted before DM3 clears what it asked for.
        self.auxiliary.valve.poll(base.now());
        self.settle(base);
        let record = u8::try_from(writes::Job::key(job).position()).unwrap_or(u8::MAX);
        self.auxiliary.valve.set_internal(InternalCause::Record(record), !stored, base.now());
        match job {
            Job::LocalLayer(change, asked_by) => {
                if stored {
                    self.local_layer = self.local_layer.with(change);
                }
                match asked_by {
                    LayerFor::Uds => self.node.answer(node_id_written(stored)),
                    LayerFor::CommandedAddress if stored => {
                        self.auxiliary.switch_off(base.now());
                        base.request_restart(Restart::Application);
                    }
                    LayerFor::CommandedAddress | LayerFor::Nobody => {}
                }
            }
            Job::ClearPreviouslyActive(asked) => self.end_clearing(asked, stored),
            Job::Factory | Job::FaultLog => {}
        }
    }

    /// Clears the counters in force when the memory has them cleared, and answers every DM3 that asked for no more.
    fn end_clearing(&mut self, asked: FaultSet, stored: bool) {
        if stored {
            self.auxiliary.valve.clear_counters(asked.intersection(self.clearable));
            // The memory holds the zeros already.
            self.auxiliary.valve.take_counters_changed();
        }
        let node = &mut self.node;
        self.clearing.retain(|clearing| {
            let answered = clearing.asked.difference(asked).is_empty();
            if answered {
                node.acknowledge(&clearing.request, stored);
            }
            !answered
        });
    }
}
