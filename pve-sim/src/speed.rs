//! The speed of virtual time against wall time.

use std::fmt;

/// The speed of virtual time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// A factor of wall time, finite and above 0.
    Factor(f64),
    /// Stepped: only the control interface advances time.
    Step,
}

/// The form of `--speed`.
impl fmt::Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Factor(factor) => write!(f, "{factor}"),
            Self::Step => f.write_str("step"),
        }
    }
}
