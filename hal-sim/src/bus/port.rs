//! A port of the bus: the CAN controller of a device, or the place where a client is connected.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;
use std::convert::Infallible;
use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode, Controller, Filter, Filters};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::BUS_IDLE;
use super::clock::{Nanos, bit_times, instant};
use super::confinement::Confinement;
use super::contenders::Contends;
use super::listeners::Hears;
use super::transmit::Transmit;
use super::wire_event::{External, WireEvent};

/// How many received frames a device's controller holds, as the firmware's queue does.
pub const RECEIVE_QUEUE: usize = 256;

/// A CAN controller on the bus.
#[derive(Clone, Debug)]
pub struct Port {
    pub(super) name: Arc<str>,
    /// Whether a device is behind it, to be told what happens.
    pub(super) is_device: bool,
    pub(super) rate: BitRate,
    pub(super) connected: bool,
    pub(super) confinement: Confinement,
    pub(super) transmit: Transmit,
    pub(super) received: VecDeque<(Instant, Frame)>,
    /// What a device's controller lets through; everything where there are none.
    pub(super) filters: Option<Box<Filters>>,
    /// Whether its device has changed what it sends or hears since the bus looked at it.
    pub(super) used: bool,
    /// The filters that take their place as soon as the bus looks at the port.
    pub(super) new_filters: Option<Box<Filters>>,
    /// How many received frames there is room for.
    room: usize,
    overruns: u32,
    /// The end of the last frame that it heard or sent.
    pub(super) heard: Nanos,
    /// It takes part from then on; the end of time while that waits for the end of a frame.
    pub(super) joined_at: Nanos,
    /// It sends from then on; the end of time while it may not.
    pub(super) ready_at: Nanos,
    /// Whether it takes part: the bus lists it among the listeners at its bit rate.
    pub(super) member: bool,
    /// It lost a bit while it was error-passive, and suspends its transmission when it is in step again.
    pub(super) suspended: bool,
    /// It is kept bus-off.
    pub(super) held: bool,
    pub(super) recovery: Option<Recovery>,
    /// Where it is among the contenders.
    pub(super) contends: Contends,
    /// What it has beyond the others when its controller lives elsewhere.
    pub(super) external: Option<Box<External>>,
}

/// How far a controller has got on its way back from bus-off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recovery {
    /// How many sequences of 11 recessive bits are missing.
    pub(super) left: u32,
    /// Since when they count, the bus being idle.
    pub(super) since: Nanos,
}

impl Port {
    /// Returns the controller of a device, not yet connected.
    pub(super) fn of_device(name: Arc<str>, rate: BitRate) -> Self {
        let mut port = Self::new(name, rate, Transmit::mailboxes(), RECEIVE_QUEUE);
        port.is_device = true;
        port
    }

    /// Returns a client's place on the bus, not yet connected.
    pub(super) fn of_client(name: Arc<str>, rate: BitRate) -> Self {
        Self::new(name, rate, Transmit::queue(), usize::MAX)
    }

    /// Returns the place of a gateway without a client, not yet connected.
    pub(super) fn of_gateway(name: Arc<str>, rate: BitRate) -> Self {
        Self::new(name, rate, Transmit::queue(), 0)
    }

    /// Returns the place of a controller that lives elsewhere, not yet connected.
    pub(super) fn of_external(name: Arc<str>, rate: BitRate) -> Self {
        let mut port = Self::new(name, rate, Transmit::offer(), usize::MAX);
        port.external = Some(Box::default());
        port
    }

    fn new(name: Arc<str>, rate: BitRate, transmit: Transmit, room: usize) -> Self {
        Self {
            name,
            is_device: false,
            rate,
            connected: false,
            confinement: Confinement::default(),
            transmit,
            received: VecDeque::new(),
            filters: None,
            used: false,
            new_filters: None,
            room,
            overruns: 0,
            heard: 0,
            joined_at: Nanos::MAX,
            ready_at: Nanos::MAX,
            member: false,
            suspended: false,
            held: false,
            recovery: None,
            contends: Contends::No,
            external: None,
        }
    }

    /// Returns its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the bit rate that it is set to.
    #[must_use]
    pub const fn bit_rate(&self) -> BitRate {
        self.rate
    }

    /// Returns the mode that its error counters put it into.
    #[inline]
    #[must_use]
    pub const fn mode(&self) -> BusErrorMode {
        self.confinement.mode()
    }

    /// Returns its error counters.
    #[must_use]
    pub const fn confinement(&self) -> Confinement {
        self.confinement
    }

    /// Returns how many frames wait for the bus, the one on the wire included.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.transmit.len()
    }

    /// Returns how many received frames were lost because nobody read them.
    #[must_use]
    pub const fn overruns(&self) -> u32 {
        self.overruns
    }

    /// Returns what it has heard since this was last asked, oldest first.
    pub(crate) fn take_received(&mut self) -> Drain<'_, (Instant, Frame)> {
        self.received.drain(..)
    }

    /// Returns whether it may take part in what happens on the bus.
    #[inline]
    pub(super) const fn takes_part(&self) -> bool {
        self.connected && !matches!(self.confinement.mode(), BusErrorMode::BusOff)
    }

    /// Returns whether nobody notices that it listens.
    #[inline]
    pub(super) fn is_silent(&self) -> bool {
        self.external.as_ref().is_some_and(|external| external.silent)
    }

    /// Returns what it is to hear.
    pub(super) const fn hears(&self) -> Hears<'_> {
        match &self.filters {
            _ if self.room == 0 => Hears::Nothing,
            None => Hears::Everything,
            Some(filters) => Hears::Filtered(filters),
        }
    }

    /// Returns when it is back on the bus, if that stays idle.
    pub(super) fn recovered_at(&self) -> Option<Nanos> {
        let recovery = self.recovery?;
        Some(recovery.since + bit_times(recovery.left * BUS_IDLE, self.rate))
    }

    /// Takes a frame that its filters let through.
    #[inline]
    pub(super) fn deliver(&mut self, frame: &Frame, at: Instant) {
        if let Some(external) = &mut self.external {
            external.tell(at, WireEvent::Received(*frame));
        } else if self.received.len() < self.room {
            self.received.push_back((at, *frame));
        } else {
            self.overruns = self.overruns.saturating_add(1);
        }
    }

    /// Tells a controller that lives elsewhere.
    #[inline]
    pub(super) fn tell(&mut self, at: Nanos, event: WireEvent) {
        if let Some(external) = &mut self.external {
            external.tell(instant(at), event);
        }
    }
}

impl embedded_can::nb::Can for Port {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        self.used = true;
        self.transmit.put(*frame).map_err(|_| nb::Error::WouldBlock)
    }

    #[inline]
    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        self.received.pop_front().map(|(_, frame)| frame).ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for Port {
    #[inline]
    fn is_idle(&self) -> bool {
        self.transmit.is_empty()
    }

    fn abort(&mut self, which: Filter) {
        self.used = true;
        self.transmit.abort(which);
    }

    fn set_filters(&mut self, filters: &Filters) {
        self.used = true;
        self.new_filters = Some(Box::new(filters.clone()));
    }
}
