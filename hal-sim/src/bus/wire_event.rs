//! The events that an external controller notices on the wire.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;

use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::error::BusError;

/// An event that an external controller notices on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireEvent {
    /// The controller has seen 11 recessive bits and takes part.
    Joined,
    /// A frame begins.
    Begins {
        /// This controller sends the frame: its offer has won the arbitration.
        own: bool,
    },
    /// Another controller's more urgent frame has won against the offer.
    LostArbitration,
    /// The controller's own frame was sent and acknowledged.
    Sent,
    /// The controller's own frame was destroyed, not acknowledged, or lost a bit to the same identifier with other
    /// data.
    NotSent(BusError),
    /// A frame was received.
    Received(Frame),
    /// Another controller's frame was destroyed.
    NotReceived {
        /// This controller sent the first error flag.
        first: bool,
    },
    /// The frame or error frame on the wire has ended.
    Ends,
    /// The controller, bus-off until now, has seen 128 sequences of 11 recessive bits.
    Recovered,
}

/// The state of an external controller's port.
#[derive(Clone, Debug, Default)]
pub(super) struct External {
    events: VecDeque<(Instant, WireEvent)>,
    /// The controller has not been told yet that it has joined.
    pub(super) joining: bool,
    /// The controller was told that the current frame begins.
    pub(super) in_frame: bool,
    /// The controller sends no dominant bit: no frames, acknowledgements or error flags.
    pub(super) silent: bool,
}

impl External {
    pub(super) fn tell(&mut self, at: Instant, event: WireEvent) {
        self.events.push_back((at, event));
    }

    /// Takes the recorded events, oldest first.
    pub(super) fn take(&mut self) -> Drain<'_, (Instant, WireEvent)> {
        self.events.drain(..)
    }

    /// Takes the controller off the bus.
    pub(super) fn leave(&mut self) {
        self.joining = false;
        self.in_frame = false;
        self.events.clear();
    }
}
