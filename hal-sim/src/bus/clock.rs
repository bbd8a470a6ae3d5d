//! Bus time in nanoseconds. The world's microseconds are too coarse: a bit takes 1.25 µs at 800 kbit/s, and
//! back-to-back frames must follow each other exactly.

use protocol_core::controller::BitRate;
use protocol_core::time::{Instant, NEVER};

/// Nanoseconds since the start of the world.
pub(super) type Nanos = u64;

pub(super) const fn nanos(instant: Instant) -> Nanos {
    instant.as_ticks().saturating_mul(1000)
}

/// Converts bus time to an instant, rounded up.
pub(super) const fn instant(nanos: Nanos) -> Instant {
    if nanos == Nanos::MAX { NEVER } else { Instant::from_ticks(nanos.div_ceil(1000)) }
}

pub(super) const fn bit_times(bits: u32, rate: BitRate) -> Nanos {
    bits as Nanos * (1_000_000_000 / rate.bits_per_second() as Nanos)
}
