//! Ports with an external controller, such as the emulated controller of a firmware image.
//!
//! The bus simulates the wire and reports the events that a controller would detect. The external controller owns the
//! mailboxes, the filters, the error counters that software reads, and the decision to recover from bus-off. The
//! controller offers only its most urgent frame to the bus, and renews the offer after each event.

use std::collections::vec_deque::Drain;
use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::clock::{Nanos, instant, nanos};
use super::confinement::Confinement;
use super::event::WireEvent;
use super::port::{External, Port};
use super::transmit::TransmitKind;
use super::{Bus, PortId};

impl Bus {
    pub(crate) fn add_external(&mut self, name: Arc<str>, rate: BitRate) -> PortId {
        let id = self.add(Port::new(name, rate, TransmitKind::Offer, usize::MAX));
        self.externals.push(id);
        id
    }

    pub(crate) fn is_external(&self, id: PortId) -> bool {
        self.ports[id.0].external.is_some()
    }

    /// Connects a controller without clearing its error counters. Bus integration completes after 11 recessive bits.
    pub(crate) fn attach(&mut self, id: PortId, rate: BitRate, silent: bool, now: Instant) {
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

    /// Disconnects a controller. `reset` clears its error counters.
    pub(crate) fn detach(&mut self, id: PortId, reset: bool, now: Instant) {
        self.disconnect(id, now);
        if reset {
            self.change(id, now, Confinement::recover);
        }
        if let Some(external) = &mut self.ports[id.0].external {
            **external = External { silent: external.silent, ..External::default() };
        }
    }

    /// Sets the frame that a controller offers for the next arbitration. The call has no effect while the controller's
    /// frame is on the wire. A listen-only controller offers no frame.
    pub(crate) fn offer(&mut self, id: PortId, frame: Option<Frame>, now: Instant) {
        let port = &mut self.ports[id.0];
        let silent = port.is_silent();
        port.transmit.set_offer(frame.filter(|_| !silent));
        self.refresh(id, now);
    }

    /// Starts the recovery of a bus-off controller. Sequences of 11 recessive bits count from `now`.
    pub(crate) fn start_recovery(&mut self, id: PortId, now: Instant) {
        let port = &self.ports[id.0];
        if port.mode() == BusErrorMode::BusOff && port.recovery.is_none() {
            // The end of a frame on the wire counts as the first sequence.
            let joined_at = if port.joined_at == Nanos::MAX { 0 } else { port.joined_at };
            self.begin_recovery(id, nanos(now).max(joined_at));
        }
    }

    /// Takes the wire events of a controller since the last call; `None` if the port has no external controller.
    pub(crate) fn take_wire_events(&mut self, id: PortId) -> Option<Drain<'_, (Instant, WireEvent)>> {
        self.ports[id.0].external.as_mut().map(|external| external.events.drain(..))
    }

    /// Returns the time of the next [`WireEvent::Joined`] to report.
    pub(super) fn next_joining(&self) -> Nanos {
        let due = |id: &PortId| {
            let port = &self.ports[id.0];
            port.external.as_ref().is_some_and(|external| external.joining).then_some(port.joined_at)
        };
        self.externals.iter().filter_map(due).min().unwrap_or(Nanos::MAX)
    }

    /// Reports [`WireEvent::Joined`] once to each external controller that has completed bus integration by `now`.
    pub(super) fn tell_joined(&mut self, now: Nanos) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            let joined_at = port.joined_at;
            if joined_at <= now
                && let Some(external) = &mut port.external
                && std::mem::take(&mut external.joining)
            {
                external.events.push_back((instant(joined_at), WireEvent::Joined));
            }
        }
    }

    /// Reports lost arbitration to the external controllers with a losing offer, before the frame begins.
    pub(super) fn tell_losers(&mut self, start: Nanos) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            if !self.senders.contains(id) && port.ready_at <= start && port.transmit.head().is_some() {
                port.tell(start, WireEvent::LostArbitration);
            }
        }
    }

    /// Reports the start of a frame to all connected external controllers that have completed bus integration.
    pub(super) fn tell_begin(&mut self, start: Nanos) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            let on_bus = port.connected && port.joined_at <= start;
            let own = self.senders.contains(id);
            if let Some(external) = port.external.as_mut().filter(|_| on_bus || own) {
                external.in_frame = true;
                external.events.push_back((instant(start), WireEvent::Begins { own }));
            }
        }
    }

    /// Reports the end of a frame to the external controllers that received its start event.
    pub(super) fn tell_end(&mut self, end: Nanos) {
        for id in &self.externals {
            if let Some(external) = &mut self.ports[id.0].external
                && std::mem::take(&mut external.in_frame)
            {
                external.events.push_back((instant(end), WireEvent::Ends));
            }
        }
    }
}
