//! What the bus tells a controller that lives elsewhere.

use std::collections::VecDeque;
use std::collections::vec_deque::Drain;

use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::error::BusError;

/// What a controller notices of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireEvent {
    /// It has seen 11 recessive bits and takes part.
    Joined,
    /// A frame begins; `own` when the one that it offered is among the contenders and has won.
    Begins {
        /// Whether this controller sends it.
        own: bool,
    },
    /// A more urgent frame of somebody else has won against the one that it offered.
    LostArbitration,
    /// Its frame was sent and acknowledged.
    Sent,
    /// Its frame was destroyed, or not acknowledged, or lost a bit to the same identifier with other data.
    NotSent(BusError),
    /// It received a frame.
    Received(Frame),
    /// A frame of somebody else was destroyed; `first` when this controller's error flag was the first.
    NotReceived {
        /// Whether it was the first to see the error.
        first: bool,
    },
    /// What was on the wire has ended.
    Ends,
    /// It was bus-off, and has seen 128 sequences of 11 recessive bits.
    Recovered,
}

/// What a port with a controller elsewhere has beyond the others.
#[derive(Clone, Debug, Default)]
pub(super) struct External {
    events: VecDeque<(Instant, WireEvent)>,
    /// Whether it has to be told that it has joined.
    pub(super) joining: bool,
    /// Whether it was told of the begin of what is on the wire.
    pub(super) in_frame: bool,
    /// It sends no dominant bit: neither frames nor acknowledgements nor error flags.
    pub(super) silent: bool,
}

impl External {
    pub(super) fn tell(&mut self, at: Instant, event: WireEvent) {
        self.events.push_back((at, event));
    }

    /// Takes what it was told, oldest first.
    pub(super) fn take(&mut self) -> Drain<'_, (Instant, WireEvent)> {
        self.events.drain(..)
    }

    /// Lets the controller leave the bus.
    pub(super) fn leave(&mut self) {
        self.joining = false;
        self.in_frame = false;
        self.events.clear();
    }
}
