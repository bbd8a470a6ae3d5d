//! The errors that destroy a frame.

/// An error that destroys a frame (ISO 11898-1, error types).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// The sender read back a bit that differs from the sent bit.
    Bit,
    /// A listener detected a violation of the stuffing rule, because the sender was cut off or uses another bit rate.
    Stuff,
    /// No controller acknowledged the frame.
    Acknowledgement,
}
