//! A CAN bus in virtual time (ISO 11898-1): arbitration, acknowledgement, errors and their confinement.
//!
//! One frame or error frame is on the wire at a time. How it ends is known when it starts (`transmission`); what the
//! end means for each port is worked out then (`outcome`). Between the two the bus costs nothing.
//!
//! What is simplified: an attempt that fails is cut at the bit where the first error is seen, and all controllers see
//! the error frame at once. Oscillator tolerance, resynchronisation and overload frames are left out.

mod alone;
mod bits;
mod clock;
mod confinement;
mod external;
mod injector;
mod load;
mod outcome;
mod port;
mod transmission;
mod transmit;

#[cfg(test)]
mod bits_tests;
#[cfg(test)]
mod external_tests;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER};

pub use bits::{BUS_IDLE, Difference, FrameBits, INTERMISSION};
pub use confinement::Confinement;
pub use external::WireEvent;
pub use injector::{BitErrors, DestroyNext, Injector};
pub use port::{Port, RECEIVE_QUEUE};

use clock::{Nanos, bit_times, instant, nanos};
use confinement::RECOVERY_SEQUENCES;
use load::Load;
use port::Recovery;
use transmission::Transmission;

/// A port of the bus, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub(crate) usize);

/// Why a frame was destroyed (ISO 11898-1, error types).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// A sender read back another bit than it sent.
    Bit,
    /// A listener could not make sense of the bits: another bit rate, or a sender that fell silent.
    Stuff,
    /// Nobody acknowledged.
    Acknowledgement,
}

/// What was on the wire until now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended {
    /// Who sent it; the first of several that sent the same.
    pub from: Arc<str>,
    /// The frame that was sent or tried.
    pub frame: Frame,
    /// Why it is not a frame but an error frame.
    pub error: Option<BusError>,
}

/// The bus and everything that is connected to it.
#[derive(Default)]
pub struct Bus {
    ports: Vec<Port>,
    /// The ports of clients that are gone: clients come and go, and everything looks at all ports.
    vacant: Vec<PortId>,
    /// The ports that have something to send, in the order of their numbers.
    contenders: Vec<PortId>,
    /// The ports whose controllers live elsewhere.
    externals: Vec<PortId>,
    /// The ports that are bus-off and on their way back.
    recovering: Vec<PortId>,
    /// Whether a port waits for the end of the frame on the wire to join.
    joining: bool,
    /// The frame on the wire.
    current: Option<Transmission>,
    /// The list of senders of the last frame, to be used again.
    spare: Vec<PortId>,
    /// From when on the next frame may start.
    free_at: Nanos,
    /// The ports for which something changed since they were last asked for.
    touched: Vec<PortId>,
    injectors: Vec<Box<dyn Injector>>,
    load: Load,
}

impl Bus {
    /// A new controller of a device, not connected yet.
    pub fn add_device(&mut self, name: Arc<str>, rate: BitRate) -> PortId {
        self.add(Port::of_device(name, rate))
    }

    /// A new client, connected at once: its adapter has long been on the bus.
    pub fn add_tap(&mut self, name: Arc<str>, rate: BitRate, now: Instant) -> PortId {
        self.add_connected(Port::of_tap(name, rate), now)
    }

    /// A gateway without a client, connected at once: it acknowledges, and keeps nothing of what it hears.
    pub fn add_gateway(&mut self, name: Arc<str>, rate: BitRate, now: Instant) -> PortId {
        self.add_connected(Port::of_gateway(name, rate), now)
    }

    /// Takes a client away for good. Its number may be given to another one.
    pub fn remove(&mut self, id: PortId, now: Instant) {
        self.disconnect(id, now);
        if !self.vacant.contains(&id) {
            self.vacant.push(id);
        }
    }

    /// A port.
    #[inline]
    #[must_use]
    pub fn port(&self, id: PortId) -> &Port {
        &self.ports[id.0]
    }

    /// A port that a device is pumped through; to be followed by [`refresh`](Self::refresh).
    #[inline]
    pub(crate) fn port_mut(&mut self, id: PortId) -> &mut Port {
        &mut self.ports[id.0]
    }

    /// Connects a controller. It takes part once it has seen the bus idle.
    pub fn connect(&mut self, id: PortId, now: Instant) {
        let port = &mut self.ports[id.0];
        port.connected = true;
        port.confinement.recover();
        self.join(id, nanos(now));
    }

    /// Takes a controller off the bus, with all that it had to send or to read. A frame that it is sending breaks off.
    pub fn disconnect(&mut self, id: PortId, now: Instant) {
        self.fall_silent(id, now);
        let port = &mut self.ports[id.0];
        port.connected = false;
        port.transmit.clear();
        port.received.clear();
        port.recovery = None;
        self.refresh(id, now);
        self.recovering.retain(|other| *other != id);
    }

    /// Drops what a port has to send.
    pub fn drop_pending(&mut self, id: PortId, now: Instant) {
        self.fall_silent(id, now);
        self.ports[id.0].transmit.clear();
        self.refresh(id, now);
    }

    /// Sets a port to a bit rate. A new rate starts its controller anew, error counters aside.
    pub fn set_bit_rate(&mut self, id: PortId, rate: BitRate, now: Instant) {
        if self.ports[id.0].rate == rate {
            return;
        }
        self.fall_silent(id, now);
        self.ports[id.0].rate = rate;
        self.join(id, nanos(now));
    }

    /// Takes a port off the bus as if its transmit error counter had overrun, or lets it recover from that.
    pub fn force_bus_off(&mut self, id: PortId, on: bool, now: Instant) {
        if on {
            self.fall_silent(id, now);
            self.ports[id.0].confinement.force_bus_off();
            self.ports[id.0].recovery = None;
            self.recovering.retain(|other| *other != id);
        } else if self.ports[id.0].mode() == BusErrorMode::BusOff && self.ports[id.0].recovery.is_none() {
            self.begin_recovery(id, nanos(now));
        }
    }

    /// Adds something that disturbs the bus.
    pub fn inject(&mut self, injector: Box<dyn Injector>) {
        self.injectors.push(injector);
    }

    /// Takes away all that disturbs the bus.
    pub fn clear_injectors(&mut self) {
        self.injectors.clear();
    }

    /// Notes that a port has, or has no longer, something to send.
    #[inline]
    pub fn refresh(&mut self, id: PortId, now: Instant) {
        let port = &mut self.ports[id.0];
        let pending = !port.transmit.is_empty();
        if pending == port.contends {
            return;
        }
        port.contends = pending;
        port.ready_at = port.ready_at.max(nanos(now));
        match self.contenders.binary_search(&id) {
            Ok(place) => {
                self.contenders.remove(place);
            }
            Err(place) => self.contenders.insert(place, id),
        }
    }

    /// When something is next due on the bus.
    #[must_use]
    pub fn next_event(&self) -> Instant {
        match &self.current {
            Some(transmission) => instant(transmission.end.min(self.next_joining())),
            None if self.contenders.is_empty() && self.recovering.is_empty() && self.externals.is_empty() => NEVER,
            None => instant(self.next_start().min(self.next_recovery()).min(self.next_joining())),
        }
    }

    /// How much of the second before `now` the bus was busy, in percent.
    #[must_use]
    pub fn load(&self, now: Instant) -> u8 {
        self.load.percent(nanos(now))
    }

    /// The ports that received something, sent something or changed their error mode, in the order of their numbers,
    /// into an empty `ports`.
    pub(crate) fn swap_touched(&mut self, ports: &mut Vec<PortId>) {
        std::mem::swap(&mut self.touched, ports);
    }

    fn add(&mut self, port: Port) -> PortId {
        self.ports.push(port);
        PortId(self.ports.len() - 1)
    }

    fn add_connected(&mut self, mut port: Port, now: Instant) -> PortId {
        port.connected = true;
        port.joined_at = nanos(now);
        match self.vacant.pop() {
            Some(id) => {
                self.ports[id.0] = port;
                id
            }
            None => self.add(port),
        }
    }

    /// The controller synchronises: after 11 recessive bits it takes part.
    fn join(&mut self, id: PortId, now: Nanos) {
        let port = &mut self.ports[id.0];
        let busy = self.current.is_some();
        self.joining |= busy;
        // While a frame is on the wire: not before its end, whenever that is.
        port.joined_at = if busy { Nanos::MAX } else { now + bit_times(BUS_IDLE, port.rate) };
        port.ready_at = port.joined_at;
    }

    fn begin_recovery(&mut self, id: PortId, since: Nanos) {
        self.ports[id.0].recovery = Some(Recovery { left: RECOVERY_SEQUENCES, since });
        if let Err(place) = self.recovering.binary_search(&id) {
            self.recovering.insert(place, id);
        }
    }

    fn next_recovery(&self) -> Nanos {
        let due = |id: &PortId| self.ports[id.0].recovered_at();
        self.recovering.iter().filter_map(due).min().unwrap_or(Nanos::MAX)
    }
}
