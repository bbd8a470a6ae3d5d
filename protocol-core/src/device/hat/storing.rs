//! Writes to the memory: what each holds, and who waits for it (SPEC 6, 9).

use super::HatSensor;
use super::objects::{Part, Task};
use super::records::{LAYER, VERSION};
use crate::canopen::dictionary::Group;
use crate::device::host::Base;
use crate::device::writes;
use crate::memory::{RECORD_MAX, Record, RecordKey, StoreError, seal};

/// One write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// The factory data of a new memory.
    Factory,
    /// Node ID and bit rate of a new memory.
    LocalLayer,
    /// LSS store: what LSS has configured by then.
    LssStore,
    /// "save" or "load" of one record.
    Part(RecordKey, Task),
}

impl writes::Job for Job {
    fn key(self) -> RecordKey {
        match self {
            Self::Factory => RecordKey::Factory,
            Self::LocalLayer | Self::LssStore => RecordKey::LocalLayer,
            Self::Part(key, _) => key,
        }
    }

    /// Of two tasks on one record the newer one counts: its client has given the older one up.
    fn merged(self, newer: Self) -> Option<Self> {
        match (self, newer) {
            (Self::Part(key, _), Self::Part(newer_key, _)) if key == newer_key => Some(newer),
            _ => (self == newer).then_some(newer),
        }
    }
}

/// The records of a part.
const fn records(part: Part) -> &'static [RecordKey] {
    match part {
        Part::All => &[RecordKey::Parameters, RecordKey::Application],
        Part::Communication => &[RecordKey::Parameters],
        Part::Application => &[RecordKey::Application],
        Part::Lss => &[RecordKey::LocalLayer],
    }
}

/// The bit of a record in a set.
pub(super) const fn bit(key: RecordKey) -> u8 {
    1 << key.position()
}

impl HatSensor {
    /// Begins what an SDO client waits for.
    pub(super) fn begin_task(&mut self, task: Task, base: &mut Base<Job>) {
        self.failed = None;
        let (Task::Save(part) | Task::Load(part)) = task;
        for key in records(part) {
            base.writes.ask(Job::Part(*key, task));
        }
    }

    pub(super) fn encode_job(&mut self, job: Job) -> Result<Record, StoreError> {
        match job {
            Job::Factory => seal(VERSION, &self.objects.identity.serial.to_le_bytes()),
            Job::LocalLayer => seal(VERSION, &self.layer.encode()),
            Job::LssStore => {
                self.lss_in_flight = self.node.unstored();
                self.layer_in_flight = self.layer.with(self.lss_in_flight);
                seal(VERSION, &self.layer_in_flight.encode())
            }
            Job::Part(RecordKey::LocalLayer, task) => {
                self.layer_in_flight = match task {
                    Task::Save(_) => self.objects.demanded,
                    Task::Load(_) => LAYER,
                };
                seal(VERSION, &self.layer_in_flight.encode())
            }
            // The defaults: communication objects follow the node ID again.
            Job::Part(_, Task::Load(_)) => seal(VERSION, &[]),
            Job::Part(key, Task::Save(_)) => {
                let group = if key == RecordKey::Application { Group::Application } else { Group::Communication };
                let payload = self.node.parameters::<RECORD_MAX>(group, &self.objects);
                seal(VERSION, &payload.ok_or(StoreError)?)
            }
        }
    }

    /// Takes the memory's answer to a write: a failed one is told to whoever waits for it, and to nobody else.
    pub(super) fn end_job(&mut self, job: Job, stored: bool, base: &mut Base<Job>) {
        let key = writes::Job::key(job);
        if stored {
            self.set_damaged(self.damaged & !bit(key), base);
        }
        match job {
            Job::Factory | Job::LocalLayer => {}
            Job::LssStore => {
                if stored {
                    self.layer = self.layer_in_flight;
                    self.objects.demanded = self.objects.demanded.with(self.lss_in_flight);
                    self.node.configuration_stored(self.lss_in_flight);
                }
                let is_last = base.writes.iter().all(|waiting| *waiting != Job::LssStore);
                self.node.end_lss_store(stored, is_last);
            }
            Job::Part(key, task) => {
                if stored && key == RecordKey::LocalLayer {
                    self.layer = self.layer_in_flight;
                    self.node.configuration_stored(self.layer.configuration());
                }
                // Asked for again while it was in flight, the record is written once more: that write is the client's.
                if !stored && base.writes.iter().all(|waiting| *waiting != job) {
                    self.failed = Some(task);
                }
                let waits = |waiting: &Job| matches!(waiting, Job::Part(_, other) if *other == task);
                if !base.writes.iter().any(waits) {
                    self.node.end_task(task, self.failed != Some(task));
                }
            }
        }
    }
}
