//! Selects the bus events to report as errors: the first error frame of each destroyed frame, changes of an error mode,
//! effects of communication faults, and dropped frames. Repeated error frames are not reported, because a controller
//! retransmits thousands of times per second.

use std::collections::HashMap;
use std::sync::Arc;

use protocol_core::controller::BusErrorMode;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, since};

use crate::bus::BusError;
use crate::explain::{explain_error, explain_fault};
use crate::log::ErrorClass;
use crate::world::{Event, EventKind};

/// The pause after which an error frame is reported again.
const OVER: Duration = Duration::from_secs(1);

/// A filter that selects the bus errors to report.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    /// The number of error frames in the current disturbance. A disturbance has ended if all controllers are
    /// error-active and the next error frame follows after more than [`OVER`].
    count: u64,
    /// The time of the last error frame.
    last: Option<Instant>,
    /// The frame that each sender fails to send, with the time of the last error frame.
    failing: HashMap<Arc<str>, (Frame, Instant)>,
    /// The controllers that are not error-active, with their modes and the times of the mode changes.
    troubled: HashMap<Arc<str>, (BusErrorMode, Instant)>,
}

impl Errors {
    /// Records an event. Returns the error class and the message for an event to report. A communication fault has no
    /// class.
    pub fn note(&mut self, event: &Event) -> Option<(Option<ErrorClass>, String)> {
        match &event.what {
            EventKind::Frame { .. } => {
                if !self.failing.is_empty() {
                    self.failing.remove(&event.who);
                }
                None
            }
            EventKind::ErrorFrame { frame, error, .. } => self.error_frame(event, frame, *error),
            EventKind::ErrorMode { to, .. } => Some(self.change(event, *to)),
            EventKind::Fault { fault, frame, effect } => Some((None, explain_fault(fault, frame, effect, &event.who))),
            EventKind::FramesDropped { count } => {
                let frames = if *count == 1 { "frame" } else { "frames" };
                let text = format!("{}: dropped {count} pending {frames}", event.who);
                Some((Some(ErrorClass::TransmitOverflow), text))
            }
        }
    }

    fn error_frame(&mut self, event: &Event, frame: &Frame, error: BusError) -> Option<(Option<ErrorClass>, String)> {
        if self.troubled.is_empty() && self.last.is_none_or(|last| since(event.at, last) > OVER) {
            self.count = 0;
        }
        self.count += 1;
        self.last = Some(event.at);
        let before = self.failing.insert(Arc::clone(&event.who), (*frame, event.at));
        let told = before.is_some_and(|(failed, when)| failed == *frame && since(event.at, when) <= OVER);
        (!told).then(|| (Some(class(error)), explain_error(error, frame, &event.who)))
    }

    /// Describes a mode change. The text includes the duration of the previous mode, because the times of two traces
    /// may have different origins.
    fn change(&mut self, event: &Event, to: BusErrorMode) -> (Option<ErrorClass>, String) {
        let before = match to {
            BusErrorMode::ErrorActive => self.troubled.remove(&event.who),
            _ => self.troubled.insert(Arc::clone(&event.who), (to, event.at)),
        };
        let class = match (before, to) {
            (_, BusErrorMode::ErrorPassive) => ErrorClass::ErrorPassive,
            (_, BusErrorMode::BusOff) => ErrorClass::BusOff,
            (Some((BusErrorMode::BusOff, _)), BusErrorMode::ErrorActive) => ErrorClass::Restarted,
            (_, BusErrorMode::ErrorActive) => ErrorClass::ErrorActive,
        };
        let before = before.map_or_else(String::new, |(mode, begin)| {
            let micros = since(event.at, begin).as_micros();
            format!(", was {} for {}.{:03} ms", mode.name(), micros / 1000, micros % 1000)
        });
        let frames = if self.count == 1 { "frame" } else { "frames" };
        (Some(class), format!("{}: {}{before} ({} error {frames} so far)", event.who, to.name(), self.count))
    }
}

/// Returns the class of an error frame for logs and clients.
const fn class(error: BusError) -> ErrorClass {
    match error {
        BusError::Acknowledgement => ErrorClass::NoAcknowledge,
        BusError::Bit | BusError::Stuff => ErrorClass::BusError,
    }
}

#[cfg(test)]
#[path = "errors_tests.rs"]
mod tests;
