//! The virtual time of a run: its pace against the wall clock, and lost time.
//!
//! Virtual time falls behind the wall clock in two cases. In both, the world then continues from the virtual instant
//! that it had reached:
//! - **A stall**, at a speed up to 1: the process was stopped, the machine slept, or the host was overloaded. Virtual
//!   time is held, because a valve would otherwise detect the pause as a failure of its master.
//! - **A speed that is too high** for the machine: the world would fall behind without limit.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use protocol_core::time::{Duration, Instant, after, since};

use crate::control::LAST;

/// The gap between two clock readings above which the process counts as stalled. A master that sends every 200 ms may
/// be 50 ms late before its valve reports a fault.
const STALL: WallDuration = WallDuration::from_millis(50);

/// The maximum sleep at a speed up to 1: a clock reading is needed to detect a stall. The rest of [`STALL`] allows for
/// a late wake-up.
pub(super) const MAX_SLEEP: WallDuration = WallDuration::from_millis(20);

/// The working time after which the speed counts as too high if the world is not catching up.
const BEHIND: WallDuration = WallDuration::from_secs(1);

/// The minimum wall time between two warnings about stalls.
const WARNING_INTERVAL: WallDuration = WallDuration::from_secs(60);

#[derive(Debug)]
pub(super) struct Timekeeper {
    /// The virtual seconds per wall second.
    speed: f64,
    /// A wall instant and the virtual instant at that time, from which all other instants are computed.
    anchor: (WallInstant, Instant),
    /// The time of the last clock reading.
    last_reading: WallInstant,
    /// The progress since the world fell behind; `None` if the world is not behind.
    behind: Option<Behind>,
    /// Whether the user was told that the speed is too high.
    is_too_fast: bool,
    /// Whether the user was told that virtual time is at its limit.
    over: bool,
    stalls: Stalls,
}

/// The progress of a world that is behind the wall clock.
#[derive(Clone, Copy, Debug)]
struct Behind {
    /// The working time since `from`. A stall counts as only [`STALL`], because a stall does not prove that the machine
    /// is slow.
    worked: WallDuration,
    /// The virtual instant at the beginning of the work.
    from: Instant,
}

/// The stalls that have not been reported yet.
#[derive(Debug, Default)]
struct Stalls {
    count: u32,
    time: WallDuration,
    /// The time of the last warning.
    told: Option<WallInstant>,
}

impl Timekeeper {
    /// Starts virtual time now; `speed` must be finite and above 0.
    pub(super) const fn start(speed: f64, now: WallInstant) -> Self {
        let stalls = Stalls { count: 0, time: WallDuration::ZERO, told: None };
        let anchor = (now, Instant::from_ticks(0));
        Self { speed, anchor, last_reading: now, behind: None, is_too_fast: false, over: false, stalls }
    }

    /// Continues from a wall instant and its virtual instant.
    pub(super) const fn restart(&mut self, now: WallInstant, world: Instant) {
        self.anchor = (now, world);
        self.last_reading = now;
    }

    /// Returns the virtual time at a wall instant, at most [`LAST`]; a wall instant before the anchor counts as the
    /// anchor.
    ///
    /// The conversion from floating point saturates. Its rounding error reaches a microsecond only after centuries.
    pub(super) fn at(&self, wall: WallInstant) -> Instant {
        let passed = wall.saturating_duration_since(self.anchor.0).as_secs_f64();
        after(self.anchor.1, Duration::from_ticks((passed * self.speed * 1e6) as u64)).min(LAST)
    }

    /// Returns the wall instant at which a virtual instant is reached; `None` after [`LAST`], or beyond the range of
    /// the wall clock.
    pub(super) fn when(&self, instant: Instant) -> Option<WallInstant> {
        if instant > LAST {
            return None;
        }
        let passed = since(instant, self.anchor.1).as_micros() as f64 / 1e6 / self.speed;
        let passed = WallDuration::try_from_secs_f64(passed).ok()?;
        // Rounded up, so that the virtual instant is reached at the result.
        self.anchor.0.checked_add(passed)?.checked_add(WallDuration::from_nanos(1))
    }

    pub(super) const fn last_reading(&self) -> WallInstant {
        self.last_reading
    }

    /// Returns whether virtual time stops during stalls, which applies to speeds up to 1.
    pub(super) const fn holds_in_stalls(&self) -> bool {
        self.speed <= 1.0
    }

    /// Records a clock reading at `now`, while the world is at virtual instant `world`. After a stall, virtual time
    /// continues from `world`. Returns a warning about stalls, at most once per [`WARNING_INTERVAL`].
    pub(super) fn read(&mut self, now: WallInstant, world: Instant) -> Option<String> {
        let passed = now.saturating_duration_since(std::mem::replace(&mut self.last_reading, now));
        if let Some(behind) = &mut self.behind {
            behind.worked += passed.min(STALL);
        }
        if passed <= STALL || !self.holds_in_stalls() {
            return None;
        }
        self.anchor = (now, world);
        self.stalls.count += 1;
        self.stalls.time += passed;
        if self.stalls.told.is_some_and(|told| now.saturating_duration_since(told) < WARNING_INTERVAL) {
            return None;
        }
        let Stalls { count, time, .. } =
            std::mem::replace(&mut self.stalls, Stalls { told: Some(now), ..Stalls::default() });
        let seconds = time.as_secs_f64();
        let stalls =
            if count == 1 { format!("for {seconds:.3} s") } else { format!("{count} times, {seconds:.3} s in total") };
        Some(format!("the host stalled {stalls}; virtual time stood still meanwhile"))
    }

    /// Records that the world has worked up to `world` and is still behind. If the speed is too high for the machine,
    /// virtual time continues from `world`. Returns a warning the first time.
    pub(super) fn fell_behind(&mut self, world: Instant) -> Option<String> {
        let begun = Behind { worked: WallDuration::ZERO, from: world };
        let speed = self.speed;
        if !self.is_too_fast {
            let behind = self.behind.get_or_insert(begun);
            if behind.worked < BEHIND {
                return None;
            }
            if since(world, behind.from).as_micros() as f64 > behind.worked.as_micros() as f64 * speed {
                // The world is catching up.
                self.behind = Some(begun);
                return None;
            }
        }
        self.anchor = (self.last_reading, world);
        let told = std::mem::replace(&mut self.is_too_fast, true);
        (!told).then(|| format!("--speed {speed} is too fast for this machine: virtual time runs as fast as possible"))
    }

    /// Records that the world has caught up at `world`. Returns a warning the first time that virtual time reaches
    /// [`LAST`].
    pub(super) fn caught_up(&mut self, world: Instant) -> Option<String> {
        self.behind = None;
        let over = world >= LAST && !std::mem::replace(&mut self.over, true);
        over.then(|| "virtual time reached its limit of 584 years: the bus has stopped".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use protocol_core::time::NEVER;

    use super::*;

    #[test]
    fn virtual_time_is_wall_time_times_the_factor() {
        let start = WallInstant::now();
        let at = |speed, passed| Timekeeper::start(speed, start).at(start + passed);
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
                let (instant, time) = (Instant::from_micros(micros), Timekeeper::start(speed, start));
                assert!(time.at(time.when(instant).unwrap()) >= instant, "{micros} µs at {speed}");
            }
        }
        let time = Timekeeper::start(1.0, start);
        assert_eq!(time.when(NEVER), None);
        assert!(time.when(Instant::from_micros(0)).unwrap() <= start + WallDuration::from_micros(1));
    }

    #[test]
    fn time_goes_on_from_the_anchor() {
        let start = WallInstant::now();
        let mut time = Timekeeper::start(2.0, start);
        let (wall, instant) = (start + WallDuration::from_secs(10), Instant::from_secs(3));
        time.anchor = (wall, instant);
        assert_eq!(time.at(start), instant, "nothing runs back");
        assert_eq!(time.at(wall + WallDuration::from_millis(1)), Instant::from_micros(3_002_000));
        let due = time.when(Instant::from_micros(3_002_000)).unwrap();
        assert!(due >= wall + WallDuration::from_millis(1) && due < wall + WallDuration::from_micros(1001));
    }
}
