//! The reports of faults by EMCYs and in the error history (SPEC 3, 4.2).

use super::super::fault_codes::{codes, register};
use super::CanopenValve;
use crate::actuator::{Fault, FaultSet, InternalCause};
use crate::device::Restart;
use crate::device::runtime::Base;
use crate::wire::emcy::Emcy;

impl CanopenValve {
    /// Reports the fault changes: each activation in order of priority, then the end of the last fault.
    pub(super) fn report_changes(&mut self, base: &mut Base) {
        let now = base.now();
        self.node.renew_tpdo();
        let changes = self.objects.control.take_changes(now);
        let after = self.objects.control.valve.faults();
        // A fault that has already cleared appears only in the error register of its own EMCY.
        let mut active = after.difference(changes.activated);
        for fault in changes.activated {
            let count = self.objects.control.valve.counters().get(fault);
            let message = fault_message(fault, active.union(FaultSet::of(fault)), count);
            self.node.report_error(message, u16::from(count));
            active = active.union(FaultSet::of(fault).intersection(after));
        }
        if !changes.cleared.is_empty() && after.is_empty() {
            self.node.send_emcy(Emcy::default());
        }
        if self.objects.control.valve.take_counters_changed() {
            base.fault_log.changed(now);
        }
        if changes.activated.contains(Fault::Internal) {
            // A watchdog reset is momentary: its cause ends with the report.
            self.objects.control.valve.set_internal(InternalCause::Watchdog, false, now);
            self.report_changes(base);
        }
    }

    /// Reports a start with the error-reset EMCY (R). After reset communication, reports the active faults again
    /// without counting them. After reset application, applies the lasting causes of faults to the valve.
    pub(super) fn report_start(&mut self, scope: Restart, base: &Base) {
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
            Restart::Application => self.causes.apply(valve, base.now()),
        }
    }
}

/// Encodes the EMCY of a fault: `code, error register, occurrence counter, 00 00 00 00`. (R) A use case of the manual
/// prints four bytes.
fn fault_message(fault: Fault, active: FaultSet, count: u8) -> Emcy {
    Emcy { code: codes(fault).emcy, register: register(active), manufacturer: [count, 0, 0, 0, 0] }
}
