//! The bus of the rig: the controller of hal-sim with its three mailboxes, on a free or a held bus.

use std::collections::VecDeque;
use std::convert::Infallible;

use hal_sim::Port;
use protocol_core::controller::{BitRate, Controller, Filter, Filters};
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

/// A controller on a bus. A free bus accepts every frame immediately; a held bus leaves frames in the mailboxes.
#[derive(Debug)]
pub(super) struct Wire {
    port: Port,
    pub(super) filters: Filters,
    pub(super) held: bool,
    /// Set while the controller is bus-off and sends nothing.
    pub(super) bus_off: bool,
    pub(super) now: Instant,
    pub(super) sent: VecDeque<(Instant, Frame)>,
}

impl Wire {
    pub(super) fn new(now: Instant) -> Self {
        let port = Port::alone("rig", BitRate::Kbit250);
        Self { port, filters: Filters::new(), held: false, bus_off: false, now, sent: VecDeque::new() }
    }

    /// Replaces the controller by a new one on the same bus.
    pub(super) fn power_cycle(&mut self) {
        self.port = Port::alone("rig", BitRate::Kbit250);
        self.sent.clear();
    }

    /// Returns the number of frames in the mailboxes.
    pub(super) fn pending(&self) -> usize {
        self.port.pending()
    }

    /// Drops the frames in the mailboxes.
    pub(super) fn clear(&mut self) {
        self.port.clear();
    }

    /// Sends the most urgent frame of the mailboxes if the bus accepts it. Returns whether a frame was sent.
    pub(super) fn send_one(&mut self) -> bool {
        if self.held || self.bus_off {
            return false;
        }
        let sent = self.port.send_head().map(|frame| (self.now, frame));
        self.sent.extend(sent);
        sent.is_some()
    }
}

impl embedded_can::nb::Can for Wire {
    type Frame = Frame;
    type Error = Infallible;

    /// Accepts only a more urgent frame beside a pending one, as the driver of the board does.
    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        if self.port.head().is_some_and(|head| frame.arbitration() >= head.arbitration()) {
            return Err(nb::Error::WouldBlock);
        }
        let overtaken = self.port.transmit(frame)?;
        while self.send_one() {}
        Ok(overtaken)
    }

    /// Returns nothing, because the rig hands received frames to the device itself.
    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        Err(nb::Error::WouldBlock)
    }
}

impl Controller for Wire {
    fn holds(&self, which: Filter) -> bool {
        self.port.holds(which)
    }

    fn abort(&mut self, which: Filter) {
        self.port.abort(which);
    }

    fn set_filters(&mut self, filters: &Filters) {
        self.filters.clone_from(filters);
    }
}
