//! The time of a frame in traces and for clients.

use std::fmt;
use std::str::FromStr;

use protocol_core::time::Instant;

use super::Reason;

/// Microseconds since 1970, printed as seconds with six digits after the point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(u64);

impl Timestamp {
    /// Creates a time from microseconds since 1970.
    #[must_use]
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros)
    }

    /// Returns the microseconds since 1970.
    #[must_use]
    pub const fn as_micros(self) -> u64 {
        self.0
    }

    /// Converts virtual time to a timestamp, for a world that started at `self`.
    #[must_use]
    pub const fn at(self, instant: Instant) -> Self {
        Self(self.0.saturating_add(instant.as_micros()))
    }
}

impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:06}", self.0 / 1_000_000, self.0 % 1_000_000)
    }
}

/// Parses the output of [`Display`](fmt::Display). Digits beyond microseconds are ignored. Refuses any other text, and a
/// time above 584,000 years.
impl FromStr for Timestamp {
    type Err = Reason;

    fn from_str(text: &str) -> Result<Self, Reason> {
        const INVALID: Reason = "invalid timestamp";
        let is_number = |digits: &str| !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
        let (seconds, fraction) = text.split_once('.').unwrap_or((text, "0"));
        if !is_number(seconds) || !is_number(fraction) {
            return Err(INVALID);
        }
        let digits = fraction.bytes().chain(std::iter::repeat(b'0')).take(6);
        let micros = digits.fold(0, |micros, digit| micros * 10 + u64::from(digit - b'0'));
        let seconds: u64 = seconds.parse().map_err(|_| INVALID)?;
        seconds.checked_mul(1_000_000).and_then(|all| all.checked_add(micros)).map(Self).ok_or(INVALID)
    }
}
