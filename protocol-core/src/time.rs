//! Instants and durations. The present time is always a parameter of the core.
//!
//! [`Instant`] and [`Duration`] come from embassy-time, in ticks of 1 µs, without its clock. Their operators panic on
//! overflow; the functions here do not. Clocks stay below 2^63 ticks (292,000 years). Later times, up to [`NEVER`],
//! serve only as deadlines.

pub use embassy_time::{Duration, Instant};

/// The latest time, which no clock reaches. It is the deadline of a stopped timer.
pub const NEVER: Instant = Instant::MAX;

/// Returns `instant` plus `duration`, at most [`NEVER`].
#[inline]
#[must_use]
pub const fn after(instant: Instant, duration: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().saturating_add(duration.as_ticks()))
}

/// Returns `instant` plus a protocol or product delay of at most a few minutes.
///
/// The addition is unchecked, because no clock comes near an overflow and a check would double the code. For durations
/// that a user chooses, see [`after`].
#[inline]
#[must_use]
pub(crate) const fn delayed(instant: Instant, delay: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().wrapping_add(delay.as_ticks()))
}

/// Returns `now`, or `last` if `now` is earlier, so that the time of a device never runs backwards. A `now` of 2^63
/// ticks or more also yields `last`. Otherwise [`NEVER`] would make stopped timers due, and the addition of a
/// [delay](delayed) could wrap.
#[inline]
#[must_use]
pub(crate) const fn latest(last: Instant, now: Instant) -> Instant {
    // As signed numbers, times of 2^63 ticks or more are negative.
    if now.as_ticks().cast_signed() < last.as_ticks().cast_signed() { last } else { now }
}

/// Returns the time from `earlier` to `later`, or zero if `later` is before `earlier`.
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
