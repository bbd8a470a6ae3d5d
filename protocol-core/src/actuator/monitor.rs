//! What is watched, and for how long it must be wrong: limits, hysteresis and delay (SPEC 2, table of the monitors).

use core::ops::RangeInclusive;

use super::fault::{Fault, FaultRegister};
use super::travel::Travel;
use crate::time::{Duration, Instant, NEVER, after};

/// How far the spool may be away from its set-point, in percent of the full stroke (A).
pub const SET_POINT_PERCENT: i32 = 15;
/// How long the spool may be away from its set-point (A).
pub const SET_POINT_DELAY: Duration = Duration::from_millis(500);
/// How long the spool may take to reach float (A).
pub const FLOAT_DELAY: Duration = Duration::from_millis(1000);
/// How long the temperature may be out of its limits.
pub const TEMPERATURE_DELAY: Duration = Duration::from_millis(250);
/// How long the supply may be out of its limits.
pub const SUPPLY_DELAY: Duration = Duration::from_millis(2000);
/// How long there may be no valid set-point.
pub const GUARD_TIME: Duration = Duration::from_millis(250);

/// [`SET_POINT_PERCENT`] in steps of travel.
pub(super) const SET_POINT_TOLERANCE: i32 = Travel::percent(SET_POINT_PERCENT);

/// Highest temperature, °C.
const TEMPERATURE_MAX: i32 = 120;
/// Lowest temperature where there is one, °C.
const TEMPERATURE_MIN: i32 = -40;
/// How far inside its limits the temperature is well again, K (A).
const TEMPERATURE_HYSTERESIS: i32 = 5;

/// What a monitored value says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    /// It is beyond the limit.
    pub(super) trips: bool,
    /// It is so good that an active fault is gone.
    pub(super) clears: bool,
}

/// The limits of a value, and those within which it must come back.
#[derive(Clone, Debug)]
pub(super) struct Limits {
    allowed: RangeInclusive<i32>,
    safe: RangeInclusive<i32>,
}

impl Limits {
    /// Supply, mV: trips above 36 V, clears below 32 V (R).
    pub(super) const SUPPLY_HIGH: Self = Self { allowed: i32::MIN..=36_000, safe: i32::MIN..=31_999 };
    /// Supply, mV: trips below 9 V, clears above 11 V (R).
    pub(super) const SUPPLY_LOW: Self = Self { allowed: 9_000..=i32::MAX, safe: 11_001..=i32::MAX };
    /// °C.
    pub(super) const TEMPERATURE_HIGH: Self =
        Self { allowed: i32::MIN..=TEMPERATURE_MAX, safe: i32::MIN..=TEMPERATURE_MAX - TEMPERATURE_HYSTERESIS };
    /// °C, for the kinds that watch the cold too.
    pub(super) const TEMPERATURE_BOTH: Self = Self {
        allowed: TEMPERATURE_MIN..=TEMPERATURE_MAX,
        safe: TEMPERATURE_MIN + TEMPERATURE_HYSTERESIS..=TEMPERATURE_MAX - TEMPERATURE_HYSTERESIS,
    };

    pub(super) fn read(&self, value: i32) -> Reading {
        Reading { trips: !self.allowed.contains(&value), clears: self.safe.contains(&value) }
    }
}

/// Watches for one fault: the cause must last for the whole delay, its end counts at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Monitor {
    fault: Fault,
    delay: Duration,
    due: Instant,
}

impl Monitor {
    pub(super) const fn new(fault: Fault, delay: Duration) -> Self {
        Self { fault, delay, due: NEVER }
    }

    /// Takes what the value says now.
    ///
    /// A fault that is gone the moment it activates, while its cause lasts, comes again after another delay.
    pub(super) fn observe(&mut self, reading: Reading, faults: &mut FaultRegister, now: Instant) {
        if !faults.active.contains(self.fault) {
            if !reading.trips {
                self.due = NEVER;
                return;
            }
            if self.due == NEVER {
                self.due = after(now, self.delay);
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
                self.due = after(now, self.delay);
            }
        }
    }

    /// Lets the delay begin anew.
    pub(super) const fn restart(&mut self) {
        self.due = NEVER;
    }

    /// When the fault activates if the value stays as it is.
    pub(super) const fn due(&self) -> Instant {
        self.due
    }
}

/// Watches that set-points keep coming (fault 8).
#[derive(Clone, Copy, Debug)]
pub(super) struct TimeGuard {
    running: bool,
    due: Instant,
}

impl TimeGuard {
    pub(super) const STOPPED: Self = Self { running: false, due: NEVER };

    pub(super) fn start(&mut self, now: Instant) {
        *self = Self { running: true, due: after(now, GUARD_TIME) };
    }

    /// A valid set-point came.
    pub(super) fn feed(&mut self, faults: &mut FaultRegister, now: Instant) {
        if self.running {
            self.start(now);
        }
        faults.clear(Fault::TimeGuarding);
    }

    /// The time without a set-point may be over. It then waits for the next one.
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
