//! What is seen of the bus.

use std::sync::Arc;

use protocol_core::frame::Frame;
use protocol_core::time::Instant;

use crate::bus::BusError;

/// Something that was on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceEvent {
    /// When it ended.
    pub at: Instant,
    /// The name of the device or client that sent it.
    pub from: Arc<str>,
    /// What it was.
    pub what: OnBus,
}

/// A frame or an error frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnBus {
    /// A frame that somebody received.
    Frame(Frame),
    /// An error frame that destroyed an attempt to send `frame`.
    Error {
        /// The frame that was not sent.
        frame: Frame,
        /// Why.
        error: BusError,
    },
}

impl TraceEvent {
    /// The frame that was sent; `None` for an error frame.
    #[must_use]
    pub const fn frame(&self) -> Option<&Frame> {
        match &self.what {
            OnBus::Frame(frame) => Some(frame),
            OnBus::Error { .. } => None,
        }
    }
}

/// Is shown everything that was on the bus, as it ends.
pub type Observer = Box<dyn FnMut(&TraceEvent) + Send>;
