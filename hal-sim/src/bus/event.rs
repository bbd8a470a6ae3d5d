//! The events of the bus, for its observers and for external controllers.

use std::sync::Arc;
use std::vec::Drain;

use protocol_core::controller::BusErrorMode;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::fault::FaultEffect;

/// An event on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// The time of the event; for a frame or error frame, its end.
    pub at: Instant,
    /// The name of the frame's sender, or of the device, client or controller that changed its mode or dropped frames.
    pub who: Arc<str>,
    /// The kind of the event and its data.
    pub what: EventKind,
}

/// The kinds of bus events.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EventKind {
    /// An acknowledged frame.
    Frame {
        /// The frame.
        frame: Frame,
        /// The time of the start of frame.
        start: Instant,
    },
    /// An error frame that destroyed an attempt to send `frame`.
    ErrorFrame {
        /// The frame of the failed attempt.
        frame: Frame,
        /// The time of the start of frame.
        start: Instant,
        /// The error that caused the error frame.
        error: BusError,
        /// The controller that sent the first error flag.
        signalled_by: Arc<str>,
    },
    /// A change of a controller's error mode. A change from bus-off to error-active is a recovery.
    ErrorMode {
        /// The previous mode.
        from: BusErrorMode,
        /// The new mode.
        to: BusErrorMode,
    },
    /// A fault that affected a frame sent by [`Event::who`].
    Fault {
        /// The name of the fault.
        fault: Arc<str>,
        /// The original frame.
        frame: Frame,
        /// The effect of the fault.
        effect: FaultEffect,
    },
    /// Frames that a device dropped before transmission.
    FramesDropped {
        /// The number of frames dropped since the device's previous event of this kind.
        count: u32,
    },
}

impl Event {
    /// Returns the acknowledged frame; `None` for all other events.
    #[must_use]
    pub const fn frame(&self) -> Option<&Frame> {
        match &self.what {
            EventKind::Frame { frame, .. } => Some(frame),
            _ => None,
        }
    }

    /// Returns whether this is an error frame.
    #[must_use]
    pub const fn is_error_frame(&self) -> bool {
        matches!(self.what, EventKind::ErrorFrame { .. })
    }
}

/// An error that destroys a frame (ISO 11898-1, error types).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// The sender read back a bit that differs from the sent bit.
    Bit,
    /// A listener detected a violation of the stuffing rule, because the sender was cut off or uses another bit rate.
    Stuff,
    /// No controller acknowledged the frame.
    Acknowledgement,
}

/// A bus event that an external controller detects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireEvent {
    /// Bus integration is complete: the controller has seen 11 recessive bits.
    Joined,
    /// A frame begins.
    Begins {
        /// True if this controller sends the frame, because its offer won the arbitration.
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
        /// True if this controller sent the first error flag.
        first: bool,
    },
    /// The frame or error frame on the wire has ended.
    Ends,
    /// Bus-off recovery is complete: the controller has seen 128 sequences of 11 recessive bits.
    Recovered,
}

/// The recorded events that have not been taken yet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Journal {
    recording: bool,
    events: Vec<Event>,
}

impl Journal {
    /// Starts or stops recording. Stopping drops the recorded events.
    pub(crate) fn record(&mut self, on: bool) {
        self.recording = on;
        if !on {
            self.events = Vec::new();
        }
    }

    /// Inserts events before the event of a frame, or after all events if the frame has no event.
    pub(super) fn note_before(&mut self, frame: &Frame, at: Instant, events: Vec<Event>) {
        if self.recording {
            let place = self.events.iter().rposition(|event| event.at == at && event.frame() == Some(frame));
            let place = place.unwrap_or(self.events.len());
            self.events.splice(place..place, events);
        }
    }

    /// Records the events that `events` returns, if recording is on.
    pub(super) fn note<I: IntoIterator<Item = Event>>(&mut self, events: impl FnOnce() -> I) {
        if self.recording {
            self.events.extend(events());
        }
    }

    /// Takes the recorded events, oldest first.
    pub(crate) fn take(&mut self) -> Drain<'_, Event> {
        self.events.drain(..)
    }
}
