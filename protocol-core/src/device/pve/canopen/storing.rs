//! Writes to the memory: what is handed out, and who is told when it is done (SPEC 4.5, 6).

use super::super::dictionary::TABLE;
use super::super::objects::default_value;
use super::super::records::{FaultLog, LayerChange, encode_flag, version};
use super::super::storage::{self, Job as _};
use super::PveCanopen;
use crate::actuator::{FaultSet, InternalCause};
use crate::canopen::dictionary::Objects as _;
use crate::canopen::parameters;
use crate::device::Effect;
use crate::memory::{RECORD_MAX, Record, RecordKey, StoreError, seal};
use crate::time::Instant;
use crate::uds::node_id_written;
use crate::wire::lss;
use crate::wire::sdo::AbortCode;

/// Tells an SDO client's request from the ones it has given up.
pub(super) type Ticket = u8;

/// Who waits for the local layer to be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LayerFor {
    /// Nobody: the first start.
    Nobody,
    /// LSS store.
    Lss,
    /// UDS, write of the node ID.
    Uds,
}

/// One write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Job {
    /// The factory data of a new memory.
    Factory,
    /// Node ID and bit rate.
    LocalLayer(LayerChange, LayerFor),
    /// "save": the parameters as they are.
    Save(Ticket),
    /// The defaults, at the start that executes "load"; clears the flag when they are stored.
    Restore,
    /// "load": sets the flag.
    SetRestoreFlag(Ticket),
    /// "load" has been executed.
    ClearRestoreFlag,
    /// Zeros into the fault log, for all but the faults that occur meanwhile.
    ClearCounters(Ticket, FaultSet),
    /// The fault log as it is.
    FaultLog,
}

impl storage::Job for Job {
    fn key(self) -> RecordKey {
        match self {
            Self::Factory => RecordKey::Factory,
            Self::LocalLayer(..) => RecordKey::LocalLayer,
            Self::Save(_) | Self::Restore => RecordKey::Parameters,
            Self::SetRestoreFlag(_) | Self::ClearRestoreFlag => RecordKey::RestoreFlag,
            Self::ClearCounters(..) | Self::FaultLog => RecordKey::FaultLog,
        }
    }
}

impl PveCanopen {
    /// The next record to be written, encoded as things are now.
    pub(super) fn next_write(&mut self) -> Option<Effect> {
        loop {
            let job = self.storage.begin()?;
            match self.encode(job) {
                Ok(record) => return Some(Effect::Store(job.key(), record)),
                // Cannot happen with the records of this device: none is longer than a record holds.
                Err(StoreError) => self.written(job.key(), false, self.objects.now),
            }
        }
    }

    /// The fault log is due.
    pub(super) fn store_fault_log(&mut self) {
        if self.storage.ask(Job::FaultLog) {
            self.fault_log.begun();
        }
    }

    /// Faults that occur while the counters are being cleared are spared.
    pub(super) fn spare_counters(&mut self, activated: FaultSet) {
        if let Some(Job::ClearCounters(_, spared)) = self.storage.in_flight_mut() {
            *spared = spared.union(activated);
        }
    }

    /// The memory has answered.
    pub(super) fn written(&mut self, key: RecordKey, stored: bool, now: Instant) {
        let Some(job) = self.storage.end(key) else { return };
        let cause = InternalCause::Record(u8::try_from(key.position()).unwrap_or(u8::MAX));
        self.objects.application.valve.set_internal(cause, !stored, now);
        match job {
            Job::Factory | Job::ClearRestoreFlag => {}
            Job::Restore => {
                if stored {
                    // The queue was begun with this job: there is room.
                    let _ = self.storage.ask(Job::ClearRestoreFlag);
                }
            }
            Job::LocalLayer(change, asked_by) => {
                if stored {
                    self.local_layer = self.local_layer.with(change);
                    self.held_node_id = None;
                    self.held_bit_rate = self.held_bit_rate.filter(|held| *held != self.local_layer.bit_rate);
                }
                self.answer_layer(asked_by, stored);
            }
            Job::Save(ticket) | Job::SetRestoreFlag(ticket) => self.answer_sdo(ticket, stored),
            Job::ClearCounters(ticket, spared) => {
                if stored {
                    let valve = &mut self.objects.application.valve;
                    valve.clear_counters(FaultSet::ALL.difference(spared));
                    // The memory holds the zeros already; what was spared has made itself known.
                    valve.take_counters_changed();
                }
                self.fault_log.ended(stored, now);
                self.answer_sdo(ticket, stored);
            }
            Job::FaultLog => self.fault_log.ended(stored, now),
        }
    }

    fn answer_sdo(&mut self, ticket: Ticket, stored: bool) {
        if ticket != self.ticket {
            return;
        }
        let result = if stored { Ok(()) } else { Err(AbortCode::HARDWARE) };
        if let Some(answer) = self.sdo.stored(result) {
            self.send_sdo(answer);
        }
    }

    fn answer_layer(&mut self, asked_by: LayerFor, stored: bool) {
        match asked_by {
            LayerFor::Nobody => {}
            LayerFor::Lss => {
                let error = if stored { lss::StoreError::None } else { lss::StoreError::Access };
                self.send_lss(lss::Answer::Stored(error));
            }
            LayerFor::Uds => self.send(node_id_written(stored)),
        }
    }

    fn encode(&self, job: Job) -> Result<Record, StoreError> {
        let version = version(job.key());
        let counters = self.objects.application.valve.counters();
        match job {
            Job::Factory => seal(version, &self.objects.factory.encode()),
            Job::LocalLayer(change, _) => seal(version, &self.local_layer.with(change).encode()),
            Job::Save(_) => {
                let payload = parameters::encode::<RECORD_MAX>(TABLE, |entry| self.objects.read(entry.object).ok());
                seal(version, &payload.ok_or(StoreError)?)
            }
            Job::Restore => {
                let (kind, node_id) = (self.objects.kind, self.objects.node_id);
                let payload = parameters::encode::<RECORD_MAX>(TABLE, |entry| default_value(entry, kind, node_id));
                seal(version, &payload.ok_or(StoreError)?)
            }
            Job::SetRestoreFlag(_) => seal(version, &encode_flag(true)),
            Job::ClearRestoreFlag => seal(version, &encode_flag(false)),
            Job::ClearCounters(..) => seal(version, &FaultLog::default().encode()),
            Job::FaultLog => seal(version, &FaultLog { counters }.encode()),
        }
    }
}
