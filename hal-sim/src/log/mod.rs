//! Records of a log: frames and error frames with their times. [`candump`] writes and reads records as lines.

pub mod candump;
mod timestamp;

use protocol_core::frame::{ExtendedId, Frame, identifier};

pub use candump::write_frame;
pub use timestamp::Timestamp;

/// The reason why an entry cannot be read.
pub type Reason = &'static str;

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
        // The class, and the controller state.
        let (class, state) = match class {
            // One bit each for the receive and the transmit error counter.
            ErrorClass::ErrorPassive => (0x004, 0x30),
            ErrorClass::ErrorActive => (0x004, 0x40),
            ErrorClass::TransmitOverflow => (0x004, 0x02),
            ErrorClass::NoAcknowledge => (0x020, 0),
            ErrorClass::BusOff => (0x040, 0),
            ErrorClass::BusError => (0x080, 0),
            ErrorClass::Restarted => (0x100, 0),
        };
        Self { class, data: [0, state, 0, 0, 0, 0, 0, 0] }
    }
}

/// The flags of an identifier in Linux's `struct can_frame` (`linux/can.h`).
pub(crate) const EXTENDED_FLAG: u32 = 0x8000_0000;
pub(crate) const REMOTE_FLAG: u32 = 0x4000_0000;
pub(crate) const ERROR_FLAG: u32 = 0x2000_0000;

impl Entry {
    /// Creates an entry from the identifier with flags, the length and the data of a `struct can_frame`.
    ///
    /// # Errors
    /// The reason, if the identifier is out of range.
    pub(crate) fn of_can_frame(id: u32, length: u8, data: [u8; 8]) -> Result<Self, Reason> {
        let number = id & ExtendedId::MAX.as_raw();
        if id & ERROR_FLAG != 0 {
            return Ok(Self::Error(ErrorFrame { class: number, data }));
        }
        let is_remote = id & REMOTE_FLAG != 0;
        let id = identifier(number, id & EXTENDED_FLAG != 0).ok_or("identifier out of range")?;
        Ok(Self::Frame(if is_remote { Frame::remote(id, length) } else { Frame::with_len(id, data, length) }))
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
