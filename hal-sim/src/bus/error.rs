//! Why a frame was destroyed.

/// Why a frame was destroyed (ISO 11898-1, error types).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// A sender read back another bit than it sent.
    Bit,
    /// A listener could not make sense of the bits: another bit rate, or a sender that fell silent.
    Stuff,
    /// Nobody acknowledged.
    Acknowledgement,
}
