//! Writes to the memory: what each holds, and who waits for it (SPEC 4.5, 6).

use super::super::dictionary::Task;
use super::super::found::Found;
use super::super::records::{FaultLog, LayerChange, encode_flag, version};
use super::CanopenValve;
use super::load::Executed;
use crate::actuator::{FaultSet, InternalCause};
use crate::canopen::dictionary::Group;
use crate::canopen::lss::Configuration;
use crate::device::host::Base;
use crate::device::writes;
use crate::memory::{RECORD_MAX, Record, RecordKey, StoreError, seal};
use crate::uds::node_id_written;
use crate::wire::lss::LssNodeId;

/// One write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// The factory data of a new memory.
    Factory,
    /// Node ID and bit rate of a new memory.
    LocalLayer,
    /// LSS store: what LSS has configured by then.
    LssStore,
    /// UDS: a node ID.
    UdsNodeId(u8),
    /// "save": the parameters as they are.
    Save,
    /// The defaults, at the start that executes "load".
    Restore,
    /// The restore flag as it is to be.
    RestoreFlag,
    /// The fault log with all counts cleared.
    ClearCounters,
    /// The fault log.
    FaultLog,
}

impl writes::Job for Job {
    fn key(self) -> RecordKey {
        match self {
            Self::Factory => RecordKey::Factory,
            Self::LocalLayer | Self::LssStore | Self::UdsNodeId(_) => RecordKey::LocalLayer,
            Self::Save | Self::Restore => RecordKey::Parameters,
            Self::RestoreFlag => RecordKey::RestoreFlag,
            Self::ClearCounters | Self::FaultLog => RecordKey::FaultLog,
        }
    }

    fn merged(self, newer: Self) -> Option<Self> {
        (self == newer).then_some(newer)
    }
}

impl CanopenValve {
    /// Begins what an SDO client waits for.
    pub(super) fn begin_task(&mut self, task: Task, base: &mut Base<Job>) {
        match task {
            Task::Save => base.writes.ask(Job::Save),
            Task::Load => {
                self.load.asked = true;
                base.writes.ask(Job::RestoreFlag);
            }
            Task::ClearCounters => base.writes.ask(Job::ClearCounters),
        }
    }

    /// Asks for what a new memory lacks, and for the defaults where "load" is executed.
    pub(super) fn fill(&mut self, found: &Found<'_>, base: &mut Base<Job>) {
        for (key, job) in [(RecordKey::Factory, Job::Factory), (RecordKey::LocalLayer, Job::LocalLayer)] {
            if found.is_absent(key) {
                base.writes.ask(job);
            }
        }
        self.continue_load(base);
    }

    /// Tries again what an executed "load" could not write.
    pub(super) fn retry_load(&mut self, base: &mut Base<Job>) {
        if self.load.retry(base.now(), !base.writes.is_idle()) {
            self.continue_load(base);
        }
    }

    fn continue_load(&mut self, base: &mut Base<Job>) {
        match self.load.executed {
            Executed::Done => {}
            Executed::DefaultsUnstored => base.writes.ask(Job::Restore),
            Executed::FlagUncleared => base.writes.ask(Job::RestoreFlag),
        }
    }

    pub(super) fn encode_job(&mut self, job: Job) -> Result<Record, StoreError> {
        let version = version(writes::Job::key(job));
        let layer = self.local_layer;
        match job {
            Job::Factory => seal(version, &self.objects.factory().encode()),
            Job::LocalLayer => seal(version, &layer.encode()),
            Job::LssStore => {
                self.lss_in_flight = self.node.unstored();
                seal(version, &layer.with(change_of(self.lss_in_flight)).encode())
            }
            Job::UdsNodeId(raw) => seal(version, &layer.with(LayerChange::node_id(raw)).encode()),
            Job::Save => {
                let payload = self.node.parameters::<RECORD_MAX>(Group::All, &self.objects);
                seal(version, &payload.ok_or(StoreError)?)
            }
            Job::Restore => {
                let payload = self.node.default_parameters::<RECORD_MAX>(&self.objects);
                seal(version, &payload.ok_or(StoreError)?)
            }
            Job::RestoreFlag => seal(version, &encode_flag(self.load.asked)),
            Job::ClearCounters => {
                // A fault that activates from now on counts one.
                let valve = &mut self.objects.application.valve;
                self.cleared = valve.counters();
                valve.clear_counters(FaultSet::ALL);
                valve.take_counters_changed();
                seal(version, &FaultLog::default().encode())
            }
            Job::FaultLog => {
                let counters = self.objects.application.valve.counters();
                seal(version, &FaultLog { counters }.encode())
            }
        }
    }

    /// Takes the memory's answer to a write. An SDO client is answered by the last of equal writes: its own.
    pub(super) fn end_job(&mut self, job: Job, stored: bool, base: &mut Base<Job>) {
        let now = base.now();
        let record = u8::try_from(writes::Job::key(job).position()).unwrap_or(u8::MAX);
        self.objects.application.valve.set_internal(InternalCause::Record(record), !stored, now);
        let is_last = |job: Job, base: &Base<Job>| base.writes.iter().all(|waiting| *waiting != job);
        match job {
            Job::Factory | Job::LocalLayer | Job::FaultLog => {}
            Job::LssStore => {
                if stored {
                    self.local_layer = self.local_layer.with(change_of(self.lss_in_flight));
                    self.node.configuration_stored(self.lss_in_flight);
                }
                self.node.end_lss_store(stored, is_last(job, base));
            }
            Job::UdsNodeId(raw) => {
                if stored {
                    self.local_layer = self.local_layer.with(LayerChange::node_id(raw));
                    self.node.configuration_stored(Configuration { node_id: LssNodeId::new(raw), bit_rate: None });
                }
                self.node.answer(node_id_written(stored));
            }
            Job::Save => {
                if stored && self.load.parameters_stored() {
                    self.load.save_waits = true;
                    base.writes.ask_first(Job::RestoreFlag);
                } else if is_last(job, base) {
                    self.node.end_task(Task::Save, stored);
                }
            }
            Job::Restore => {
                if !stored {
                    self.load.failed(now);
                } else if self.load.parameters_stored() {
                    base.writes.ask_first(Job::RestoreFlag);
                }
            }
            Job::RestoreFlag => {
                if stored {
                    self.load.flag_stored();
                } else {
                    self.load.failed(now);
                    // A newer "load" that waits is asked for still.
                    self.load.asked &= !is_last(job, base);
                }
                if core::mem::take(&mut self.load.save_waits) && is_last(Job::Save, base) {
                    self.node.end_task(Task::Save, stored);
                }
                if is_last(job, base) {
                    self.node.end_task(Task::Load, stored);
                }
            }
            Job::ClearCounters => {
                if !stored {
                    self.objects.application.valve.add_counters(self.cleared);
                }
                if is_last(job, base) {
                    self.node.end_task(Task::ClearCounters, stored);
                }
            }
        }
    }
}

/// What an LSS store changes of the local layer.
fn change_of(configuration: Configuration) -> LayerChange {
    LayerChange { node_id: configuration.node_id.map(LssNodeId::get), bit_rate: configuration.bit_rate }
}
