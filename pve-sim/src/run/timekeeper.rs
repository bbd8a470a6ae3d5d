//! The virtual time of a run: the pace of the wall clock, and lost time.
//!
//! Two conditions make virtual time lose against the wall clock; after each, the world continues from its own instant:
//! - **A stall**, at a speed up to 1: the process was stopped, the machine slept, or the host was overloaded. Masters
//!   live on the wall clock, and a valve must not take the pause for a master that has failed.
//! - **A speed that is too high** for the machine: the world would fall behind without limit.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use protocol_core::time::{Instant, since};

use super::pace::{LAST, Pace};

/// The gap between two clock readings above which the process counts as stalled. A master that sends every 200 ms may
/// be 50 ms late before its valve reports a fault.
const STALL: WallDuration = WallDuration::from_millis(50);

/// The maximum sleep at a speed up to 1: a clock reading is needed to detect a stall. The rest of [`STALL`] allows for
/// a late wake-up.
pub(super) const MAX_SLEEP: WallDuration = WallDuration::from_millis(20);

/// The working time without progress after which the speed counts as too high.
const BEHIND: WallDuration = WallDuration::from_secs(1);

/// The minimum wall time between two warnings about stalls.
const REMINDER: WallDuration = WallDuration::from_secs(60);

/// The virtual time of a run.
#[derive(Debug)]
pub(super) struct Timekeeper {
    pace: Pace,
    /// The time of the last clock reading.
    looked: WallInstant,
    /// The progress since the world fell behind; `None` if the world is not behind.
    behind: Option<Behind>,
    /// Whether the user was told that the speed is too high.
    out_of_reach: bool,
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
        Self { pace: Pace::start(speed, now), looked: now, behind: None, out_of_reach: false, over: false, stalls }
    }

    /// Returns the pace of virtual time.
    pub(super) const fn pace(&self) -> &Pace {
        &self.pace
    }

    /// Returns the time of the last clock reading.
    pub(super) const fn looked(&self) -> WallInstant {
        self.looked
    }

    /// Returns whether virtual time stops during stalls, which applies to speeds up to 1.
    pub(super) const fn minds_stalls(&self) -> bool {
        self.pace.speed() <= 1.0
    }

    /// Records a clock reading at `now`, while the world is at virtual instant `world`. After a stall, virtual time
    /// continues from `world`. Returns a warning about stalls, at most once per [`REMINDER`].
    pub(super) fn look(&mut self, now: WallInstant, world: Instant) -> Option<String> {
        let passed = now.saturating_duration_since(std::mem::replace(&mut self.looked, now));
        if let Some(behind) = &mut self.behind {
            behind.worked += passed.min(STALL);
        }
        if passed <= STALL || !self.minds_stalls() {
            return None;
        }
        self.pace.anchor(now, world);
        self.stalls.count += 1;
        self.stalls.time += passed;
        if self.stalls.told.is_some_and(|told| now.saturating_duration_since(told) < REMINDER) {
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
        let speed = self.pace.speed();
        if !self.out_of_reach {
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
        self.pace.anchor(self.looked, world);
        let told = std::mem::replace(&mut self.out_of_reach, true);
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
