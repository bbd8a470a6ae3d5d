//! Log records: frames and error frames with their times.

use protocol_core::frame::Frame;

use super::{ErrorClass, Timestamp};

/// A record of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// The time at the end of the frame.
    pub at: Timestamp,
    /// The frame or error frame.
    pub entry: Entry,
}

/// A frame or an error frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry {
    /// A frame.
    Frame(Frame),
    /// An error frame.
    Error(ErrorFrame),
}

/// An error frame with Linux error classes (`linux/can/error.h`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorFrame {
    /// The classes, one bit each in 29 bits; 0 for formats without classes.
    pub class: u32,
    /// The data bytes with the error details.
    pub data: [u8; 8],
}

impl ErrorFrame {
    /// An error frame from a format without classes.
    pub const UNTOLD: Self = Self { class: 0, data: [0; 8] };
}

impl From<ErrorClass> for ErrorFrame {
    fn from(class: ErrorClass) -> Self {
        Self { class: class.code(), data: class.data() }
    }
}
