//! A CAN bus in virtual time (ISO 11898-1): arbitration, acknowledgement, errors and their confinement.
//!
//! One frame or error frame is on the wire at a time. How it ends is known when it starts (`transmission`); what the
//! end means for each port is worked out then (`outcome`). Between the two the bus costs nothing, and a frame costs
//! those who care for it: contenders are kept in the order of arbitration (`contenders`), listeners by bit rate and
//! filter (`listeners`), and only error counters that can change are looked at.
//!
//! A port becomes a member of its bit rate's group once it is in step, and is one until it leaves, loses a bit or goes
//! bus-off (`membership`). A port that is no member neither hears nor acknowledges.
//!
//! What is simplified: an attempt that fails is cut at the bit where the first error is seen, and all controllers see
//! the error frame at once. Oscillator tolerance, resynchronisation and overload frames are left out.

mod alone;
mod bits;
mod clock;
mod confinement;
mod contenders;
mod error;
mod event;
mod external;
mod injector;
mod listeners;
mod load;
mod mailboxes;
mod membership;
mod outcome;
mod port;
mod transmission;
mod transmit;
mod wire_event;

#[cfg(test)]
mod bits_tests;
#[cfg(test)]
mod collision_tests;
#[cfg(test)]
mod external_tests;
#[cfg(test)]
mod rig;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::vec::Drain;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::time::Instant;

pub use bits::{BUS_IDLE, Difference, FrameBits, INTERMISSION};
pub use confinement::Confinement;
pub use error::BusError;
pub use event::{Event, EventKind};
pub use injector::{BitErrors, DestroyNext, Disturbance, Injector};
pub use port::{Port, RECEIVE_QUEUE};
pub use wire_event::WireEvent;

use clock::{Nanos, instant, nanos};
use contenders::{Contenders, Contends};
use event::Journal;
use injector::Injects;
use listeners::Group;
use load::Load;
use transmission::Transmission;

/// A port of the bus, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub(crate) usize);

/// The bus and everything that is connected to it.
#[derive(Clone, Default)]
pub struct Bus {
    ports: Vec<Port>,
    /// The ports of clients that are gone, to be used again.
    vacant: Vec<PortId>,
    contenders: Contenders,
    /// The ports that take part, by bit rate.
    groups: Vec<Group>,
    /// The ports that are about to take part: they wait for recessive bits.
    joining: Vec<PortId>,
    /// The ports whose controllers live elsewhere.
    externals: Vec<PortId>,
    /// The ports that are bus-off and on their way back.
    recovering: Vec<PortId>,
    /// The frame on the wire.
    current: Option<Transmission>,
    /// Who sends it; several when they send the same, or when none of them has noticed the others yet.
    senders: Vec<PortId>,
    /// From when on the next frame may start.
    free_at: Nanos,
    /// The ports of devices for which something changed since they were last asked for.
    touched: Vec<PortId>,
    injectors: Vec<Box<dyn Injects>>,
    /// What disturbs the bus on command.
    disturbance: Disturbance,
    load: Load,
    journal: Journal,
}

impl Bus {
    /// A new controller of a device, not connected yet.
    pub fn add_device(&mut self, name: Arc<str>, rate: BitRate) -> PortId {
        self.add(Port::of_device(name, rate))
    }

    /// A new client, connected at once: its adapter has long been on the bus.
    pub fn add_client_port(&mut self, name: Arc<str>, rate: BitRate, now: Instant) -> PortId {
        self.add_connected(Port::of_client(name, rate), now)
    }

    /// A client that keeps nothing of what it hears, connected at once.
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
        self.leave(id);
        self.stop_recovery(id);
        let port = &mut self.ports[id.0];
        port.connected = true;
        port.held = false;
        self.change(id, now, Confinement::recover);
        self.join(id, now);
    }

    /// Takes a controller off the bus, with all that it had to send or to read. A frame that it is sending breaks off.
    pub fn disconnect(&mut self, id: PortId, now: Instant) {
        self.fall_silent(id, now);
        self.leave(id);
        self.stop_recovery(id);
        let port = &mut self.ports[id.0];
        port.connected = false;
        port.ready_at = Nanos::MAX;
        port.transmit.clear();
        port.received.clear();
        self.refresh(id, now);
    }

    /// Drops what a port has to send.
    pub fn drop_pending(&mut self, id: PortId, now: Instant) {
        self.fall_silent(id, now);
        self.ports[id.0].transmit.clear();
        self.refresh(id, now);
    }

    /// Whether a frame of a port is on the wire.
    #[must_use]
    pub fn is_sending(&self, id: PortId) -> bool {
        self.senders.contains(&id)
    }

    /// Sets a port to a bit rate. A new rate starts its controller anew, error counters aside.
    pub fn set_bit_rate(&mut self, id: PortId, rate: BitRate, now: Instant) {
        if self.ports[id.0].rate == rate {
            return;
        }
        self.fall_silent(id, now);
        self.leave(id);
        self.ports[id.0].rate = rate;
        self.join(id, now);
    }

    /// Takes a port off the bus as if its transmit error counter had overrun, or lets it recover from that.
    pub fn force_bus_off(&mut self, id: PortId, on: bool, now: Instant) {
        self.ports[id.0].held = on;
        if on {
            self.fall_silent(id, now);
            self.change(id, now, Confinement::force_bus_off);
            self.stop_recovery(id);
        } else if self.ports[id.0].mode() == BusErrorMode::BusOff && self.ports[id.0].recovery.is_none() {
            self.begin_recovery(id, nanos(now));
        }
    }

    /// Adds something that disturbs the bus.
    pub fn inject(&mut self, injector: impl Injector + Clone + 'static) {
        self.injectors.push(Box::new(injector));
    }

    /// Disturbs the bus on command, in the place of an earlier disturbance.
    pub const fn disturb(&mut self, disturbance: Disturbance) {
        self.disturbance = disturbance;
    }

    /// What is left of the disturbance on command.
    #[must_use]
    pub const fn disturbance(&self) -> Disturbance {
        self.disturbance
    }

    /// Takes away all injectors.
    pub fn clear_injectors(&mut self) {
        self.injectors.clear();
    }

    /// [Looks](Self::refresh) at a port that its device has used since the last look.
    #[inline]
    pub(crate) fn refresh_used(&mut self, id: PortId, now: Instant) {
        if self.ports[id.0].used {
            self.refresh(id, now);
        }
    }

    /// Looks at what a port has to send and to hear now.
    #[inline]
    pub fn refresh(&mut self, id: PortId, now: Instant) {
        let port = &mut self.ports[id.0];
        port.used = false;
        if port.new_filters.is_some() {
            self.refilter(id);
        }
        let port = &mut self.ports[id.0];
        let contends = match port.transmit.head() {
            None => Contends::No,
            Some(head) => {
                if port.contends == Contends::No {
                    port.ready_at = port.ready_at.max(nanos(now));
                }
                if port.ready_at <= self.free_at { Contends::Ready(head.arbitration()) } else { Contends::Waiting }
            }
        };
        if contends != port.contends {
            let before = std::mem::replace(&mut port.contends, contends);
            self.contenders.place(id, before, contends);
        }
    }

    /// When something is next due on the bus.
    #[must_use]
    pub fn next_event(&self) -> Instant {
        let mut due = match &self.current {
            Some(transmission) => transmission.over,
            None if self.recovering.is_empty() => instant(self.next_start()),
            None => instant(self.next_start().min(self.next_recovery())),
        };
        if !self.externals.is_empty() {
            due = due.min(instant(self.next_joining()));
        }
        due
    }

    /// Records from now on what happens, to be taken with [`take_events`](Self::take_events); or does so no longer.
    pub fn record_events(&mut self, on: bool) {
        self.journal.record(on);
    }

    /// Takes what happened since this was last called, oldest first.
    pub fn take_events(&mut self) -> Drain<'_, Event> {
        self.journal.take()
    }

    /// Notes that the device behind a port dropped frames.
    pub(crate) fn note_dropped(&mut self, id: PortId, count: u32, now: Instant) {
        let who = &self.ports[id.0].name;
        self.journal.note(|| Some(Event { at: now, who: who.clone(), what: EventKind::FramesDropped { count } }));
    }

    /// How much of the second before `now` the bus was busy, in percent.
    #[must_use]
    pub fn load(&self, now: Instant) -> u8 {
        self.load.percent(nanos(now))
    }

    /// Whether there are ports to be [taken](Self::swap_touched).
    #[inline]
    pub(crate) const fn is_any_touched(&self) -> bool {
        !self.touched.is_empty()
    }

    /// The devices' ports that received something, sent something or changed their error mode, in the order of their
    /// numbers, into an empty `ports`.
    #[inline]
    pub(crate) fn swap_touched(&mut self, ports: &mut Vec<PortId>) {
        std::mem::swap(&mut self.touched, ports);
        if !ports.is_sorted_by(|one, next| one < next) {
            ports.sort_unstable();
            ports.dedup();
        }
    }

    fn add(&mut self, port: Port) -> PortId {
        self.ports.push(port);
        PortId(self.ports.len() - 1)
    }

    fn add_connected(&mut self, mut port: Port, now: Instant) -> PortId {
        port.connected = true;
        port.joined_at = nanos(now);
        port.ready_at = nanos(now);
        let id = match self.vacant.pop() {
            Some(id) => {
                self.ports[id.0] = port;
                id
            }
            None => self.add(port),
        };
        self.joining.push(id);
        id
    }
}
