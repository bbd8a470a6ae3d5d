//! What happened on the bus, in the order of time: frames, error frames, changes of error modes, dropped frames.

use std::sync::Arc;
use std::vec::Drain;

use protocol_core::controller::BusErrorMode;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::error::BusError;

/// Something that happened on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// When: the end of a frame or an error frame, the instant of a change.
    pub at: Instant,
    /// The device, client or controller that sent the frame, changed its mode, or dropped frames.
    pub who: Arc<str>,
    /// What it was.
    pub what: EventKind,
}

/// The kinds of events.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A frame that was acknowledged.
    Frame {
        /// The frame.
        frame: Frame,
        /// The begin of its start-of-frame bit.
        start: Instant,
    },
    /// An error frame that destroyed an attempt to send `frame`.
    ErrorFrame {
        /// The frame that was not sent.
        frame: Frame,
        /// The begin of its start-of-frame bit.
        start: Instant,
        /// Why it was destroyed.
        error: BusError,
        /// The controller that sent the first error flag.
        signalled_by: Arc<str>,
    },
    /// The error counters of a controller changed its mode; from bus-off to error-active it has recovered.
    ErrorMode {
        /// The mode until now.
        from: BusErrorMode,
        /// The mode from now on.
        to: BusErrorMode,
    },
    /// A device dropped frames that it had to send: nobody will ever see them.
    FramesDropped {
        /// How many since the last such event.
        count: u32,
    },
}

impl Event {
    /// Returns the frame that was sent; `None` for everything else.
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

/// The events that nobody has taken yet.
#[derive(Clone, Debug, Default)]
pub(super) struct Journal {
    recording: bool,
    events: Vec<Event>,
}

impl Journal {
    /// Records from now on, or no longer; what was recorded is dropped with the end of recording.
    pub(super) fn record(&mut self, on: bool) {
        self.recording = on;
        if !on {
            self.events = Vec::new();
        }
    }

    /// Notes an event, if somebody wants to know.
    #[inline]
    pub(super) fn note(&mut self, event: impl FnOnce() -> Option<Event>) {
        if self.recording {
            self.events.extend(event());
        }
    }

    /// Takes the events, oldest first.
    pub(super) fn take(&mut self) -> Drain<'_, Event> {
        self.events.drain(..)
    }
}
