//! Ports whose controller lives elsewhere: the emulated one of a firmware image.
//!
//! The bus does for it what the wire does, and tells it what happened; mailboxes, filters, counters that software reads
//! and the decision to recover from bus-off are the controller's own. It offers one frame at a time, its most urgent
//! one, and offers anew whenever something happened.

use std::collections::vec_deque::Drain;
use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::clock::{Nanos, instant, nanos};
use super::confinement::Confinement;
use super::port::Port;
use super::wire_event::WireEvent;
use super::{Bus, PortId};

impl Bus {
    /// Returns a controller that lives elsewhere, not connected yet.
    pub fn add_external(&mut self, name: Arc<str>, rate: BitRate) -> PortId {
        let id = self.add(Port::of_external(name, rate));
        self.externals.push(id);
        id
    }

    /// Returns whether the controller of a port lives elsewhere.
    #[must_use]
    pub fn is_external(&self, id: PortId) -> bool {
        self.ports[id.0].external.is_some()
    }

    /// Connects a controller with what its error counters hold. It takes part once it has seen the bus idle.
    pub fn attach(&mut self, id: PortId, rate: BitRate, silent: bool, now: Instant) {
        self.leave(id);
        let port = &mut self.ports[id.0];
        port.connected = true;
        port.rate = rate;
        if let Some(external) = &mut port.external {
            external.joining = true;
            external.silent = silent;
        }
        self.join(id, now);
    }

    /// Takes a controller off the bus; its error counters stay, unless it is `reset`.
    pub fn detach(&mut self, id: PortId, reset: bool, now: Instant) {
        self.disconnect(id, now);
        if reset {
            self.change(id, now, Confinement::recover);
        }
        if let Some(external) = &mut self.ports[id.0].external {
            external.leave();
        }
    }

    /// Takes what a controller would send next. One whose frame is on the wire is not asked before the end of that.
    pub fn offer(&mut self, id: PortId, frame: Option<Frame>, now: Instant) {
        let port = &mut self.ports[id.0];
        let silent = port.is_silent();
        port.transmit.set_offer(frame.filter(|_| !silent));
        self.refresh(id, now);
    }

    /// Lets a controller that is bus-off begin to count sequences of 11 recessive bits.
    pub fn start_recovery(&mut self, id: PortId, now: Instant) {
        let port = &self.ports[id.0];
        if port.mode() == BusErrorMode::BusOff && port.recovery.is_none() {
            // During a frame, its end is the first sequence.
            let joined_at = if port.joined_at == Nanos::MAX { 0 } else { port.joined_at };
            self.begin_recovery(id, nanos(now).max(joined_at));
        }
    }

    /// Returns what a controller has noticed since this was last asked.
    pub(crate) fn take_wire_events(&mut self, id: PortId) -> Option<Drain<'_, (Instant, WireEvent)>> {
        self.ports[id.0].external.as_mut().map(|external| external.take())
    }

    /// Returns when the next controller has to be told that it has joined.
    #[inline]
    pub(super) fn next_joining(&self) -> Nanos {
        let due = |id: &PortId| {
            let port = &self.ports[id.0];
            port.external.as_ref().is_some_and(|external| external.joining).then_some(port.joined_at)
        };
        self.externals.iter().filter_map(due).min().unwrap_or(Nanos::MAX)
    }

    /// Tells those that have joined by `now`.
    pub(super) fn tell_joined(&mut self, now: Nanos) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            let joined_at = port.joined_at;
            if joined_at <= now
                && let Some(external) = &mut port.external
                && std::mem::take(&mut external.joining)
            {
                external.tell(instant(joined_at), WireEvent::Joined);
            }
        }
    }

    /// Tells those who contended and lost the arbitration, before the frame itself begins.
    pub(super) fn tell_losers(&mut self, start: Nanos) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            if !self.senders.contains(id) && port.ready_at <= start && port.transmit.head().is_some() {
                port.tell(start, WireEvent::LostArbitration);
            }
        }
    }

    /// Tells everybody who was on the bus by the start of a frame that it begins.
    pub(super) fn tell_begin(&mut self, start: Nanos) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            let on_bus = port.connected && port.joined_at <= start;
            let own = self.senders.contains(id);
            if let Some(external) = port.external.as_mut().filter(|_| on_bus || own) {
                external.in_frame = true;
                external.tell(instant(start), WireEvent::Begins { own });
            }
        }
    }

    /// Tells everybody who was told of its begin that a frame has ended.
    pub(super) fn tell_end(&mut self, end: Nanos) {
        for id in &self.externals {
            if let Some(external) = &mut self.ports[id.0].external
                && std::mem::take(&mut external.in_frame)
            {
                external.tell(instant(end), WireEvent::Ends);
            }
        }
    }
}
