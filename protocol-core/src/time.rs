//! Time as the core sees it: a parameter, never a clock.
//!
//! [`Instant`] and [`Duration`] are embassy-time's, at its 1 MHz tick, used as types only. Their operators panic on
//! overflow; the helpers here do not, so that no instant makes the device panic. Clocks stay below 2^63 ticks (292,000
//! years). Later instants, up to [`NEVER`], occur only as timer deadlines.

pub use embassy_time::{Duration, Instant};

/// The instant that never comes: the deadline of a timer that is off.
pub const NEVER: Instant = Instant::MAX;

/// Returns `duration` after `instant`; [`NEVER`] when that lies beyond the end of time.
#[inline]
#[must_use]
pub const fn after(instant: Instant, duration: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().saturating_add(duration.as_ticks()))
}

/// Returns `delay` after `instant`, for the delays of protocols and products, which are minutes at the most.
///
/// The sum does not saturate: the end of time is half a million years away, and the check is twice the code of the sum.
/// [`after`] is for durations that a user chooses.
#[inline]
#[must_use]
pub(crate) const fn delayed(instant: Instant, delay: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().wrapping_add(delay.as_ticks()))
}

/// Returns the instant of a device at a call with `now`: not before `last`. An instant from 2^63 ticks on, to
/// which no clock comes, counts as before it: timers that are off are due at [`NEVER`], and the sum of a
/// [delay](delayed) must not wrap.
#[inline]
#[must_use]
pub(crate) const fn latest(last: Instant, now: Instant) -> Instant {
    // As signed numbers those instants are negative; to compare these costs no more.
    if now.as_ticks().cast_signed() < last.as_ticks().cast_signed() { last } else { now }
}

/// Returns the time that has passed from `earlier` to `later`; zero when `later` is not later.
#[inline]
#[must_use]
pub const fn since(later: Instant, earlier: Instant) -> Duration {
    Duration::from_ticks(later.as_ticks().saturating_sub(earlier.as_ticks()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_time_is_never_passed() {
        assert_eq!(after(Instant::MAX, Duration::from_millis(1)), NEVER);
        assert_eq!(after(Instant::from_millis(1), Duration::MAX), NEVER);
        assert_eq!(after(Instant::from_millis(1), Duration::from_millis(2)), Instant::from_micros(3000));
    }

    #[test]
    fn no_clock_comes_to_the_second_half_of_time() {
        let at = Instant::from_ticks;
        assert_eq!(latest(at(2), at(3)), at(3));
        assert_eq!(latest(at(3), at(2)), at(3));
        assert_eq!(latest(at(3), at((1 << 63) - 1)), at((1 << 63) - 1));
        assert_eq!(latest(at(3), at(1 << 63)), at(3));
        assert_eq!(latest(at(3), NEVER), at(3));
    }

    #[test]
    fn time_that_runs_backwards_counts_as_none() {
        assert_eq!(since(Instant::from_millis(1), Instant::from_millis(5)), Duration::from_ticks(0));
        assert_eq!(since(Instant::from_millis(5), Instant::from_millis(1)), Duration::from_millis(4));
    }
}
