//! The fault monitor with a delay, and the time guard for set-points (SPEC 2, table of the monitors).

use super::fault::{Fault, FaultSet};
use super::register::FaultRegister;
use super::travel::{Band, Travel};
use crate::time::{Duration, Instant, NEVER, delayed};

/// The deviation from the set-point that monitor 1 allows, in percent of the full stroke (A).
pub const SET_POINT_PERCENT: i32 = 15;
/// The delay of monitor 1: the spool may deviate from its set-point for this time (A).
pub const SET_POINT_DELAY: Duration = Duration::from_millis(500);
/// The delay of monitor 2: the spool must reach the float position within this time (A).
pub const FLOAT_DELAY: Duration = Duration::from_millis(1000);
/// The maximum time between two valid set-points, after which fault 8 activates.
pub const GUARD_TIME: Duration = Duration::from_millis(250);

/// Returns the band that monitor 1 allows around a target.
#[inline]
pub(super) const fn tolerance(target: Travel) -> Band {
    Band::around(target, Travel::percent(SET_POINT_PERCENT))
}

/// The evaluation of a monitored value against its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    /// Whether the value is outside its allowed range.
    pub(super) trips: bool,
    /// Whether the value is in the range that clears an active fault.
    pub(super) clears: bool,
}

/// The monitor of one fault. The fault activates after its cause has lasted for the delay, and clears without delay.
#[derive(Clone, Copy, Debug)]
pub(super) struct Monitor {
    due: Instant,
    delay_us: u32,
    fault: Fault,
}

impl Monitor {
    /// Creates the monitor of a fault. The delay must be a constant: an assertion checks that its microseconds fit 32
    /// bits.
    pub(super) const fn new(fault: Fault, delay: Duration) -> Self {
        assert!(delay.as_micros() <= u32::MAX as u64);
        Self { due: NEVER, delay_us: delay.as_micros() as u32, fault }
    }

    /// Evaluates the monitored value.
    ///
    /// While a reading both trips and clears, the fault activates at the end of each delay and clears at once.
    pub(super) fn observe(&mut self, reading: Reading, faults: &mut FaultRegister, now: Instant) {
        if !faults.active.contains(self.fault) {
            if !reading.trips {
                self.due = NEVER;
                return;
            }
            if self.due == NEVER {
                self.due = self.end(now);
            }
            if now < self.due {
                return;
            }
            faults.activate(self.fault);
            self.due = NEVER;
        }
        if reading.clears {
            faults.clear(self.fault);
            if reading.trips {
                self.due = self.end(now);
            }
        }
    }

    /// Starts or stops the delay as [`observe`](Self::observe) does, for an inactive fault whose delay has not expired.
    #[inline]
    pub(super) fn watch(&mut self, trips: bool, now: Instant) {
        if !trips {
            self.due = NEVER;
        } else if self.due == NEVER {
            self.due = self.end(now);
        }
    }

    /// Returns the end of a delay that begins at `now`.
    #[inline]
    const fn end(&self, now: Instant) -> Instant {
        delayed(now, Duration::from_micros(self.delay_us as u64))
    }

    /// Cancels the running delay. The next tripping reading starts a new delay.
    pub(super) const fn restart(&mut self) {
        self.due = NEVER;
    }

    /// Cancels the running delay if `cleared` contains the fault.
    pub(super) const fn restart_after(&mut self, cleared: FaultSet) {
        if cleared.contains(self.fault) {
            self.restart();
        }
    }

    /// Returns the end of the running delay; [`NEVER`] if no delay is running.
    pub(super) const fn due(&self) -> Instant {
        self.due
    }
}

/// The time guard, which monitors the arrival of set-points (fault 8).
#[derive(Clone, Copy, Debug)]
pub(super) struct TimeGuard {
    running: bool,
    due: Instant,
}

impl TimeGuard {
    pub(super) const STOPPED: Self = Self { running: false, due: NEVER };

    pub(super) fn start(&mut self, now: Instant) {
        *self = Self { running: true, due: delayed(now, GUARD_TIME) };
    }

    /// Handles a valid set-point: restarts a running guard and clears fault 8.
    pub(super) fn feed(&mut self, faults: &mut FaultRegister, now: Instant) {
        self.wind_up(now);
        faults.clear(Fault::TimeGuarding);
    }

    /// Restarts the guard time of a running guard.
    #[inline]
    pub(super) fn wind_up(&mut self, now: Instant) {
        if self.running {
            self.due = delayed(now, GUARD_TIME);
        }
    }

    /// Activates fault 8 once the guard time has expired. The next set-point starts the guard time again.
    pub(super) fn observe(&mut self, faults: &mut FaultRegister, now: Instant) {
        if now >= self.due {
            self.due = NEVER;
            faults.activate(Fault::TimeGuarding);
        }
    }

    pub(super) const fn due(&self) -> Instant {
        self.due
    }
}
