//! Faults become EMCYs, and entries of the error history (SPEC 3, 4.2).

use super::super::fault_codes::{codes, register};
use super::{BootUp, PveCanopen, Restarting};
use crate::actuator::{Fault, FaultSet, InternalCause};
use crate::frame::Frame;
use crate::time::Instant;
use crate::wire::cob_id::Function;
use crate::wire::emcy::Emcy;

impl PveCanopen {
    /// Tells what became of the faults since last time: each activation by priority, then the end of the last one.
    #[inline]
    pub(super) fn report_faults(&mut self, now: Instant) {
        if self.objects.application.valve.has_changes() {
            self.report_changes(now);
        }
    }

    #[inline(never)]
    fn report_changes(&mut self, now: Instant) {
        let changes = self.objects.application.take_changes(now);
        let after = self.objects.application.valve.faults();
        let mut active = after.union(changes.cleared).difference(changes.activated);
        for fault in changes.activated {
            active.insert(fault);
            let count = self.objects.application.valve.counters().get(fault);
            self.objects.history.enter(codes(fault).emcy, u16::from(count));
            self.send_emcy(fault_message(fault, active, count));
        }
        if !changes.cleared.is_empty() && after.is_empty() {
            self.send_emcy(Emcy::default());
        }
        if self.objects.application.valve.take_counters_changed() {
            self.spare_counters(changes.activated);
            self.fault_log.changed(now);
        }
        if changes.activated.contains(Fault::Internal) {
            // Reported now, so its cause is gone: a watchdog reset is nothing that lasts.
            self.objects.application.valve.set_internal(InternalCause::Watchdog, false, now);
            self.report_faults(now);
        }
    }

    /// After a reset of the communication: what is active all the same, not counted again.
    pub(super) fn repeat_faults(&mut self) {
        let active = self.objects.application.valve.faults();
        for fault in active {
            let count = self.objects.application.valve.counters().get(fault);
            self.send_emcy(fault_message(fault, active, count));
        }
    }

    /// Lets out what waited, when the boot-up is out and the bus can be used.
    pub(super) fn release_emcys(&mut self) {
        if self.boot_up != BootUp::Done || self.is_mute() {
            return;
        }
        let Some(node_id) = self.objects.node_id else { return };
        while let Some(message) = self.emcys.pop() {
            self.tx.push(Frame::full(node_id.id(Function::Emcy).into(), message.emit()));
        }
    }

    /// EMCYs are sent in pre-operational and operational, not while a restart is due; while the bus cannot be used they
    /// wait.
    pub(super) fn send_emcy(&mut self, message: Emcy) {
        if !self.nmt.serves() || self.restarting != Restarting::No {
            return;
        }
        if !self.emcys.push(message) {
            self.tx.count_dropped();
        }
        self.release_emcys();
    }
}

/// `code, error register, occurrence counter, 00 00 00 00` (R: the manual's use case prints four bytes).
fn fault_message(fault: Fault, active: FaultSet, count: u8) -> Emcy {
    Emcy { code: codes(fault).emcy, register: register(active), manufacturer: [count, 0, 0, 0, 0] }
}
