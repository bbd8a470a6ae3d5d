//! Time in the core: always a parameter, never read from a clock.
//!
//! [`Instant`] and [`Duration`] are embassy-time's, at a tick of 1 MHz, used as types only. Their operators panic on
//! overflow; the helpers here do not, so no time makes a device panic. Clocks stay below 2^63 ticks (292,000 years).
//! Later times, up to [`NEVER`], occur only as timer deadlines.

pub use embassy_time::{Duration, Instant};

/// A time that is never reached: the deadline of a stopped timer.
pub const NEVER: Instant = Instant::MAX;

/// Adds a duration; saturates at [`NEVER`].
#[inline]
#[must_use]
pub const fn after(instant: Instant, duration: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().saturating_add(duration.as_ticks()))
}

/// Adds a protocol or product delay of at most a few minutes.
///
/// The sum wraps instead of saturating: the tick counter lasts half a million years, and a check would double the code
/// size. For user-chosen durations, see [`after`].
#[inline]
#[must_use]
pub(crate) const fn delayed(instant: Instant, delay: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().wrapping_add(delay.as_ticks()))
}

/// Returns `now`, or `last` if `now` is earlier, so that the device time never runs backwards. Also returns `last` for
/// a `now` of 2^63 ticks or more, which no clock reaches: [`NEVER`] must not make stopped timers due, and adding a
/// [delay](delayed) must not wrap.
#[inline]
#[must_use]
pub(crate) const fn latest(last: Instant, now: Instant) -> Instant {
    // As signed numbers, times of 2^63 ticks or more are negative, so one comparison suffices.
    if now.as_ticks().cast_signed() < last.as_ticks().cast_signed() { last } else { now }
}

/// Returns the time elapsed from `earlier` to `later`; zero if `later` is before `earlier`.
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
