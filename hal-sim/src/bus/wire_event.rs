//! The bus events that an external controller detects.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;

use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::error::BusError;

/// A bus event that an external controller detects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireEvent {
    /// Bus integration is complete: the controller has seen 11 recessive bits.
    Joined,
    /// A frame begins.
    Begins {
        /// Whether this controller sends the frame, because its offer won the arbitration.
        own: bool,
    },
    /// The controller's offer lost the arbitration to a more urgent frame.
    LostArbitration,
    /// The controller's own frame was sent and acknowledged.
    Sent,
    /// The controller's own frame was destroyed or not acknowledged, or lost a bit to another frame with the same
    /// identifier.
    NotSent(BusError),
    /// A frame was received.
    Received(Frame),
    /// Another controller's frame was destroyed.
    NotReceived {
        /// Whether this controller sent the first error flag.
        first: bool,
    },
    /// The frame or error frame on the wire has ended.
    Ends,
    /// Bus-off recovery is complete: the controller has seen 128 sequences of 11 recessive bits.
    Recovered,
}

/// The state of an external controller's port.
#[derive(Clone, Debug, Default)]
pub(super) struct External {
    events: VecDeque<(Instant, WireEvent)>,
    /// Whether [`WireEvent::Joined`] has yet to be reported.
    pub(super) joining: bool,
    /// Whether the start of the current frame was reported.
    pub(super) in_frame: bool,
    /// Whether the controller is in listen-only mode: it sends no frames, acknowledgements or error flags.
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

    /// Resets the state for a disconnected controller.
    pub(super) fn leave(&mut self) {
        self.joining = false;
        self.in_frame = false;
        self.events.clear();
    }
}
