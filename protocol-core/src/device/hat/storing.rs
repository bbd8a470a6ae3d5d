//! The writes to the memory: their payloads and the clients that wait for them (SPEC 6, 9).

use heapless::VecView;

use super::HatSensor;
use super::dictionary::{Part, Task};
use super::records::LAYER;
use crate::canopen::dictionary::Group;
use crate::canopen::lss::Configuration;
use crate::device::Restart;
use crate::device::runtime::{Base, Storing};
use crate::device::writes::{Requester, Write};
use crate::memory::RecordKey;

/// The writes of LSS, "save" and "load".
pub(super) const WRITES: [Write; 4] = [
    Write::new(RecordKey::LocalLayer, Requester::Lss),
    Write::new(RecordKey::LocalLayer, Requester::Sdo),
    Write::new(RecordKey::Parameters, Requester::Sdo),
    Write::new(RecordKey::Application, Requester::Sdo),
];

/// Returns the bit of a record in a mask of records.
pub(super) const fn bit(key: RecordKey) -> u8 {
    1 << key.position()
}

/// The bit in a write's value that distinguishes "load" from "save".
const LOADS: u8 = 1 << 7;

/// Returns the value for the writes of a task: the bits of its records, and [`LOADS`].
const fn value_of(task: Task) -> u8 {
    let (Task::Save(part) | Task::Load(part)) = task;
    let records = match part {
        Part::All => bit(RecordKey::Parameters) | bit(RecordKey::Application),
        Part::Communication => bit(RecordKey::Parameters),
        Part::Application => bit(RecordKey::Application),
        Part::Lss => bit(RecordKey::LocalLayer),
    };
    if matches!(task, Task::Load(_)) { records | LOADS } else { records }
}

impl HatSensor {
    /// Begins a task for an SDO client. The task overwrites a queued write of the same record, because the earlier
    /// client no longer waits.
    pub(super) fn begin_task(&mut self, task: Task, base: &mut Base) {
        self.task = Some(task);
        self.task_failed = false;
        let value = value_of(task);
        for record in RecordKey::ALL.into_iter().filter(|record| value & bit(*record) != 0) {
            base.writes.request(Write::new(record, Requester::Sdo).with(value));
        }
    }
}

impl Storing for HatSensor {
    fn encode(&mut self, write: Write, payload: &mut VecView<u8>) -> Option<()> {
        let loads = write.value & LOADS != 0;
        let bytes: &[u8] = match write.record {
            RecordKey::Factory => &self.objects.identity.serial.to_le_bytes(),
            RecordKey::LocalLayer => {
                self.layer_in_flight = match write.requester {
                    Requester::Lss => self.node.begin_lss_store(),
                    Requester::Sdo if loads => LAYER.configuration(),
                    Requester::Sdo => self.objects.demanded.configuration(),
                    _ => Configuration::NONE,
                };
                &self.layer.with(self.layer_in_flight).encode()
            }
            // An empty payload stands for the defaults, with COB-IDs that follow the node ID again.
            _ if loads => &[],
            record => {
                let group = if record == RecordKey::Application { Group::Application } else { Group::Communication };
                return self.node.parameters(group, &self.objects, payload);
            }
        };
        payload.extend_from_slice(bytes).ok()
    }

    /// Handles the result of a write. A failure is reported only to the client that waits for the write.
    fn written(&mut self, write: Write, stored: bool, base: &mut Base) {
        if stored {
            self.set_damaged(self.damaged & !bit(write.record), base);
            if write.record == RecordKey::LocalLayer {
                self.layer = self.layer.with(self.layer_in_flight);
                self.node.configuration_stored(self.layer_in_flight);
            }
        }
        let is_last = !base.writes.contains(write);
        match write.requester {
            Requester::Lss => {
                if stored {
                    let stored = self.objects.demanded_since.or(self.layer_in_flight);
                    self.objects.demanded = self.objects.demanded.with(stored);
                }
                self.node.end_lss_store(stored, is_last);
                if self.node.must_boot() {
                    base.request_restart(Restart::Communication);
                }
            }
            Requester::Sdo => {
                let Some(task) = self.task.filter(|task| value_of(*task) == write.value) else { return };
                // If the record was requested again during the write, the next write decides.
                self.task_failed |= !stored && is_last;
                if !base.writes.iter().any(|other| other.requester == Requester::Sdo && other.value == write.value) {
                    self.node.end_task(task, !self.task_failed);
                }
            }
            _ => {}
        }
    }
}
