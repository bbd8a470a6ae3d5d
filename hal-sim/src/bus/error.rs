//! The errors that destroy a frame.

/// An error that destroys a frame (ISO 11898-1, error types).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// The sender read back a bit other than the bit it sent.
    Bit,
    /// A listener detected a violation of the stuffing rule: another bit rate, or a sender that fell silent.
    Stuff,
    /// No controller acknowledged the frame.
    Acknowledgement,
}
