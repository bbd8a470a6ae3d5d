//! Traces: what happened on the bus, as other tools read it.

mod candump;
mod timestamp;

pub use candump::{write_error, write_frame};
pub use timestamp::Timestamp;

/// What an error frame tells, in the classes of Linux (`linux/can/error.h`), which traces and gateways share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorClass {
    /// Nobody acknowledged a frame.
    NoAcknowledge,
    /// A node has left the bus.
    BusOff,
    /// A frame was destroyed.
    BusError,
}

impl ErrorClass {
    /// The class as Linux numbers it.
    #[must_use]
    pub const fn code(self) -> u32 {
        match self {
            Self::NoAcknowledge => 0x020,
            Self::BusOff => 0x040,
            Self::BusError => 0x080,
        }
    }
}
