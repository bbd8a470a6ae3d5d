//! The writes to the memory, and the clients that wait for them (SPEC 5, 6).

use heapless::VecView;

use super::super::records::{FaultLog, LocalLayer};
use super::IsobusValve;
use crate::actuator::{FaultSet, InternalCause};
use crate::device::Restart;
use crate::device::runtime::{Application, Base, Storing};
use crate::device::writes::{Requester, Write};
use crate::isobus::request::Request;
use crate::memory::RecordKey;
use crate::uds::node_id_written;

pub(super) const WRITES: [Write; 3] = [
    Write::new(RecordKey::LocalLayer, Requester::Uds),
    Write::new(RecordKey::LocalLayer, Requester::CommandedAddress),
    Write::new(RecordKey::FaultLog, Requester::Dm3),
];

/// A DM3 that waits for the memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clearing {
    request: Request,
    /// The previously active faults at the time of the DM3.
    asked: FaultSet,
}

impl IsobusValve {
    /// Handles a DM3. A DM3 without previously active faults is acknowledged at once.
    pub(super) fn clear_previously_active(&mut self, request: Request, base: &mut Base) {
        let asked = self.auxiliary.previously_active_faults();
        if asked.is_empty() {
            self.node.acknowledge(&request, true);
        } else if self.clearing.push(Clearing { request, asked }).is_ok() {
            self.clearable = self.clearable.union(asked);
            base.writes.request(Write::new(RecordKey::FaultLog, Requester::Dm3).with(asked.bits()));
        } else {
            self.node.count_dropped(1);
        }
    }

    /// Returns the local layer that a write stores.
    fn layer_after(&self, write: Write) -> LocalLayer {
        match write.requester {
            Requester::Uds | Requester::CommandedAddress => {
                LocalLayer { node_id: Some(write.value), ..self.local_layer }
            }
            _ => self.local_layer,
        }
    }

    /// Handles the result of a write for DM3. If the write was `stored`, the counters of the faults in `asked` are
    /// cleared, except the counters of faults that have occurred again.
    ///
    /// Each DM3 whose faults are all in `asked` gets its answer. After a failure, a DM3 that the waiting write also
    /// covers gets its answer after that write (A).
    fn end_clearing(&mut self, asked: FaultSet, stored: bool, base: &Base) {
        let mut later = FaultSet::EMPTY;
        if stored {
            self.auxiliary.valve.clear_counters(asked.intersection(self.clearable));
        } else if let Some(waiting) = base.writes.iter().find(|write| write.requester == Requester::Dm3) {
            later = FaultSet::from_bits(waiting.value);
        }
        let node = &mut self.node;
        self.clearing.retain(|clearing| {
            let is_in = |faults| clearing.asked.difference(faults).is_empty();
            let answered = is_in(asked) && !is_in(later);
            if answered {
                node.acknowledge(&clearing.request, stored);
            }
            !answered
        });
    }
}

impl Storing for IsobusValve {
    fn encode(&mut self, write: Write, payload: &mut VecView<u8>) -> Option<()> {
        let bytes: &[u8] = match write.record {
            RecordKey::Factory => &self.factory.encode(),
            RecordKey::LocalLayer => &self.layer_after(write).encode(),
            RecordKey::FaultLog => {
                let cleared = FaultSet::from_bits(write.value).intersection(self.clearable);
                &FaultLog { counters: self.auxiliary.valve.counters().without(cleared) }.encode()
            }
            RecordKey::Parameters | RecordKey::RestoreFlag | RecordKey::Application => return None,
        };
        payload.extend_from_slice(bytes).ok()
    }

    fn written(&mut self, write: Write, stored: bool, base: &mut Base) {
        // A fault that is due must count before DM3 clears its counter.
        self.auxiliary.valve.poll(base.now());
        self.apply_changes(base);
        let position = write.record.position() as u8;
        self.auxiliary.valve.set_internal(InternalCause::Record(position), !stored, base.now());
        if stored {
            self.local_layer = self.layer_after(write);
        }
        match write.requester {
            Requester::Uds => self.node.answer(node_id_written(stored)),
            Requester::CommandedAddress if stored => {
                self.auxiliary.switch_off(base.now());
                base.request_restart(Restart::Application);
            }
            Requester::Dm3 => self.end_clearing(FaultSet::from_bits(write.value), stored, base),
            _ => {}
        }
    }
}
