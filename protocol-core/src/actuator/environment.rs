//! The supply and temperature monitors, with limits and hysteresis (SPEC 2, table of the monitors).

use core::ops::RangeInclusive;

use super::fault::Fault;
use super::monitor::{Monitor, Reading};
use super::register::FaultRegister;
use crate::time::{Duration, Instant, NEVER};

/// The time for which the temperature must be out of range before its fault activates.
pub const TEMPERATURE_DELAY: Duration = Duration::from_millis(250);
/// The time for which the supply voltage must be out of range before its fault activates.
pub const SUPPLY_DELAY: Duration = Duration::from_millis(2000);
/// The maximum temperature, °C.
const TEMPERATURE_MAX: i32 = 120;
/// The minimum temperature, °C, for kinds with a lower limit.
const TEMPERATURE_MIN: i32 = -40;
/// The hysteresis of the temperature, K (A). The fault clears only this far inside the limits.
const TEMPERATURE_HYSTERESIS: i32 = 5;

/// The ranges of a monitored value: a value outside `allowed` trips the monitor, a value within `safe` clears the
/// fault.
#[derive(Clone, Debug)]
struct Limits {
    allowed: RangeInclusive<i32>,
    safe: RangeInclusive<i32>,
}

impl Limits {
    /// Supply in mV. Trips above 36 V; clears below 32 V (R), not at exactly 32 V (A).
    const SUPPLY_HIGH: Self = Self { allowed: i32::MIN..=36_000, safe: i32::MIN..=31_999 };
    /// Supply in mV. Trips below 9 V; clears above 11 V (R), not at exactly 11 V (A).
    const SUPPLY_LOW: Self = Self { allowed: 9_000..=i32::MAX, safe: 11_001..=i32::MAX };
    /// Temperature in °C, upper limit only.
    const TEMPERATURE_HIGH: Self =
        Self { allowed: i32::MIN..=TEMPERATURE_MAX, safe: i32::MIN..=TEMPERATURE_MAX - TEMPERATURE_HYSTERESIS };
    /// Temperature in °C, both limits, for the CANopen kinds (R).
    const TEMPERATURE_BOTH: Self = Self {
        allowed: TEMPERATURE_MIN..=TEMPERATURE_MAX,
        safe: TEMPERATURE_MIN + TEMPERATURE_HYSTERESIS..=TEMPERATURE_MAX - TEMPERATURE_HYSTERESIS,
    };

    fn read(&self, value: i32) -> Reading {
        Reading { trips: !self.allowed.contains(&value), clears: self.safe.contains(&value) }
    }
}

/// The supply and temperature monitors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Environment {
    low_temperature: bool,
    temperature: Monitor,
    supply_high: Monitor,
    supply_low: Monitor,
    due: Instant,
}

impl Environment {
    pub(super) const fn new(low_temperature: bool) -> Self {
        Self {
            low_temperature,
            temperature: Monitor::new(Fault::Temperature, TEMPERATURE_DELAY),
            supply_high: Monitor::new(Fault::SupplyHigh, SUPPLY_DELAY),
            supply_low: Monitor::new(Fault::SupplyLow, SUPPLY_DELAY),
            due: NEVER,
        }
    }

    pub(super) fn observe(&mut self, supply_mv: u32, temperature_c: i16, faults: &mut FaultRegister, now: Instant) {
        let temperature = if self.low_temperature { Limits::TEMPERATURE_BOTH } else { Limits::TEMPERATURE_HIGH };
        self.temperature.observe(temperature.read(temperature_c.into()), faults, now);
        let supply_mv = i32::try_from(supply_mv).unwrap_or(i32::MAX);
        self.supply_high.observe(Limits::SUPPLY_HIGH.read(supply_mv), faults, now);
        self.supply_low.observe(Limits::SUPPLY_LOW.read(supply_mv), faults, now);
        self.due = self.temperature.due().min(self.supply_high.due()).min(self.supply_low.due());
    }

    /// Returns the time at which the next fault activates if the inputs do not change.
    pub(super) const fn due(&self) -> Instant {
        self.due
    }
}
