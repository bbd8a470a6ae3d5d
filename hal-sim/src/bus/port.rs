//! A port of the bus: the CAN controller of a device, or the place where a client is connected.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;
use std::convert::Infallible;
use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode, Controller, Filter, Filters};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::clock::Nanos;
use super::confinement::Confinement;
use super::external::{External, WireEvent};
use super::transmit::Transmit;

/// How many received frames a device's controller holds, as the firmware's queue does.
pub const RECEIVE_QUEUE: usize = 256;

/// A CAN controller on the bus.
#[derive(Debug)]
pub struct Port {
    pub(super) name: Arc<str>,
    pub(super) rate: BitRate,
    pub(super) connected: bool,
    pub(super) confinement: Confinement,
    pub(super) transmit: Transmit,
    pub(super) received: VecDeque<(Instant, Frame)>,
    /// What a device's controller lets through; everything where there are none.
    filters: Option<Filters>,
    /// How many received frames there is room for.
    room: usize,
    overruns: u32,
    /// It hears frames that start from then on.
    pub(super) joined_at: Nanos,
    /// It sends from then on.
    pub(super) ready_at: Nanos,
    pub(super) recovery: Option<Recovery>,
    /// Whether the bus knows that it has something to send.
    pub(super) contends: bool,
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
    /// The controller of a device, not yet connected.
    pub(super) fn of_device(name: Arc<str>, rate: BitRate) -> Self {
        Self::new(name, rate, Transmit::mailboxes(), RECEIVE_QUEUE)
    }

    /// A client's place on the bus, not yet connected.
    pub(super) fn of_tap(name: Arc<str>, rate: BitRate) -> Self {
        Self::new(name, rate, Transmit::queue(), usize::MAX)
    }

    /// The place of a gateway without a client, not yet connected.
    pub(super) fn of_gateway(name: Arc<str>, rate: BitRate) -> Self {
        Self::new(name, rate, Transmit::queue(), 0)
    }

    fn new(name: Arc<str>, rate: BitRate, transmit: Transmit, room: usize) -> Self {
        Self {
            name,
            rate,
            connected: false,
            confinement: Confinement::default(),
            transmit,
            received: VecDeque::new(),
            filters: None,
            room,
            overruns: 0,
            joined_at: 0,
            ready_at: 0,
            recovery: None,
            contends: false,
            external: None,
        }
    }

    /// The bit rate that it is set to.
    #[must_use]
    pub const fn bit_rate(&self) -> BitRate {
        self.rate
    }

    /// The mode that its error counters put it into.
    #[inline]
    #[must_use]
    pub const fn mode(&self) -> BusErrorMode {
        self.confinement.mode()
    }

    /// Its error counters.
    #[must_use]
    pub const fn confinement(&self) -> Confinement {
        self.confinement
    }

    /// How many frames wait for the bus, the one on the wire included.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.transmit.len()
    }

    /// How many received frames were lost because nobody read them.
    #[must_use]
    pub const fn overruns(&self) -> u32 {
        self.overruns
    }

    /// What it has heard since this was last asked, oldest first.
    pub(crate) fn take_received(&mut self) -> Drain<'_, (Instant, Frame)> {
        self.received.drain(..)
    }

    /// Whether it takes part in what happens on the bus.
    #[inline]
    pub(super) const fn takes_part(&self) -> bool {
        self.connected && !matches!(self.confinement.mode(), BusErrorMode::BusOff)
    }

    /// Takes a frame that was on the bus. Returns whether the filters let it through.
    #[inline]
    pub(super) fn deliver(&mut self, frame: &Frame, at: Instant) -> bool {
        if !self.lets_through(frame) {
            return false;
        }
        if let Some(external) = &mut self.external {
            external.tell(at, WireEvent::Received(*frame));
        } else if self.received.len() < self.room {
            self.received.push_back((at, *frame));
        } else {
            self.overruns = self.overruns.saturating_add(1);
        }
        true
    }

    #[inline]
    fn lets_through(&self, frame: &Frame) -> bool {
        let Some(filters) = &self.filters else { return true };
        !frame.is_remote() && filters.iter().any(|filter| filter.passes(frame))
    }
}

impl embedded_can::nb::Can for Port {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
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
        self.transmit.abort(which);
    }

    fn set_filters(&mut self, filters: &Filters) {
        self.filters = Some(filters.clone());
    }
}
