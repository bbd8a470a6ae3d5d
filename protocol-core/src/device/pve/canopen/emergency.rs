//! Reporting of faults by EMCYs and in the error history (SPEC 3, 4.2).

use super::super::fault_codes::{codes, register};
use super::CanopenValve;
use crate::actuator::{Fault, FaultSet, InternalCause};
use crate::device::Restart;
use crate::device::runtime::Base;
use crate::wire::emcy::Emcy;

impl CanopenValve {
    /// Reports the fault changes: each activation in order of priority, then the end of the last active fault.
    pub(super) fn report_changes(&mut self, base: &mut Base) {
        let now = base.now();
        self.node.renew_tpdo();
        let changes = self.objects.control.take_changes(now);
        let after = self.objects.control.valve.faults();
        // A fault that cleared at once appears in the register of its own EMCY only.
        let mut active = after.difference(changes.activated);
        for fault in changes.activated {
            let count = self.objects.control.valve.counters().get(fault);
            let message = fault_message(fault, active.union(FaultSet::of(fault)), count);
            self.node.tell_error(message, u16::from(count));
            active = active.union(FaultSet::of(fault).intersection(after));
        }
        if !changes.cleared.is_empty() && after.is_empty() {
            self.node.send_emcy(Emcy::default());
        }
        if self.objects.control.valve.take_counters_changed() {
            base.fault_log.changed(now);
        }
        if changes.activated.contains(Fault::Internal) {
            // Reported now, so the cause is cleared: a watchdog reset is momentary.
            self.objects.control.valve.set_internal(InternalCause::Watchdog, false, now);
            self.report_changes(base);
        }
    }

    /// Reports a start with an error-reset EMCY (R). After reset communication, reports the active faults again without
    /// counting them; after reset application, applies the persisting fault causes to the valve.
    pub(super) fn tell_start(&mut self, scope: Restart, base: &Base) {
        self.node.send_emcy(Emcy::default());
        let valve = &mut self.objects.control.valve;
        match scope {
            Restart::Communication => {
                let active = valve.faults();
                for fault in active {
                    let count = valve.counters().get(fault);
                    self.node.send_emcy(fault_message(fault, active, count));
                }
            }
            Restart::Application => self.causes.tell(valve, base.now()),
        }
    }
}

/// Encodes the EMCY of a fault: `code, error register, occurrence counter, 00 00 00 00` (R: the manual's use case
/// prints four bytes).
fn fault_message(fault: Fault, active: FaultSet, count: u8) -> Emcy {
    Emcy { code: codes(fault).emcy, register: register(active), manufacturer: [count, 0, 0, 0, 0] }
}
