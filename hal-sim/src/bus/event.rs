//! Bus events in the order of time: frames, error frames, changes of error modes, dropped frames.

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
    /// The instant of the event: the end of a frame or an error frame, or the instant of a change.
    pub at: Instant,
    /// The device, client or controller that sent the frame, changed its mode, or dropped frames.
    pub who: Arc<str>,
    /// The kind of the event, with its data.
    pub what: EventKind,
}

/// The kinds of events.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EventKind {
    /// An acknowledged frame.
    Frame {
        /// The frame.
        frame: Frame,
        /// The beginning of its start-of-frame bit.
        start: Instant,
    },
    /// An error frame that destroyed an attempt to send `frame`.
    ErrorFrame {
        /// The frame that was not sent.
        frame: Frame,
        /// The beginning of its start-of-frame bit.
        start: Instant,
        /// The reason for the error frame.
        error: BusError,
        /// The controller that sent the first error flag.
        signalled_by: Arc<str>,
    },
    /// A change of a controller's error mode; from bus-off to error-active: a recovery.
    ErrorMode {
        /// The mode until now.
        from: BusErrorMode,
        /// The mode from now on.
        to: BusErrorMode,
    },
    /// A fault happened to a frame of `who`.
    Fault {
        /// The name of the fault.
        fault: Arc<str>,
        /// The frame, as its sender meant it.
        frame: Frame,
        /// What was done to it.
        effect: FaultEffect,
    },
    /// Frames that a device dropped unsent.
    FramesDropped {
        /// The number of frames dropped since the last such event.
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

/// The events that have not been taken yet.
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

    /// Notes events, if somebody wants to know.
    pub(super) fn extend(&mut self, events: impl IntoIterator<Item = Event>) {
        if self.recording {
            self.events.extend(events);
        }
    }

    /// Records an event, if recording is on.
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
