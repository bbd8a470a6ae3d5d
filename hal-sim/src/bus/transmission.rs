//! The start of a frame: arbitration, and the outcome of the attempt.

use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::bits::{AFTER_ACK_SLOT, ERROR_DELIMITER, ERROR_FLAG, FrameBits, TRAILER};
use super::clock::{Nanos, bit_times, instant, nanos};
use super::event::WireEvent;
use super::injector::Injector as _;
use super::listeners::Group;
use super::{Bus, BusError, EventKind, FaultEffect, PortId};

/// The number of bits after which a controller at another bit rate detects an error (A).
const WRONG_RATE_SEEN: u32 = 20;
/// The number of bits after which two senders at different bit rates destroy each other's frames (A).
const MIXED_RATES_SEEN: u32 = 6;
/// The bits of an error frame: the first error flag, the error flags in response, and the delimiter.
pub(super) const ERROR_FRAME: u32 = 2 * ERROR_FLAG + ERROR_DELIMITER;
/// The bits of an error frame without a response from another controller.
const LONE_ERROR_FRAME: u32 = ERROR_FLAG + ERROR_DELIMITER;

/// The frame or error frame on the wire.
#[derive(Clone, Debug)]
pub(super) struct Transmission {
    pub(super) frame: Frame,
    pub(super) rate: BitRate,
    pub(super) start: Nanos,
    /// The end of the frame or error frame.
    pub(super) end: Nanos,
    /// The value of `end` in world time, rounded up.
    pub(super) over: Instant,
    /// The failure of the attempt, or the loss of its senders; boxed because both are rare.
    pub(super) failure: Option<Box<Failure>>,
    /// The receivers that detect an error in the last but one bit of the end of frame; boxed because omissions are
    /// rare.
    pub(super) omission: Option<Box<Omission>>,
}

/// An error in the last but one bit of the end of frame that only some receivers detect. The other receivers have
/// accepted the frame by the last bit, so an error flag in that bit is an overload condition for them (ISO 11898-1,
/// 10.4.6).
#[derive(Clone, Debug)]
pub(super) struct Omission {
    pub(super) receivers: Vec<PortId>,
    /// The affected receiver whose error flag makes the sender retransmit the frame. `None` if no affected receiver is
    /// error-active: the sender then does not detect the error.
    pub(super) signalled_by: Option<PortId>,
}

/// The failure of a transmission attempt, or the loss of its senders.
#[derive(Clone, Debug)]
pub(super) struct Failure {
    /// The error that destroys the frame; `None` if all senders were cut off after the CRC sequence.
    pub(super) error: Option<BusError>,
    /// True if listeners at another bit rate destroyed the frame, although a receiver at the sender's rate would have
    /// acknowledged it.
    pub(super) by_other_rate: bool,
    /// The name of the controller that sent the first error flag; `None` if there was no error flag.
    pub(super) signalled_by: Option<Arc<str>>,
    /// The name of the last sender, if all senders were cut off.
    pub(super) gone: Option<Arc<str>>,
}

impl Failure {
    pub(super) fn new(error: BusError, signalled_by: Option<Arc<str>>) -> Box<Self> {
        Box::new(Self { error: Some(error), by_other_rate: false, signalled_by, gone: None })
    }
}

impl Transmission {
    pub(super) const fn set_end(&mut self, end: Nanos) {
        self.end = end;
        self.over = instant(end);
    }

    /// Returns the error that destroys the frame, if any.
    pub(super) fn error(&self) -> Option<BusError> {
        self.failure.as_ref().and_then(|failure| failure.error)
    }

    /// Returns the name of the last sender, if all senders were cut off.
    pub(super) fn gone(&self) -> Option<&Arc<str>> {
        self.failure.as_ref().and_then(|failure| failure.gone.as_ref())
    }
}

/// An error that destroys a transmission.
struct Disruption {
    error: BusError,
    /// The number of bits from start of frame to the error flag.
    bits: u32,
    by_other_rate: bool,
    /// The controller that sends the first error flag; `None` if the sender does.
    by: Option<PortId>,
}

impl Disruption {
    const fn new(error: BusError, bits: u32, by: Option<PortId>) -> Self {
        Self { error, bits, by_other_rate: false, by }
    }
}

impl Bus {
    /// Starts to send the most urgent pending frame if the bus is free.
    pub(crate) fn begin(&mut self, now: Instant) {
        if self.current.is_some() || self.contenders.ready.is_empty() && self.contenders.waiting.is_empty() {
            return;
        }
        let start = self.next_start();
        if start > nanos(now) {
            return;
        }
        if !self.joining.is_empty() {
            self.admit(start);
        }
        let ports = &mut self.ports;
        self.contenders.promote(|id| {
            let port = &mut ports[id.0];
            let key = port.transmit.head().filter(|_| port.ready_at <= start)?.arbitration();
            port.contends = super::Contends::Ready(key);
            Some(key)
        });
        self.contenders.winners(&mut self.senders);
        if !self.externals.is_empty() {
            self.tell_losers(start);
            self.tell_begin(start);
        }
        let transmission = self.transmit(start);
        for id in &self.senders {
            self.ports[id.0].transmit.sending();
        }
        if !self.recovering.is_empty() {
            self.pass_recovery_time(start);
        }
        self.current = Some(transmission);
    }

    /// Returns the earliest possible start of the next frame.
    pub(super) fn next_start(&self) -> Nanos {
        if !self.contenders.ready.is_empty() {
            return self.free_at;
        }
        let ready = self.contenders.waiting.iter().map(|id| self.ports[id.0].ready_at);
        ready.min().map_or(Nanos::MAX, |ready| ready.max(self.free_at))
    }

    /// Computes the outcome and the end of an attempt that starts at `start`.
    fn transmit(&mut self, start: Nanos) -> Transmission {
        let collision = if self.senders.len() > 1 { self.resolve(start) } else { None };
        let first = self.senders[0];
        let sender = &self.ports[first.0];
        let frame = *sender.transmit.head().expect("a sender has a pending frame");
        let rate = sender.rate;
        let on_wire = FrameBits::of(&frame).on_wire();
        let on_command = self.disturbance.disturb(&sender.name, &frame, on_wire);
        let injectors = self.injectors.iter_mut();
        let injected = injectors.filter_map(|injector| injector.disturb(&sender.name, &frame, on_wire));
        let mut injected = injected.chain(on_command).min();
        let heard = self.is_heard(rate);
        let disturber = self.disturber(rate);
        let end = start + bit_times(on_wire, rate);
        let mut transmission =
            Transmission { frame, rate, start, end, over: instant(end), failure: None, omission: None };
        let mut is_intact = collision.is_none() && injected.is_none() && disturber.is_none() && heard;
        if is_intact && self.faults.on_wire {
            injected = self.strike(first, &mut transmission, on_wire);
            is_intact = injected.is_none();
        }
        if is_intact {
            return transmission;
        }
        let disruptions = [
            collision,
            injected.map(|bit| Disruption::new(BusError::Bit, bit + 1, None)),
            disturber.map(|by| Disruption {
                by_other_rate: heard,
                ..Disruption::new(BusError::Stuff, WRONG_RATE_SEEN, Some(by))
            }),
            (!heard).then(|| Disruption::new(BusError::Acknowledgement, on_wire - AFTER_ACK_SLOT, None)),
        ];
        if let Some(disruption) = disruptions.into_iter().flatten().min_by_key(|disruption| disruption.bits) {
            let error_frame = if heard || disturber.is_some() { ERROR_FRAME } else { LONE_ERROR_FRAME };
            let by = disruption.by.unwrap_or(first);
            transmission.omission = None;
            transmission.set_end(start + bit_times(disruption.bits + error_frame, rate));
            let mut failure = Failure::new(disruption.error, Some(self.ports[by.0].name.clone()));
            failure.by_other_rate = disruption.by_other_rate;
            transmission.failure = Some(failure);
        }
        transmission
    }

    /// Applies the faults on the wire to an attempt. Returns the index of the bit to destroy, if any.
    #[cold]
    fn strike(&mut self, sender: PortId, transmission: &mut Transmission, on_wire: u32) -> Option<u32> {
        let Transmission { frame, rate, start, .. } = *transmission;
        let Self { faults, ports, groups, senders, .. } = self;
        let has_receiver = |names: &[Arc<str>]| {
            members(groups, rate).any(|id| !senders.contains(id) && names.contains(&ports[id.0].name))
        };
        let event = faults.on_wire(&ports[sender.0].name, &frame, has_receiver, instant(start))?;
        let mut destroyed = None;
        if let EventKind::Fault { effect, .. } = &event.what {
            match effect {
                FaultEffect::Omitted(names) => {
                    let omission = self.omission(names, rate);
                    if omission.signalled_by.is_some() {
                        transmission.set_end(start + bit_times(on_wire - 1, rate));
                    }
                    transmission.omission = Some(Box::new(omission));
                }
                _ => destroyed = Some(on_wire / 2),
            }
        }
        self.journal.note(|| Some(event));
        destroyed
    }

    /// Creates an omission that affects the members with these names at a bit rate.
    fn omission(&self, names: &[Arc<str>], rate: BitRate) -> Omission {
        let is_meant = |id: &PortId| !self.senders.contains(id) && names.contains(&self.ports[id.0].name);
        let receivers: Vec<PortId> = members(&self.groups, rate).copied().filter(is_meant).collect();
        Omission { signalled_by: receivers.iter().copied().find(|id| self.ports[id.0].signals_errors()), receivers }
    }

    /// Returns whether a controller other than the senders acknowledges frames at a bit rate.
    pub(super) fn is_heard(&self, rate: BitRate) -> bool {
        let listeners = self.groups.iter().find(|group| group.rate == rate).map_or(0, |group| group.audible);
        // Senders are members too.
        let senders = &self.senders;
        listeners > senders.len() || listeners > senders.iter().filter(|id| self.ports[id.0].rate == rate).count()
    }

    /// Returns the first error-active listener at another bit rate. Its error flag destroys the frame.
    fn disturber(&self, rate: BitRate) -> Option<PortId> {
        let others = self.groups.iter().filter(|group| group.rate != rate && group.active > 0);
        let disturbs = |id: &&PortId| self.ports[id.0].signals_errors() && !self.senders.contains(id);
        others.filter_map(|group| group.members.iter().find(disturbs)).min().copied()
    }

    /// Resolves a collision of senders with equal arbitration keys. Equal frames are sent as one. Different frames
    /// collide at the first different bit, where the recessive sender detects a bit error. If that sender is
    /// error-passive, its error flag does not destroy the frame, and the dominant frame continues.
    fn resolve(&mut self, start: Nanos) -> Option<Disruption> {
        while self.senders.len() > 1 {
            let senders = &self.senders;
            let first = self.head_of(senders[0]);
            let rate = self.ports[senders[0].0].rate;
            if senders.iter().any(|id| self.ports[id.0].rate != rate) {
                return Some(Disruption::new(BusError::Bit, MIXED_RATES_SEEN, None));
            }
            let differences = senders[1..].iter().filter_map(|id| first.first_difference(self.head_of(*id)));
            let parting = differences.min_by_key(|difference| difference.bit)?;
            let recessive = |id: &PortId| {
                let difference = first.first_difference(self.head_of(*id)).filter(|other| other.bit == parting.bit);
                difference.is_some() == parting.dominant
            };
            let losers: Vec<PortId> = senders.iter().copied().filter(recessive).collect();
            let by = losers.iter().find(|id| self.ports[id.0].mode() == BusErrorMode::ErrorActive).copied();
            if by.is_some() {
                return Some(Disruption::new(BusError::Bit, parting.bit + 1, by));
            }
            self.senders.retain(|id| !losers.contains(id));
            let at = start + bit_times(parting.bit + 1, rate);
            for id in losers {
                self.beaten(id, at);
            }
        }
        None
    }

    /// Ends the attempt of an error-passive sender that lost a bit to another sender.
    fn beaten(&mut self, id: PortId, at: Nanos) {
        let port = &mut self.ports[id.0];
        port.tell(at, WireEvent::NotSent(BusError::Bit));
        port.transmit.sent(false);
        if port.is_device() {
            self.touched.push(id);
        }
        self.fall_out_of_step(id, instant(at));
    }

    fn head_of(&self, id: PortId) -> FrameBits {
        FrameBits::of(self.ports[id.0].transmit.head().expect("a sender has a pending frame"))
    }

    /// Cuts off a frame that a port is sending. Unless another sender continues the frame, the other controllers detect
    /// a stuff error, or, after the CRC sequence, receive the frame: its last bits are recessive (ISO 11898-1, 10.4).
    pub(super) fn fall_silent(&mut self, id: PortId, now: Instant) {
        let Some(transmission) = &mut self.current else { return };
        if !self.senders.contains(&id) {
            return;
        }
        self.ports[id.0].transmit.sent(false);
        self.senders.retain(|sender| *sender != id);
        if !self.senders.is_empty() {
            return;
        }
        let gone = Some(self.ports[id.0].name.clone());
        if let Some(failure) = &mut transmission.failure {
            failure.gone = gone;
            return;
        }
        let trailer = FrameBits::of(&transmission.frame).on_wire() - TRAILER;
        if nanos(now) >= transmission.start + bit_times(trailer, transmission.rate) {
            // A port that stays connected does not receive its own frame.
            self.ports[id.0].heard = transmission.end;
            transmission.failure =
                Some(Box::new(Failure { error: None, by_other_rate: false, signalled_by: None, gone }));
            return;
        }
        transmission.omission = None;
        let group = self.groups.iter().find(|group| group.rate == transmission.rate);
        let witness = group.and_then(|group| group.members.iter().find(|other| **other != id));
        let signalled_by = witness.map(|id| self.ports[id.0].name.clone());
        transmission.set_end(nanos(now).max(transmission.start) + bit_times(ERROR_FRAME, transmission.rate));
        transmission.failure = Some(Box::new(Failure { gone, ..*Failure::new(BusError::Stuff, signalled_by) }));
    }
}

pub(super) fn members(groups: &[Group], rate: BitRate) -> impl Iterator<Item = &PortId> {
    groups.iter().filter(move |group| group.rate == rate).flat_map(|group| &group.members)
}
