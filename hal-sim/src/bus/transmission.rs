//! The start of a frame: who wins the bus, and how the attempt will end.

use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::bits::{ERROR_DELIMITER, ERROR_FLAG, FrameBits};
use super::clock::{Nanos, bit_times, instant, nanos};
use super::confinement::Confinement;
use super::external::WireEvent;
use super::port::Port;
use super::{Bus, BusError, PortId};

/// After so many bits a controller at another bit rate has seen something impossible (A).
const WRONG_RATE_SEEN: u32 = 20;
/// After so many bits two senders at different bit rates have disturbed each other (A).
const MIXED_RATES_SEEN: u32 = 6;
/// The flag of the first, the flags of the others that answer it, and the delimiter.
pub(super) const ERROR_FRAME: u32 = 2 * ERROR_FLAG + ERROR_DELIMITER;
/// An error frame that nobody answers.
const LONE_ERROR_FRAME: u32 = ERROR_FLAG + ERROR_DELIMITER;

/// What is on the wire.
#[derive(Debug)]
pub(super) struct Transmission {
    pub(super) frame: Frame,
    pub(super) rate: BitRate,
    /// Who sends it; several when they send the same, or when none of them has noticed the others yet.
    pub(super) senders: Vec<PortId>,
    /// The name of the first of the senders: it may be gone when the frame ends.
    pub(super) from: Arc<str>,
    pub(super) start: Nanos,
    /// When the frame or the error frame ends.
    pub(super) end: Nanos,
    pub(super) error: Option<BusError>,
    /// Whether listeners at another bit rate than everybody else destroyed it.
    pub(super) by_other_rate: bool,
    /// The name of the controller whose error flag is the first, where there is an error.
    pub(super) signalled_by: Arc<str>,
}

/// The earliest thing that goes wrong.
struct Fate {
    error: BusError,
    /// From the start of frame to the first bit of the error flag.
    bits: u32,
    by_other_rate: bool,
    /// Whose error flag is the first; the sender's where there is none.
    by: Option<PortId>,
}

impl Bus {
    /// Lets the most urgent frame start if the bus is free for one.
    pub fn begin(&mut self, now: Instant) {
        if self.current.is_some() || self.contenders.is_empty() {
            return;
        }
        let start = self.next_start();
        if start > nanos(now) {
            return;
        }
        let mut senders = std::mem::take(&mut self.spare);
        self.arbitrate(start, &mut senders);
        let transmission = self.transmit(start, senders);
        self.tell_losers(start, &transmission.senders);
        for id in &transmission.senders {
            self.ports[id.0].transmit.sending();
        }
        self.tell_all(start, |id| WireEvent::Begins { own: transmission.senders.contains(&id) });
        self.pass_recovery_time(start);
        self.current = Some(transmission);
    }

    /// When the next frame may start.
    pub(super) fn next_start(&self) -> Nanos {
        let ready = self.contenders.iter().map(|id| &self.ports[id.0]).filter(|port| port.takes_part());
        ready.map(|port| port.ready_at.max(self.free_at)).min().unwrap_or(Nanos::MAX)
    }

    /// Those who are still sending when the identifiers are through: one, as a rule.
    fn arbitrate(&self, start: Nanos, senders: &mut Vec<PortId>) {
        let mut winning = u32::MAX;
        for id in &self.contenders {
            let port = &self.ports[id.0];
            let Some(head) = port.transmit.head().filter(|_| port.takes_part() && port.ready_at <= start) else {
                continue;
            };
            let arbitration = head.arbitration();
            if arbitration < winning || senders.is_empty() {
                winning = arbitration;
                senders.clear();
            }
            if arbitration == winning {
                senders.push(*id);
            }
        }
    }

    fn transmit(&mut self, start: Nanos, mut senders: Vec<PortId>) -> Transmission {
        let from = self.ports[senders[0].0].name.clone();
        let collision = self.resolve(start, &mut senders);
        let first = &self.ports[senders[0].0];
        let frame = *first.transmit.head().expect("a sender has something to send");
        let rate = first.rate;
        let bits = FrameBits::of(&frame);
        let on_wire = bits.on_wire();

        let mut heard = false;
        let mut disturbed = None;
        for (number, port) in self.ports.iter().enumerate() {
            if !port.takes_part() || port.joined_at > start || port.is_silent() || senders.contains(&PortId(number)) {
                continue;
            }
            if port.rate == rate {
                heard = true;
            } else if port.mode() == BusErrorMode::ErrorActive {
                disturbed = disturbed.or(Some(PortId(number)));
            }
        }
        let silence =
            Fate { error: BusError::Acknowledgement, bits: bits.to_ack_slot(), by_other_rate: false, by: None };
        let other_rate =
            |by| Fate { error: BusError::Stuff, bits: WRONG_RATE_SEEN, by_other_rate: heard, by: Some(by) };
        let injected = self.injectors.iter_mut().filter_map(|injector| injector.disturb(&from, &frame, on_wire)).min();
        let injected = injected.map(|bit| Fate { error: BusError::Bit, bits: bit + 1, by_other_rate: false, by: None });
        let fates = [collision, injected, disturbed.map(other_rate), (!heard).then_some(silence)];
        let fate = fates.into_iter().flatten().min_by_key(|fate| fate.bits);

        let length = match &fate {
            None => on_wire,
            Some(fate) if heard || disturbed.is_some() => fate.bits + ERROR_FRAME,
            Some(fate) => fate.bits + LONE_ERROR_FRAME,
        };
        let signaller = fate.as_ref().and_then(|fate| fate.by).map(|id| self.ports[id.0].name.clone());
        Transmission {
            frame,
            rate,
            senders,
            start,
            end: start + bit_times(length, rate),
            by_other_rate: fate.as_ref().is_some_and(|fate| fate.by_other_rate),
            error: fate.map(|fate| fate.error),
            signalled_by: signaller.unwrap_or_else(|| from.clone()),
            from,
        }
    }

    /// What comes of several senders that are still at it after the identifier: equal frames go out as one, different
    /// ones collide at the first different bit. There the recessive sender sees the error; if it is error-passive,
    /// nobody hears it complain, and the dominant frame goes on.
    fn resolve(&mut self, start: Nanos, senders: &mut Vec<PortId>) -> Option<Fate> {
        while senders.len() > 1 {
            let first = self.head_of(senders[0]);
            let rate = self.ports[senders[0].0].rate;
            if senders.iter().any(|id| self.ports[id.0].rate != rate) {
                return Some(Fate { error: BusError::Bit, bits: MIXED_RATES_SEEN, by_other_rate: false, by: None });
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
                return Some(Fate { error: BusError::Bit, bits: parting.bit + 1, by_other_rate: false, by });
            }
            senders.retain(|id| !losers.contains(id));
            for id in losers {
                self.change(id, instant(start), Confinement::transmit_error);
                self.touched.push(id);
            }
        }
        None
    }

    fn head_of(&self, id: PortId) -> FrameBits {
        FrameBits::of(self.ports[id.0].transmit.head().expect("a sender has something to send"))
    }

    /// The sender stops in the middle of its frame: the others see an error where the bits end.
    pub(super) fn fall_silent(&mut self, id: PortId, now: Instant) {
        let Some(transmission) = &mut self.current else { return };
        if !transmission.senders.contains(&id) {
            return;
        }
        self.ports[id.0].transmit.sent(false);
        transmission.senders.retain(|sender| *sender != id);
        if transmission.senders.is_empty() && transmission.error.is_none() {
            transmission.error = Some(BusError::Stuff);
            transmission.end = nanos(now).max(transmission.start) + bit_times(ERROR_FRAME, transmission.rate);
        }
    }
}

impl Port {
    /// When it is back on the bus, if that stays idle.
    pub(super) fn recovered_at(&self) -> Option<Nanos> {
        let recovery = self.recovery?;
        Some(recovery.since + bit_times(recovery.left * super::BUS_IDLE, self.rate))
    }
}
