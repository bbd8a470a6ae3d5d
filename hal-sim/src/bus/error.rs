//! The reasons for a destroyed frame.

/// The reason for a destroyed frame (ISO 11898-1, error types).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// The sender read back a different bit than it sent.
    Bit,
    /// A listener read bits that break the stuffing rule: another bit rate, or a sender that fell silent.
    Stuff,
    /// No controller acknowledged the frame.
    Acknowledgement,
}
