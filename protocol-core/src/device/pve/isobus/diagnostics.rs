//! Faults become DM1; what was active before becomes DM2, until DM3 clears it (SPEC 3, 5).

use heapless::Vec;

use super::super::fault_codes::codes;
use super::PveIsobus;
use super::storing::Job;
use crate::actuator::{Fault, FaultSet, InternalCause};
use crate::isobus::diagnostics::answer_dm2;
use crate::isobus::request::Request;
use crate::time::Instant;
use crate::wire::dm::Trouble;
use crate::wire::j1939_id::Address;

impl PveIsobus {
    /// Tells what became of the faults since last time: what was activated, then what is left when others are gone.
    #[inline]
    pub(super) fn report_faults(&mut self, now: Instant) {
        if self.commander.valve.has_changes() {
            self.report_changes(now);
        }
    }

    #[inline(never)]
    fn report_changes(&mut self, now: Instant) {
        let changes = self.commander.take_changes(now);
        let after = self.commander.valve.faults();
        // A fault that is active again is no longer one that was.
        let listed = self.previously_active;
        self.previously_active = listed.difference(changes.activated);
        if !changes.activated.is_empty() {
            self.show(after.union(changes.cleared), now);
        }
        self.show(after, now);
        // A counter that has come to its end does not change, the list does.
        if self.commander.valve.take_counters_changed() || self.previously_active != listed {
            self.fault_log.changed(now);
        }
    }

    /// Shows the active fault of highest priority, at once where that may be sent.
    fn show(&mut self, active: FaultSet, now: Instant) {
        let trouble = active.highest().map(|fault| self.trouble(fault));
        self.dm1.set(trouble, now);
        if self.claim.may_send() {
            self.send_dm1(now);
        }
    }

    pub(super) fn send_dm1(&mut self, now: Instant) {
        let Some(own) = self.claim.address() else { return };
        let Some(frame) = self.dm1.poll(own, now) else { return };
        self.send(frame);
        if self.commander.valve.is_active(Fault::Internal) {
            // Reported now, so its cause is gone: a watchdog reset is nothing that lasts.
            self.commander.valve.set_internal(InternalCause::Watchdog, false, now);
            self.report_faults(now);
        }
    }

    pub(super) fn send_dm2(&mut self, own: Address, now: Instant) {
        let previously: Vec<Trouble, { Fault::ALL.len() }> =
            self.previously_active.into_iter().map(|fault| self.trouble(fault)).collect();
        if let Some(frame) = answer_dm2(&previously, own, &mut self.bam, now) {
            self.send(frame);
        }
    }

    /// A shutdown has ended: its faults are previously active now.
    pub(super) fn log_as_previously_active(&mut self, faults: FaultSet, now: Instant) {
        self.previously_active = self.previously_active.union(faults);
        self.fault_log.changed(now);
    }

    /// DM3: acknowledged when the memory holds it. An empty list needs no memory.
    pub(super) fn clear_previously_active(&mut self, request: &Request, own: Address) {
        let job = Job::ClearPreviouslyActive(*request, self.previously_active);
        if self.previously_active.is_empty() {
            if let Some(acknowledgement) = request.acknowledge(own) {
                self.send(acknowledgement);
            }
        } else {
            // With more writes waiting than there is room for, the request is lost, and asked again.
            let _ = self.storage.ask(job);
        }
    }

    fn trouble(&self, fault: Fault) -> Trouble {
        let codes = codes(fault);
        Trouble { lamp: codes.lamp, dtc: codes.dtc, count: self.commander.valve.counters().get(fault) }
    }
}
