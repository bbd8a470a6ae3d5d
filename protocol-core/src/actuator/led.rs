//! What the LED shows (SPEC 2).

/// A colour of the LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Color {
    /// Healthy.
    Green,
    /// Disabled.
    Yellow,
    /// Faulty.
    Red,
}

/// What the LED shows. Flashing is 1.5 Hz: 333 ms on, 333 ms off, in the platform's hands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Led {
    /// The colour.
    pub color: Color,
    /// Whether it flashes.
    pub flashing: bool,
}
