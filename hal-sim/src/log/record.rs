//! What a log has of the bus: frames and error frames, each with its time.

use protocol_core::frame::Frame;

use super::{ErrorClass, Timestamp};

/// An entry of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// The end of the frame.
    pub at: Timestamp,
    /// What was on the bus.
    pub entry: Entry,
}

/// What was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// A frame.
    Frame(Frame),
    /// An error frame.
    Error(ErrorFrame),
}

/// An error frame in the classes of Linux (`linux/can/error.h`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorFrame {
    /// The classes, a bit each: 29 bits. 0 where a format does not tell them.
    pub class: u32,
    /// The details.
    pub data: [u8; 8],
}

impl ErrorFrame {
    /// Of a format that tells no class.
    pub const UNTOLD: Self = Self { class: 0, data: [0; 8] };
}

impl From<ErrorClass> for ErrorFrame {
    fn from(class: ErrorClass) -> Self {
        Self { class: class.code(), data: class.data() }
    }
}
