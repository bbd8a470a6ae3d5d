//! A CAN bus in virtual time (ISO 11898-1): arbitration, acknowledgement, errors and fault confinement.
//!
//! One frame or error frame is on the wire at a time. When a frame starts, `transmission` computes the outcome and the
//! end time. At that time, `outcome` applies the outcome to the ports. Only affected ports are visited: contenders are
//! sorted in arbitration order (`contenders`), listeners are indexed by bit rate and filter (`listeners`), and only
//! error counters that can change are updated.
//!
//! When a port completes bus integration, it becomes a member of the group of its bit rate. Membership ends when the
//! port disconnects, changes its bit rate, loses a bit while error-passive, or goes bus-off (`membership`). Only
//! members receive and acknowledge.
//!
//! Simplifications: a failed attempt ends at the bit of the first error, and all controllers see the error frame
//! simultaneously. Oscillator tolerance, resynchronisation and overload frames are not simulated.

mod bits;
mod clock;
mod confinement;
mod contenders;
mod delayed;
mod event;
mod external;
mod fault;
mod fault_text;
mod faults;
mod hand_over;
mod injector;
mod listeners;
mod load;
mod membership;
mod outcome;
mod port;
mod transmission;
mod transmit;

#[cfg(test)]
mod bits_tests;
#[cfg(test)]
mod collision_tests;
#[cfg(test)]
mod external_tests;
#[cfg(test)]
mod fault_tests;
#[cfg(test)]
mod rig;
#[cfg(test)]
mod several_faults_tests;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER};

pub use bits::{FrameBits, INTERMISSION};
pub use confinement::Confinement;
pub use event::{BusError, Event, EventKind, WireEvent};
pub use fault::{
    ALWAYS, Corruption, Delay, Fault, FaultEffect, FaultError, FaultKind, FrameFilter, MAX_FAULTS, MAX_REPEATS, Masks,
};
pub use faults::FaultState;
pub use hand_over::DeviceCan;
pub use injector::{BitErrors, DestroyNext, Disturbance, Injector};
pub use port::Port;
pub(crate) use port::SlowAnswers;

use clock::{Nanos, instant, nanos};
use contenders::{Contenders, Contends};
use event::Journal;
use faults::Faults;
use injector::Injects;
use listeners::Group;
use load::Load;
use port::RECEIVE_QUEUE;
use transmission::Transmission;
use transmit::TransmitKind;

/// The suffix of the name of a gateway's second controller, which only acknowledges.
pub(crate) const LISTENING: &str = ", listening";

/// The number of a port on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct PortId(pub(crate) usize);

/// A bus and all its controllers.
#[derive(Clone, Default)]
pub(crate) struct Bus {
    ports: Vec<Port>,
    /// The free port numbers of removed clients.
    vacant: Vec<PortId>,
    contenders: Contenders,
    /// The members, grouped by bit rate.
    groups: Vec<Group>,
    /// The ports in bus integration, which wait for recessive bits.
    joining: Vec<PortId>,
    /// The ports with an external controller.
    externals: Vec<PortId>,
    /// The bus-off ports that are recovering.
    recovering: Vec<PortId>,
    /// The frame or error frame on the wire.
    current: Option<Transmission>,
    /// The senders of the frame on the wire: more than one if they send the same frame or collide.
    senders: Vec<PortId>,
    /// The earliest start of the next frame.
    free_at: Nanos,
    /// The device ports that have changed since the last [`swap_touched`](Self::swap_touched).
    touched: Vec<PortId>,
    injectors: Vec<Box<dyn Injects>>,
    /// The disturbance requested by the user.
    pub(crate) disturbance: Disturbance,
    faults: Faults,
    /// The ports with frames delayed between application and controller.
    delaying: Vec<PortId>,
    /// The earliest time at which a delayed frame or an insertion may be due, cached because every event needs this
    /// time.
    fault_due: Option<Instant>,
    load: Load,
    pub(crate) journal: Journal,
}

impl Bus {
    /// Adds the controller of a new device, initially disconnected.
    pub(crate) fn add_device(&mut self, name: Arc<str>, rate: BitRate) -> PortId {
        self.add(Port::new(name, rate, TransmitKind::Mailboxes, RECEIVE_QUEUE))
    }

    /// Adds a client whose receive queue holds `room` frames. The client is connected and integrated immediately.
    pub(crate) fn add_client(&mut self, name: Arc<str>, rate: BitRate, room: usize, now: Instant) -> PortId {
        let mut port = Port::new(name, rate, TransmitKind::Queue, room);
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

    /// Marks a client as send-only: it uses no received frames. A [`FaultKind::Lose`] that names this client is
    /// refused.
    pub(crate) fn only_send(&mut self, id: PortId) {
        self.ports[id.0].only_sends = true;
    }

    /// Removes a client; its port number can be reused.
    pub(crate) fn remove(&mut self, id: PortId, now: Instant) {
        self.disconnect(id, now);
        if !self.vacant.contains(&id) {
            self.vacant.push(id);
        }
    }

    pub(crate) fn port(&self, id: PortId) -> &Port {
        &self.ports[id.0]
    }

    /// Returns a port, mutably. After a change, the caller must call [`refresh`](Self::refresh).
    pub(crate) fn port_mut(&mut self, id: PortId) -> &mut Port {
        &mut self.ports[id.0]
    }

    /// Connects a controller and clears its error counters. The controller participates after bus integration.
    pub(crate) fn connect(&mut self, id: PortId, now: Instant) {
        self.leave(id);
        self.stop_recovery(id);
        let port = &mut self.ports[id.0];
        port.connected = true;
        port.held = false;
        self.change(id, now, Confinement::recover);
        self.join(id, now);
    }

    /// Disconnects a controller and drops its pending and received frames. Its frame on the wire is cut off.
    pub(crate) fn disconnect(&mut self, id: PortId, now: Instant) {
        self.fall_silent(id, now);
        self.leave(id);
        self.stop_recovery(id);
        let port = &mut self.ports[id.0];
        port.connected = false;
        port.ready_at = Nanos::MAX;
        port.received.clear();
        self.clear(id);
        self.refresh(id, now);
    }

    /// Drops a port's pending frames. Its frame on the wire is cut off.
    pub(crate) fn drop_pending(&mut self, id: PortId, now: Instant) {
        self.fall_silent(id, now);
        self.clear(id);
        self.refresh(id, now);
    }

    /// Drops a port's pending frames and cuts off its frame on the wire. Frames that a fault delays remain, because the
    /// application considers these frames sent.
    pub(crate) fn drop_own(&mut self, id: PortId, now: Instant) {
        let delayed = self.ports[id.0].delayed.take_away();
        self.drop_pending(id, now);
        self.ports[id.0].delayed = delayed;
        self.release(id, now);
        self.refresh(id, now);
    }

    fn clear(&mut self, id: PortId) {
        let port = &mut self.ports[id.0];
        port.transmit.clear();
        port.delayed.clear();
        port.returned.clear();
        if !self.delaying.is_empty() {
            self.delaying.retain(|other| *other != id);
        }
    }

    pub(crate) fn is_sending(&self, id: PortId) -> bool {
        self.senders.contains(&id)
    }

    /// Sets the bit rate of a port. A different rate restarts bus integration but keeps the error counters.
    pub(crate) fn set_bit_rate(&mut self, id: PortId, rate: BitRate, now: Instant) {
        if self.ports[id.0].rate == rate {
            return;
        }
        self.fall_silent(id, now);
        self.leave(id);
        self.ports[id.0].rate = rate;
        self.join(id, now);
    }

    /// Forces a port bus-off if `on`, like an overflow of its transmit error counter. Otherwise starts the recovery of
    /// a bus-off port.
    pub(crate) fn force_bus_off(&mut self, id: PortId, on: bool, now: Instant) {
        self.ports[id.0].held = on;
        if on {
            self.fall_silent(id, now);
            self.change(id, now, Confinement::force_bus_off);
            self.stop_recovery(id);
        } else if self.ports[id.0].mode() == BusErrorMode::BusOff && self.ports[id.0].recovery.is_none() {
            self.begin_recovery(id, nanos(now));
        }
    }

    pub(crate) fn inject(&mut self, injector: impl Injector + Clone + 'static) {
        self.injectors.push(Box::new(injector));
    }

    fn schedule_faults(&mut self) {
        self.fault_due = Some(self.faults.next_insertion.min(self.next_release())).filter(|due| *due != NEVER);
    }

    /// Adds a communication fault. `own` lists the names of the controllers that send inserted frames.
    ///
    /// # Errors
    /// [`FaultError`]; the faults are unchanged.
    pub(crate) fn add_fault(&mut self, fault: Fault, own: &[Arc<str>], now: Instant) -> Result<(), FaultError> {
        let ports = (0..).zip(&self.ports).filter(|(number, _)| !self.vacant.contains(&PortId(*number)));
        let ports = ports.map(|(_, port)| port).filter(|port| !port.name.ends_with(LISTENING));
        let (known, receivers): (Vec<&str>, Vec<Option<&str>>) =
            ports.map(|port| (&*port.name, (!port.only_sends).then_some(&*port.name))).unzip();
        if let Some(name) = fault.names().find(|name| !known.contains(&&***name) && !self.faults.inserts(name)) {
            return Err(FaultError::Unknown { name: Arc::clone(name), known: known.join(", ") });
        }
        let receivers: Vec<&str> = receivers.into_iter().flatten().collect();
        if let FaultKind::Lose { receivers: named } = &fault.kind
            && let Some(name) = named.iter().find(|name| !receivers.contains(&&***name))
        {
            let known = receivers.join(", ");
            return Err(FaultError::Invalid(format!("'{name}' receives no frames; receivers: {known}")));
        }
        if matches!(fault.kind, FaultKind::Insert { .. }) && known.contains(&&*fault.name) && !own.contains(&fault.name)
        {
            let reason = "the name of an insert fault must not be the name of a device or client";
            return Err(FaultError::Invalid(reason.to_owned()));
        }
        self.faults.add(fault, now)?;
        self.schedule_faults();
        Ok(())
    }

    pub(crate) fn end_fault(&mut self, name: &str) -> bool {
        let has_ended = self.faults.end(name);
        self.schedule_faults();
        has_ended
    }

    pub(crate) fn end_faults(&mut self) {
        self.faults.clear();
        self.schedule_faults();
    }

    pub(crate) fn faults(&self, now: Instant) -> impl Iterator<Item = FaultState> {
        self.faults.states(now)
    }

    /// Returns whether [`serve_faults`](Self::serve_faults) must be called at `now`.
    pub(crate) fn is_fault_due(&self, now: Instant) -> bool {
        self.fault_due.is_some_and(|due| due <= now)
    }

    /// Hands over the delayed frames that are due by `now`. Returns the due frames to insert, each with the name of its
    /// fault. A fault listed in `busy` skips its frame, because its previous frame is still pending.
    #[cold]
    pub(crate) fn serve_faults(&mut self, now: Instant, busy: &[Arc<str>]) -> Vec<(Arc<str>, Frame)> {
        self.release_due(now);
        let inserted = self.faults.insert(now, busy);
        self.schedule_faults();
        let frames = inserted.iter().map(|(frame, event)| (Arc::clone(&event.who), *frame)).collect();
        self.journal.note(|| inserted.into_iter().map(|(_, event)| event));
        frames
    }

    /// Returns whether the fault with this name will insert further frames.
    pub(crate) fn inserts(&self, fault: &str) -> bool {
        self.faults.inserts(fault)
    }

    /// Drops a client's queued frames, except the frame on the wire.
    pub(crate) fn drop_waiting(&mut self, id: PortId, now: Instant) {
        self.ports[id.0].transmit.drop_waiting();
        self.refresh(id, now);
    }

    pub(crate) fn clear_injectors(&mut self) {
        self.injectors.clear();
    }

    /// [Refreshes](Self::refresh) a port if its device has changed its frames or filters since the last refresh.
    pub(crate) fn refresh_used(&mut self, id: PortId, now: Instant) {
        if self.ports[id.0].used {
            self.refresh(id, now);
        }
    }

    /// Updates the contention state and the filters of a port.
    pub(crate) fn refresh(&mut self, id: PortId, now: Instant) {
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

    /// Returns the time of the next event on the bus.
    pub(crate) fn next_event(&self) -> Instant {
        let mut due = match &self.current {
            Some(transmission) => transmission.over,
            None if self.recovering.is_empty() => instant(self.next_start()),
            None => instant(self.next_start().min(self.next_recovery())),
        };
        if !self.externals.is_empty() {
            due = due.min(instant(self.next_joining()));
        }
        self.fault_due.map_or(due, |fault| due.min(fault))
    }

    /// Records that the device of a port dropped `count` frames.
    pub(crate) fn note_dropped(&mut self, id: PortId, count: u32, now: Instant) {
        let who = &self.ports[id.0].name;
        self.journal.note(|| Some(Event { at: now, who: who.clone(), what: EventKind::FramesDropped { count } }));
    }

    pub(crate) fn load(&self, now: Instant) -> u8 {
        self.load.percent(nanos(now))
    }

    /// Returns whether any device port has changed since the last [`swap_touched`](Self::swap_touched).
    pub(crate) const fn is_any_touched(&self) -> bool {
        !self.touched.is_empty()
    }

    /// Moves the numbers of the changed device ports into `ports`, in ascending order. `ports` must be empty. A port
    /// has changed if it received a frame, ended a transmission attempt, or changed its error mode.
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
}
