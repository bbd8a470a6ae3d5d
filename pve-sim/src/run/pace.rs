//! Wall time and virtual time.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use protocol_core::time::{Duration, Instant, after, since};

/// The last instant of a run: 584 years, the range of the bus time in 64-bit nanoseconds, less one day in which pending
/// frames can end.
pub(super) const LAST: Instant = Instant::from_ticks(u64::MAX / 1000 - 86_400_000_000);

/// The conversion between wall time and virtual time: an anchor in both times, and the virtual seconds per wall second.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    speed: f64,
    wall: WallInstant,
    instant: Instant,
}

impl Pace {
    /// Starts at virtual instant 0; `speed` must be finite and above 0.
    #[must_use]
    pub(super) const fn start(speed: f64, wall: WallInstant) -> Self {
        Self { speed, wall, instant: Instant::from_ticks(0) }
    }

    /// Returns the virtual seconds per wall second.
    #[must_use]
    pub(super) const fn speed(&self) -> f64 {
        self.speed
    }

    /// Sets a new anchor, from which time continues.
    pub(super) const fn anchor(&mut self, wall: WallInstant, instant: Instant) {
        self.wall = wall;
        self.instant = instant;
    }

    /// Returns the virtual time at a wall instant, at most [`LAST`]; a wall instant before the anchor counts as the
    /// anchor.
    ///
    /// The conversion from floating point saturates. Its rounding error reaches a microsecond only after centuries.
    #[must_use]
    pub(super) fn at(&self, wall: WallInstant) -> Instant {
        let passed = wall.saturating_duration_since(self.wall).as_secs_f64();
        after(self.instant, Duration::from_ticks((passed * self.speed * 1e6) as u64)).min(LAST)
    }

    /// Returns the wall instant at which a virtual instant is reached; `None` after [`LAST`], or beyond the range of
    /// the wall clock.
    #[must_use]
    pub(super) fn when(&self, instant: Instant) -> Option<WallInstant> {
        if instant > LAST {
            return None;
        }
        let passed = since(instant, self.instant).as_micros() as f64 / 1e6 / self.speed;
        let passed = WallDuration::try_from_secs_f64(passed).ok()?;
        // Rounded up, so that the virtual instant is reached at the result.
        self.wall.checked_add(passed)?.checked_add(WallDuration::from_nanos(1))
    }
}

#[cfg(test)]
mod tests {
    use protocol_core::time::NEVER;

    use super::*;

    #[test]
    fn virtual_time_is_wall_time_times_the_factor() {
        let start = WallInstant::now();
        let at = |speed, passed| Pace::start(speed, start).at(start + passed);
        assert_eq!(at(1.0, WallDuration::from_micros(1500)), Instant::from_micros(1500));
        assert_eq!(at(100.0, WallDuration::from_micros(1500)), Instant::from_micros(150_000));
        assert_eq!(at(0.5, WallDuration::from_secs(3)), Instant::from_micros(1_500_000));
        assert_eq!(at(1e300, WallDuration::from_secs(1)), LAST);
    }

    #[test]
    fn an_instant_has_come_when_its_wall_time_has() {
        let start = WallInstant::now();
        for speed in [1.0, 0.3, 7.0, 1000.0] {
            for micros in [1, 999, 12_345_678, 86_400_000_000] {
                let (instant, pace) = (Instant::from_micros(micros), Pace::start(speed, start));
                assert!(pace.at(pace.when(instant).unwrap()) >= instant, "{micros} µs at {speed}");
            }
        }
        let pace = Pace::start(1.0, start);
        assert_eq!(pace.when(NEVER), None);
        assert!(pace.when(Instant::from_micros(0)).unwrap() <= start + WallDuration::from_micros(1));
    }

    #[test]
    fn time_goes_on_from_the_anchor() {
        let start = WallInstant::now();
        let mut pace = Pace::start(2.0, start);
        let (wall, instant) = (start + WallDuration::from_secs(10), Instant::from_secs(3));
        pace.anchor(wall, instant);
        assert_eq!(pace.at(start), instant, "nothing runs back");
        assert_eq!(pace.at(wall + WallDuration::from_millis(1)), Instant::from_micros(3_002_000));
        let due = pace.when(Instant::from_micros(3_002_000)).unwrap();
        assert!(due >= wall + WallDuration::from_millis(1) && due < wall + WallDuration::from_micros(1001));
    }
}
