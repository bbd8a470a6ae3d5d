//! The writes to the memory: their payloads and the clients that wait for them (SPEC 4.5, 6).

use heapless::VecView;

use super::super::dictionary::Task;
use super::super::records::{FaultLog, LocalLayer, encode_flag};
use super::CanopenValve;
use super::load::Executed;
use crate::actuator::InternalCause;
use crate::canopen::dictionary::Group;
use crate::canopen::lss::Configuration;
use crate::device::runtime::{Base, Storing};
use crate::device::writes::{Requester, Write};
use crate::memory::RecordKey;
use crate::uds::node_id_written;
use crate::wire::lss::LssNodeId;

/// The write of the present parameters, for "save".
const SAVE: Write = Write::new(RecordKey::Parameters, Requester::Sdo);
/// The write of the defaults, for an executed "load".
const RESTORE: Write = Write::new(RecordKey::Parameters, Requester::Device);
/// The write of the restore flag.
const RESTORE_FLAG: Write = Write::new(RecordKey::RestoreFlag, Requester::Device);
/// The write of the restore flag that completes a client's "save".
const FLAG_OF_SAVE: Write = Write::new(RecordKey::RestoreFlag, Requester::Sdo);
/// The write of the fault log with all counters cleared.
const CLEAR_COUNTERS: Write = Write::new(RecordKey::FaultLog, Requester::Sdo);

pub(super) const WRITES: [Write; 7] = [
    Write::new(RecordKey::LocalLayer, Requester::Lss),
    Write::new(RecordKey::LocalLayer, Requester::Uds),
    SAVE,
    RESTORE,
    RESTORE_FLAG,
    FLAG_OF_SAVE,
    CLEAR_COUNTERS,
];

impl CanopenValve {
    /// Requests the write of a task for an SDO client.
    pub(super) fn begin_task(&mut self, task: Task, base: &mut Base) {
        base.writes.request(match task {
            Task::Save => SAVE,
            Task::Load => {
                self.load.demand();
                RESTORE_FLAG
            }
            Task::ClearCounters => CLEAR_COUNTERS,
        });
    }

    /// Repeats a failed write of an executed "load" when it is due.
    pub(super) fn retry_load(&mut self, base: &mut Base) {
        if self.load.retry(base.now(), !base.writes.is_idle()) {
            self.continue_load(base);
        }
    }

    /// Requests the next write of an executed "load": first the defaults, then the restore flag.
    pub(super) fn continue_load(&mut self, base: &mut Base) {
        match self.load.executed {
            Executed::Done => {}
            Executed::DefaultsUnstored => base.writes.request(RESTORE),
            Executed::FlagUncleared => base.writes.request(RESTORE_FLAG),
        }
    }

    /// Returns the local layer that the write in progress stores.
    fn layer_to_store(&self) -> LocalLayer {
        let Configuration { node_id, bit_rate } = self.layer_in_flight;
        LocalLayer {
            node_id: node_id.map(LssNodeId::get).or(self.local_layer.node_id),
            bit_rate: bit_rate.unwrap_or(self.local_layer.bit_rate),
        }
    }

    /// Answers the SDO client of a task if `is_last`, which means that no equal write waits.
    fn end_task(&mut self, task: Task, stored: bool, is_last: bool) {
        if is_last {
            self.node.end_task(task, stored);
        }
    }
}

impl Storing for CanopenValve {
    fn encode(&mut self, write: Write, payload: &mut VecView<u8>) -> Option<()> {
        let bytes: &[u8] = match write.record {
            RecordKey::Factory => &self.objects.factory().encode(),
            RecordKey::LocalLayer => {
                self.layer_in_flight = match write.requester {
                    Requester::Lss => self.node.begin_lss_store(),
                    Requester::Uds => Configuration { node_id: LssNodeId::new(write.value), bit_rate: None },
                    _ => Configuration::NONE,
                };
                &self.layer_to_store().encode()
            }
            RecordKey::Parameters if write.requester == Requester::Sdo => {
                return self.node.parameters(Group::All, &self.objects, payload);
            }
            RecordKey::Parameters => return self.node.default_parameters(&self.objects, payload),
            RecordKey::RestoreFlag => &encode_flag(self.load.flag()),
            RecordKey::FaultLog => {
                let valve = &mut self.objects.control.valve;
                if write.requester == Requester::Sdo {
                    // Activations from now on count from zero.
                    self.cleared = valve.take_counters();
                }
                &FaultLog { counters: valve.counters() }.encode()
            }
            RecordKey::Application => return None,
        };
        payload.extend_from_slice(bytes).ok()
    }

    /// Handles the result of a write. The last of several equal writes decides the answer to the SDO client.
    fn written(&mut self, write: Write, stored: bool, base: &mut Base) {
        let now = base.now();
        let position = write.record.position() as u8;
        self.objects.control.valve.set_internal(InternalCause::Record(position), !stored, now);
        let by_client = write.requester == Requester::Sdo;
        let is_last = !base.writes.contains(write);
        match write.record {
            RecordKey::LocalLayer => {
                if stored {
                    self.local_layer = self.layer_to_store();
                    self.node.configuration_stored(self.layer_in_flight);
                }
                match write.requester {
                    Requester::Lss => self.node.end_lss_store(stored, is_last),
                    Requester::Uds => self.node.answer(node_id_written(stored)),
                    _ => {}
                }
            }
            RecordKey::Parameters => {
                if stored && self.load.parameters_stored() {
                    base.writes.request_first(if by_client { FLAG_OF_SAVE } else { RESTORE_FLAG });
                } else if by_client {
                    self.end_task(Task::Save, stored, is_last);
                } else if !stored {
                    self.load.failed(now);
                }
            }
            RecordKey::RestoreFlag => {
                let is_last = !base.writes.contains(RESTORE_FLAG);
                self.load.flag_written(stored, is_last, now);
                if by_client {
                    self.end_task(Task::Save, stored, !base.writes.contains(SAVE));
                }
                self.end_task(Task::Load, stored, is_last);
            }
            RecordKey::FaultLog if by_client => {
                if !stored {
                    self.objects.control.valve.add_counters(self.cleared);
                }
                self.end_task(Task::ClearCounters, stored, is_last);
            }
            RecordKey::Factory | RecordKey::FaultLog | RecordKey::Application => {}
        }
    }
}
