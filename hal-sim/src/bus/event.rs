//! Bus events in chronological order: frames, error frames, changes of error modes, faults, dropped frames.

use std::sync::Arc;
use std::vec::Drain;

use protocol_core::controller::BusErrorMode;
use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use super::error::BusError;
use super::fault::FaultEffect;

/// An event on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// The time of the event: the end of a frame or error frame, or the time of a change.
    pub at: Instant,
    /// The name of the sender of the frame, or of the device, client or controller that changed its mode or dropped
    /// frames.
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

/// The recorded events that have not been taken yet.
#[derive(Clone, Debug, Default)]
pub(super) struct Journal {
    recording: bool,
    events: Vec<Event>,
}

impl Journal {
    /// Starts or stops recording. Stopping drops the recorded events.
    pub(super) fn record(&mut self, on: bool) {
        self.recording = on;
        if !on {
            self.events = Vec::new();
        }
    }

    /// Records events, if recording is on.
    pub(super) fn extend(&mut self, events: impl IntoIterator<Item = Event>) {
        if self.recording {
            self.events.extend(events);
        }
    }

    /// Inserts events before the event of a frame, or after all events if the frame has no event.
    pub(super) fn extend_before(&mut self, frame: &Frame, at: Instant, events: Vec<Event>) {
        if self.recording {
            let place = self.events.iter().rposition(|event| event.at == at && event.frame() == Some(frame));
            let place = place.unwrap_or(self.events.len());
            self.events.splice(place..place, events);
        }
    }

    /// Records an event, if recording is on.
    pub(super) fn note(&mut self, event: impl FnOnce() -> Option<Event>) {
        if self.recording {
            self.events.extend(event());
        }
    }

    /// Takes the recorded events, oldest first.
    pub(super) fn take(&mut self) -> Drain<'_, Event> {
        self.events.drain(..)
    }
}
