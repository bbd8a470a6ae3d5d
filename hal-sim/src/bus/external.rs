//! A port whose controller lives elsewhere: the emulated one of a firmware image.
//!
//! The bus does for it what the wire does, and tells it what happened; mailboxes, filters, counters that software reads
//! and the decision to recover from bus-off are the controller's own. It offers one frame at a time, its most urgent one,
//! and offers anew whenever something happened.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;
use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::clock::{Nanos, instant, nanos};
use super::confinement::Confinement;
use super::port::Port;
use super::{Bus, BusError, PortId};

/// What a controller notices of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireEvent {
    /// It has seen 11 recessive bits and takes part.
    Joined,
    /// A frame begins; `own` when the one that it offered is among the contenders and has won.
    Begins {
        /// Whether this controller sends it.
        own: bool,
    },
    /// A more urgent frame of somebody else has won against the one that it offered.
    LostArbitration,
    /// Its frame was sent and acknowledged.
    Sent,
    /// Its frame was destroyed, or not acknowledged.
    NotSent(BusError),
    /// It received a frame.
    Received(Frame),
    /// A frame of somebody else was destroyed; `first` when this controller's error flag was the first.
    NotReceived {
        /// Whether it was the first to see the error.
        first: bool,
    },
    /// What was on the wire has ended.
    Ends,
    /// It was bus-off, and has seen 128 sequences of 11 recessive bits.
    Recovered,
}

/// What a port with a controller elsewhere has beyond the others.
#[derive(Debug, Default)]
pub(super) struct External {
    events: VecDeque<(Instant, WireEvent)>,
    /// Whether it has to be told that it has joined.
    joining: bool,
    /// It sends no dominant bit: neither frames nor acknowledgements nor error flags.
    pub(super) silent: bool,
}

impl External {
    pub(super) fn tell(&mut self, at: Instant, event: WireEvent) {
        self.events.push_back((at, event));
    }
}

impl Port {
    /// The place of a controller that lives elsewhere, not yet connected.
    fn of_external(name: Arc<str>, rate: BitRate) -> Self {
        let mut port = Self::of_gateway(name, rate);
        port.transmit = super::transmit::Transmit::offer();
        port.external = Some(Box::default());
        port
    }

    /// Whether others notice that it listens.
    #[inline]
    pub(super) fn is_silent(&self) -> bool {
        self.external.as_ref().is_some_and(|external| external.silent)
    }

    /// Tells a controller that lives elsewhere.
    #[inline]
    pub(super) fn tell(&mut self, at: Nanos, event: WireEvent) {
        if let Some(external) = &mut self.external {
            external.tell(instant(at), event);
        }
    }
}

impl Bus {
    /// A controller that lives elsewhere, not connected yet.
    pub fn add_external(&mut self, name: Arc<str>, rate: BitRate) -> PortId {
        let id = self.add(Port::of_external(name, rate));
        self.externals.push(id);
        id
    }

    /// Whether the controller of a port lives elsewhere.
    #[must_use]
    pub fn is_external(&self, id: PortId) -> bool {
        self.ports[id.0].external.is_some()
    }

    /// Connects a controller with what its error counters hold. It takes part once it has seen the bus idle.
    pub fn attach(&mut self, id: PortId, rate: BitRate, silent: bool, now: Instant) {
        let port = &mut self.ports[id.0];
        port.connected = true;
        port.rate = rate;
        if let Some(external) = &mut port.external {
            external.joining = true;
            external.silent = silent;
        }
        self.join(id, nanos(now));
    }

    /// Takes a controller off the bus; its error counters stay, unless it is `reset`.
    pub fn detach(&mut self, id: PortId, reset: bool, now: Instant) {
        self.disconnect(id, now);
        if reset {
            self.change(id, now, Confinement::recover);
        }
        let port = &mut self.ports[id.0];
        if let Some(external) = &mut port.external {
            external.joining = false;
            external.events.clear();
        }
    }

    /// What a controller would send next. One whose frame is on the wire is not asked before the end of that.
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
            self.begin_recovery(id, nanos(now).max(port.joined_at));
        }
    }

    /// What a controller has noticed since this was last asked.
    pub(crate) fn take_wire_events(&mut self, id: PortId) -> Option<Drain<'_, (Instant, WireEvent)>> {
        self.ports[id.0].external.as_mut().map(|external| external.events.drain(..))
    }

    /// When the next controller has to be told that it has joined.
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

    /// Tells everybody who takes part that a frame begins or has ended.
    pub(super) fn tell_all(&mut self, at: Nanos, event: impl Fn(PortId) -> WireEvent) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            if port.connected && port.joined_at <= at {
                port.tell(at, event(*id));
            }
        }
    }

    /// Tells those who contended and lost.
    pub(super) fn tell_losers(&mut self, start: Nanos, senders: &[PortId]) {
        for id in &self.externals {
            let port = &mut self.ports[id.0];
            if !senders.contains(id) && port.takes_part() && port.ready_at <= start && port.transmit.head().is_some() {
                port.tell(start, WireEvent::LostArbitration);
            }
        }
    }
}
