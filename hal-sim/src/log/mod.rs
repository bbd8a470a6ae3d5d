//! Records of a log: frames and error frames with their times. [`candump`] writes and reads records as lines.

pub mod candump;
mod timestamp;

use protocol_core::frame::Frame;

pub use candump::write_frame;
pub use timestamp::{ParseTimestampError, Timestamp};

/// The classes of Linux error frames (`linux/can/error.h`), used by logs and gateways.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorClass {
    /// No controller acknowledged a frame.
    NoAcknowledge,
    /// A frame was destroyed.
    BusError,
    /// A controller has become error-passive.
    ErrorPassive,
    /// A controller is error-active again.
    ErrorActive,
    /// A controller went bus-off.
    BusOff,
    /// A controller recovered from bus-off.
    Restarted,
    /// A device dropped frames before transmission.
    TransmitOverflow,
}

impl ErrorClass {
    /// Returns the Linux code of the class.
    #[must_use]
    pub const fn code(self) -> u32 {
        match self {
            Self::ErrorPassive | Self::ErrorActive | Self::TransmitOverflow => 0x004,
            Self::NoAcknowledge => 0x020,
            Self::BusOff => 0x040,
            Self::BusError => 0x080,
            Self::Restarted => 0x100,
        }
    }

    /// Returns the data bytes of the error frame. Byte 1 contains the controller state.
    #[must_use]
    pub const fn data(self) -> [u8; 8] {
        let controller = match self {
            // One bit each for the receive and the transmit error counter.
            Self::ErrorPassive => 0x30,
            Self::ErrorActive => 0x40,
            Self::TransmitOverflow => 0x02,
            Self::NoAcknowledge | Self::BusError | Self::BusOff | Self::Restarted => 0,
        };
        [0, controller, 0, 0, 0, 0, 0, 0]
    }
}

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
    /// The classes, one bit per class in 29 bits; 0 for formats without classes.
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

/// Writes bytes as two hex digits each, without blanks.
pub fn write_hex(out: &mut String, bytes: &[u8]) {
    const DIGITS: [char; 16] = ['0', '1', '2', '3', '4', '5', '6', '7', '8', '9', 'A', 'B', 'C', 'D', 'E', 'F'];
    for byte in bytes {
        out.push(DIGITS[usize::from(byte >> 4)]);
        out.push(DIGITS[usize::from(byte & 0xF)]);
    }
}
