//! A port of the bus: the CAN controller of a device or a client.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;
use std::convert::Infallible;
use std::sync::Arc;

use protocol_core::controller::{BitRate, BusErrorMode, Controller, Filter, Filters};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};

use super::bits::BUS_IDLE;
use super::clock::{Nanos, bit_times, instant};
use super::confinement::Confinement;
use super::contenders::Contends;
use super::delayed::DelayedFrames;
use super::event::WireEvent;
use super::transmit::{Transmit, TransmitKind};

/// The capacity of a device controller's receive queue, the same as in the firmware.
pub(super) const RECEIVE_QUEUE: usize = 256;

/// A CAN controller on the bus.
#[derive(Clone, Debug)]
pub struct Port {
    pub(super) name: Arc<str>,
    /// True if the port belongs to a client that uses no received frame.
    pub(super) only_sends: bool,
    pub(super) rate: BitRate,
    pub(super) connected: bool,
    pub(super) confinement: Confinement,
    pub(super) transmit: Transmit,
    /// The frames delayed between the application and the controller.
    pub(super) delayed: DelayedFrames,
    /// The device's answer delay, if any.
    pub(super) answers: Option<Box<SlowAnswers>>,
    /// True if refused frames wait in front of the controller for a free mailbox.
    pub(super) queues: bool,
    /// The frames that more urgent frames displaced from the controller. Faults have already been applied to these
    /// frames.
    pub(super) returned: Vec<Frame>,
    pub(super) received: VecDeque<(Instant, Frame)>,
    /// The acceptance filters of a device's controller; `None` accepts all frames.
    pub(super) filters: Option<Box<Filters>>,
    /// True if the device has changed its frames or filters since the last refresh.
    pub(super) used: bool,
    /// The filters that take effect at the next refresh.
    pub(super) new_filters: Option<Box<Filters>>,
    /// The capacity of the receive queue.
    room: usize,
    overruns: u32,
    /// The end of the last frame that the port sent, received or must ignore. Prevents a second delivery of a frame.
    pub(super) heard: Nanos,
    /// The time at which bus integration completes; `Nanos::MAX` while the port waits for the end of a frame.
    pub(super) joined_at: Nanos,
    /// The earliest time at which the port may send; `Nanos::MAX` if the port may not send.
    pub(super) ready_at: Nanos,
    /// True if the bus lists the port among the members at its bit rate.
    pub(super) member: bool,
    /// True if the port must suspend transmission after bus integration, because it lost a bit while error-passive.
    pub(super) suspended: bool,
    /// True if the port is forced bus-off.
    pub(super) held: bool,
    pub(super) recovery: Option<Recovery>,
    /// True if the controller has gone bus-off since the last [`take_bus_off`](Self::take_bus_off).
    pub(super) was_bus_off: bool,
    pub(super) contends: Contends,
    /// The state of an external controller.
    pub(super) external: Option<Box<External>>,
}

/// The bounds of a device's random answer delay.
#[derive(Clone, Debug)]
pub(crate) struct SlowAnswers {
    pub(crate) is_answer: fn(&Frame) -> bool,
    pub(crate) from: Duration,
    pub(crate) to: Duration,
    pub(crate) random: fastrand::Rng,
}

impl SlowAnswers {
    /// Returns a random delay if the frame is an answer.
    pub(super) fn delay(&mut self, frame: &Frame) -> Option<Duration> {
        let range = self.from.as_ticks()..=self.to.as_ticks();
        (self.is_answer)(frame).then(|| Duration::from_ticks(self.random.u64(range)))
    }
}

/// The state of an external controller.
#[derive(Clone, Debug, Default)]
pub(super) struct External {
    /// The wire events that the controller has not taken yet.
    pub(super) events: VecDeque<(Instant, WireEvent)>,
    /// True if [`WireEvent::Joined`] has yet to be reported.
    pub(super) joining: bool,
    /// True if the start of the current frame was reported.
    pub(super) in_frame: bool,
    /// True if the controller is in listen-only mode and sends no frames, acknowledgements or error flags.
    pub(super) silent: bool,
}

/// The progress of a bus-off recovery.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recovery {
    /// The remaining number of sequences of 11 recessive bits.
    pub(super) left: u32,
    /// The time from which idle time counts towards the recovery.
    pub(super) since: Nanos,
}

impl Port {
    /// Creates a device controller without a bus. The caller takes the frames from the mailboxes; no frames are
    /// received.
    #[must_use]
    pub fn alone(name: &str, rate: BitRate) -> Self {
        Self::new(name.into(), rate, TransmitKind::Mailboxes, RECEIVE_QUEUE)
    }

    /// Creates a disconnected port. `room` is the capacity of the receive queue.
    pub(super) fn new(name: Arc<str>, rate: BitRate, kind: TransmitKind, room: usize) -> Self {
        Self {
            external: (kind == TransmitKind::Offer).then(Box::default),
            name,
            only_sends: false,
            rate,
            connected: false,
            confinement: Confinement::default(),
            transmit: Transmit::new(kind),
            delayed: DelayedFrames::default(),
            answers: None,
            queues: false,
            returned: Vec::new(),
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
            was_bus_off: false,
            contends: Contends::No,
        }
    }

    /// Returns the name of the port.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the bit rate of the port.
    #[must_use]
    pub const fn bit_rate(&self) -> BitRate {
        self.rate
    }

    /// Returns the error mode.
    #[must_use]
    pub const fn mode(&self) -> BusErrorMode {
        self.confinement.mode()
    }

    /// Returns whether the controller has gone bus-off since the last call, even if it has recovered since.
    pub(crate) const fn take_bus_off(&mut self) -> bool {
        std::mem::replace(&mut self.was_bus_off, false)
    }

    /// Returns the error counters.
    #[must_use]
    pub const fn confinement(&self) -> Confinement {
        self.confinement
    }

    /// Returns the number of pending frames, including delayed frames and the frame on the wire.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.transmit.len() + self.delayed.len()
    }

    /// Returns whether the port belongs to a device, which must be served after events on its port.
    pub(super) fn is_device(&self) -> bool {
        self.transmit.kind == TransmitKind::Mailboxes
    }

    /// Returns the frame that the controller will send next.
    #[must_use]
    pub fn head(&self) -> Option<&Frame> {
        self.transmit.head()
    }

    /// Sends the most urgent pending frame immediately, as a controller on an idle bus would.
    pub fn send_head(&mut self) -> Option<Frame> {
        let frame = *self.head()?;
        self.transmit.sending();
        self.transmit.sent(true);
        Some(frame)
    }

    /// Drops all pending frames, as at bus-off.
    pub fn clear(&mut self) {
        self.transmit.clear();
    }

    /// Returns whether the acceptance filters pass a frame.
    pub(super) fn accepts(&self, frame: &Frame) -> bool {
        self.filters.as_ref().is_none_or(|filters| filters.iter().any(|filter| filter.passes(frame)))
    }

    /// Returns whether the controller has no pending frame. Frames delayed in front of the controller do not count.
    #[must_use]
    pub fn is_controller_empty(&self) -> bool {
        self.transmit.is_empty()
    }

    /// Returns whether a further frame from the application can be delayed.
    #[must_use]
    pub fn can_delay(&self) -> bool {
        !self.delayed.is_full()
    }

    /// Returns the number of received frames lost because the queue was full.
    #[must_use]
    pub const fn overruns(&self) -> u32 {
        self.overruns
    }

    pub(crate) fn take_received(&mut self) -> Drain<'_, (Instant, Frame)> {
        self.received.drain(..)
    }

    /// Returns whether the port is connected and not bus-off.
    pub(super) const fn takes_part(&self) -> bool {
        self.connected && !matches!(self.confinement.mode(), BusErrorMode::BusOff)
    }

    /// Returns whether the port's error flags destroy a frame: the port must be error-active and not in listen-only
    /// mode.
    pub(super) fn signals_errors(&self) -> bool {
        self.mode() == BusErrorMode::ErrorActive && !self.is_silent()
    }

    /// Returns whether the port is in listen-only mode.
    pub(super) fn is_silent(&self) -> bool {
        self.external.as_ref().is_some_and(|external| external.silent)
    }

    /// Returns the acceptance filters: a received frame must pass at least one filter. `None` accepts every frame. A
    /// port without a receive queue accepts no frame.
    pub(super) fn hears(&self) -> Option<&[Filter]> {
        if self.room == 0 { Some(&[]) } else { self.filters.as_deref().map(|filters| &filters[..]) }
    }

    /// Returns the time at which the bus-off recovery completes if the bus stays idle; `None` if no recovery is in
    /// progress.
    pub(super) fn recovered_at(&self) -> Option<Nanos> {
        let recovery = self.recovery?;
        Some(recovery.since + bit_times(recovery.left * BUS_IDLE, self.rate))
    }

    /// Delivers a received frame: reports it to an external controller, or else stores it in the receive queue. Counts
    /// an overrun if the queue is full.
    pub(super) fn deliver(&mut self, frame: &Frame, at: Instant) {
        if let Some(external) = &mut self.external {
            external.events.push_back((at, WireEvent::Received(*frame)));
        } else if self.received.len() < self.room {
            self.received.push_back((at, *frame));
        } else {
            self.overruns = self.overruns.saturating_add(1);
        }
    }

    /// Records a wire event for an external controller.
    pub(super) fn tell(&mut self, at: Nanos, event: WireEvent) {
        if let Some(external) = &mut self.external {
            external.events.push_back((instant(at), event));
        }
    }
}

impl embedded_can::nb::Can for Port {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        self.used = true;
        self.transmit.put(*frame)
    }

    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        self.received.pop_front().map(|(_, frame)| frame).ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for Port {
    fn holds(&self, which: Filter) -> bool {
        self.transmit.holds(which) || self.delayed.holds(which)
    }

    fn abort(&mut self, which: Filter) {
        self.used = true;
        self.transmit.abort(which);
        self.delayed.abort(which);
    }

    fn set_filters(&mut self, filters: &Filters) {
        self.used = true;
        self.new_filters = Some(Box::new(filters.clone()));
    }
}
