//! How virtual time passes against wall time.

use std::fmt;

/// How virtual time passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// By itself, so many times as fast as wall time: finite and above 0.
    Factor(f64),
    /// When the control interface tells it to.
    Step,
}

/// As it is given to `--speed`.
impl fmt::Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Factor(factor) => write!(f, "{factor}"),
            Self::Step => f.write_str("step"),
        }
    }
}
