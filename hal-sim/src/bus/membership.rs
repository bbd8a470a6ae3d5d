//! Bus integration: joining, leaving, changes of the error mode, bus-off and recovery.

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Instant;

use super::bits::{BUS_IDLE, SUSPEND};
use super::clock::{Nanos, bit_times, instant, nanos};
use super::confinement::{Confinement, RECOVERY_SEQUENCES};
use super::event::WireEvent;
use super::listeners::Group;
use super::port::{Port, Recovery};
use super::{Bus, Event, EventKind, PortId};

impl Bus {
    /// Starts bus integration: the controller participates after 11 recessive bits. A bus-off controller must recover
    /// first.
    pub(super) fn join(&mut self, id: PortId, now: Instant) {
        let port = &mut self.ports[id.0];
        // On a busy bus, the port waits for the end of the frame.
        let busy = self.current.is_some();
        port.joined_at = if busy { Nanos::MAX } else { nanos(now) + bit_times(BUS_IDLE, port.rate) };
        port.ready_at = if port.takes_part() { port.joined_at } else { Nanos::MAX };
        port.suspended = false;
        self.joining.push(id);
        self.refresh(id, now);
    }

    /// Removes a port from the members of its group or from the joining ports.
    pub(super) fn leave(&mut self, id: PortId) {
        self.joining.retain(|other| *other != id);
        let port = &mut self.ports[id.0];
        if !std::mem::take(&mut port.member) {
            return;
        }
        let group = group_of(&mut self.groups, port);
        group.members.retain(|other| *other != id);
        group.counting.retain(|other| *other != id);
        if !port.is_silent() {
            group.audible -= 1;
            group.active -= usize::from(port.mode() == BusErrorMode::ErrorActive);
        }
        group.unlist(id, port.hears());
    }

    /// Admits the joining ports that have seen 11 recessive bits before `start`. All others wait for the end of the
    /// frame that starts now.
    pub(super) fn admit(&mut self, start: Nanos) {
        let mut place = 0;
        while let Some(id) = self.joining.get(place).copied() {
            let port = &mut self.ports[id.0];
            if port.joined_at > start {
                // The port restarts its count of recessive bits at the end of the frame.
                port.joined_at = Nanos::MAX;
                port.ready_at = Nanos::MAX;
                place += 1;
                continue;
            }
            self.joining.swap_remove(place);
            if !port.takes_part() || std::mem::replace(&mut port.member, true) {
                continue;
            }
            let group = group_of(&mut self.groups, port);
            let place = group.members.partition_point(|other| *other < id);
            group.members.insert(place, id);
            if port.confinement.receive_errors() > 0 {
                group.counting.push(id);
            }
            if !port.is_silent() {
                group.audible += 1;
                group.active += usize::from(port.mode() == BusErrorMode::ErrorActive);
            }
            group.list(id, port.hears());
        }
    }

    /// Applies the new filters of a port.
    pub(super) fn refilter(&mut self, id: PortId) {
        let port = &mut self.ports[id.0];
        let Some(filters) = port.new_filters.take() else { return };
        if port.member {
            group_of(&mut self.groups, port).unlist(id, port.hears());
        }
        port.filters = Some(filters);
        if port.member {
            group_of(&mut self.groups, port).list(id, port.hears());
        }
    }

    /// Handles an error-passive port that lost a bit to another sender: counts a transmit error and restarts bus
    /// integration. The passive error flag does not stop the winning frame and cannot end before that frame.
    pub(super) fn fall_out_of_step(&mut self, id: PortId, at: Instant) {
        self.change(id, at, Confinement::transmit_error);
        let port = &mut self.ports[id.0];
        if port.takes_part() {
            port.joined_at = Nanos::MAX;
            port.ready_at = Nanos::MAX;
            port.suspended = true;
            self.leave(id);
            self.joining.push(id);
            self.refresh(id, at);
        }
    }

    /// Applies a change to the error counters of a port and updates its error mode. Every transition to bus-off uses
    /// this function.
    pub(super) fn change(&mut self, id: PortId, at: Instant, change: impl FnOnce(&mut Confinement)) {
        let port = &mut self.ports[id.0];
        let from = port.mode();
        change(&mut port.confinement);
        if port.mode() != from {
            self.change_mode(id, from, at);
        }
    }

    #[cold]
    fn change_mode(&mut self, id: PortId, from: BusErrorMode, at: Instant) {
        let port = &mut self.ports[id.0];
        let to = port.mode();
        if port.is_device() {
            self.touched.push(id);
        }
        self.journal.note(|| Some(Event { at, who: port.name.clone(), what: EventKind::ErrorMode { from, to } }));
        if port.member && !port.is_silent() {
            let group = group_of(&mut self.groups, port);
            group.active += usize::from(to == BusErrorMode::ErrorActive);
            group.active -= usize::from(from == BusErrorMode::ErrorActive);
        }
        if to == BusErrorMode::BusOff {
            port.ready_at = Nanos::MAX;
            port.was_bus_off = true;
            // The software of an external controller starts the recovery.
            let recovers = port.external.is_none() && !port.held;
            self.leave(id);
            self.refresh(id, at);
            if recovers {
                self.begin_recovery(id, nanos(at));
            }
        }
    }

    pub(super) fn begin_recovery(&mut self, id: PortId, since: Nanos) {
        self.ports[id.0].recovery = Some(Recovery { left: RECOVERY_SEQUENCES, since });
        if let Err(place) = self.recovering.binary_search(&id) {
            self.recovering.insert(place, id);
        }
    }

    pub(super) fn stop_recovery(&mut self, id: PortId) {
        if self.ports[id.0].recovery.take().is_some() {
            self.recovering.retain(|other| *other != id);
        }
    }

    pub(super) fn next_recovery(&self) -> Nanos {
        let due = |id: &PortId| self.ports[id.0].recovered_at();
        self.recovering.iter().filter_map(due).min().unwrap_or(Nanos::MAX)
    }

    /// Counts the end of a frame or error frame plus the intermission as one sequence of 11 recessive bits, both for
    /// bus-off recovery and for bus integration.
    pub(super) fn count_idle_sequence(&mut self) {
        for place in 0..self.joining.len() {
            let id = self.joining[place];
            let port = &mut self.ports[id.0];
            if port.joined_at < Nanos::MAX {
                continue;
            }
            port.joined_at = self.free_at;
            if port.takes_part() {
                let suspended = std::mem::take(&mut port.suspended);
                port.ready_at = self.free_at + if suspended { bit_times(SUSPEND, port.rate) } else { 0 };
            }
        }
        for id in &self.recovering {
            if let Some(recovery) = &mut self.ports[id.0].recovery {
                recovery.left = recovery.left.saturating_sub(1);
                recovery.since = recovery.since.max(self.free_at);
            }
        }
    }

    /// Counts the recessive bits of the idle time before `start` towards bus-off recovery.
    pub(super) fn pass_recovery_time(&mut self, start: Nanos) {
        for id in &self.recovering {
            let port = &mut self.ports[id.0];
            let sequence = bit_times(BUS_IDLE, port.rate);
            if let Some(recovery) = &mut port.recovery {
                let seen = start.saturating_sub(recovery.since) / sequence;
                recovery.left = recovery.left.saturating_sub(u32::try_from(seen).unwrap_or(u32::MAX));
                recovery.since = start;
            }
        }
    }

    /// Completes the bus-off recoveries that are due by `now`.
    pub(super) fn recover(&mut self, now: Nanos) {
        if self.current.is_some() {
            return;
        }
        let due = |id: &PortId| Some((self.ports[id.0].recovered_at().filter(|due| *due <= now)?, *id));
        for (at, id) in self.recovering.iter().filter_map(due).collect::<Vec<_>>() {
            self.stop_recovery(id);
            let port = &mut self.ports[id.0];
            port.joined_at = at;
            port.ready_at = at;
            port.tell(at, WireEvent::Recovered);
            self.change(id, instant(at), Confinement::recover);
            self.joining.push(id);
            self.refresh(id, instant(at));
        }
    }
}

/// Returns the group of a port's bit rate, and creates the group if necessary.
fn group_of<'a>(groups: &'a mut Vec<Group>, port: &Port) -> &'a mut Group {
    let place = groups.iter().position(|group| group.rate == port.rate).unwrap_or_else(|| {
        groups.push(Group::new(port.rate));
        groups.len() - 1
    });
    &mut groups[place]
}
