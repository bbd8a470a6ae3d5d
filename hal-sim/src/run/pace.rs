//! Wall time and virtual time.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use protocol_core::time::{Instant, NEVER};

/// Virtual time that runs a factor as fast as wall time, from instant 0 at its start.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    start: WallInstant,
    speed: f64,
}

impl Pace {
    /// Starts now; `speed` is finite and above 0.
    #[must_use]
    pub fn start(speed: f64) -> Self {
        Self { start: WallInstant::now(), speed }
    }

    /// The virtual time now.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.at(self.start.elapsed())
    }

    /// How long it takes in wall time until a virtual instant; `None`: it never comes.
    #[must_use]
    pub fn until(&self, instant: Instant) -> Option<WallDuration> {
        if instant == NEVER {
            return None;
        }
        Some(self.wall(instant)?.saturating_sub(self.start.elapsed()))
    }

    /// The virtual time so long after the start. A conversion from floating point saturates, and a factor loses a
    /// microsecond only after centuries.
    fn at(&self, passed: WallDuration) -> Instant {
        Instant::from_micros((passed.as_secs_f64() * self.speed * 1e6) as u64)
    }

    /// How long after the start a virtual instant comes, rounded up so that it has come by then.
    fn wall(&self, instant: Instant) -> Option<WallDuration> {
        let wall = WallDuration::try_from_secs_f64(instant.as_micros() as f64 / 1e6 / self.speed).ok()?;
        wall.checked_add(WallDuration::from_nanos(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pace(speed: f64) -> Pace {
        Pace { start: WallInstant::now(), speed }
    }

    #[test]
    fn virtual_time_is_wall_time_times_the_factor() {
        assert_eq!(pace(1.0).at(WallDuration::from_micros(1500)), Instant::from_micros(1500));
        assert_eq!(pace(100.0).at(WallDuration::from_micros(1500)), Instant::from_micros(150_000));
        assert_eq!(pace(0.5).at(WallDuration::from_secs(3)), Instant::from_micros(1_500_000));
        assert_eq!(pace(1e300).at(WallDuration::from_secs(1)), Instant::MAX);
    }

    #[test]
    fn an_instant_has_come_when_its_wall_time_has() {
        for speed in [1.0, 0.3, 7.0, 1000.0] {
            for micros in [1, 999, 12_345_678, 86_400_000_000] {
                let instant = Instant::from_micros(micros);
                let pace = pace(speed);
                assert!(pace.at(pace.wall(instant).unwrap()) >= instant, "{micros} µs at {speed}");
            }
        }
        assert_eq!(pace(1.0).until(NEVER), None);
        assert_eq!(pace(1.0).until(Instant::from_micros(0)), Some(WallDuration::ZERO));
    }
}
