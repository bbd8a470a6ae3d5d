//! The single-turn encoder without a protocol: the shaft as a function of time, exact at any speed, and the preset (SPEC 9).

use crate::time::{Instant, since};

/// One turn, 1/100 degree.
pub const TURN_CDEG: u32 = 36_000;

/// The steps of one turn (A): 14 bits.
pub const STEPS: u32 = 16_384;

/// What the encoder senses of its shaft: where it was at an instant, and how fast it has turned since.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaft {
    /// The angle at `since`, 1/100 degree; a whole turn counts as none.
    pub angle_cdeg: u32,
    /// The speed in turns a minute, positive clockwise, where the position rises.
    pub speed_rpm: i32,
    /// The instant of `angle_cdeg`; before it, the shaft rests.
    pub since: Instant,
    /// The sensor unit detects a measuring error. The position stays live.
    pub measuring_error: bool,
}

/// Microseconds in a minute: at one turn a minute, the parts of a turn that the shaft can have come to.
const MINUTE_US: u64 = 60_000_000;

/// A turn in the unit that holds 1/100 degree and those parts exactly: their least common multiple.
const TURN: u64 = 180_000_000;

const UNITS_PER_CDEG: u64 = 5_000;
const UNITS_PER_PART: u64 = 3;
const _: () = assert!(UNITS_PER_CDEG * TURN_CDEG as u64 == TURN && UNITS_PER_PART * MINUTE_US == TURN);

/// The steps in so many units, in lowest terms.
const STEPS_IN_UNITS: u64 = 64;
const UNITS_IN_STEPS: u64 = 703_125;
const _: () = assert!(STEPS_IN_UNITS * TURN == UNITS_IN_STEPS * STEPS as u64);

/// The most units that [`Shaft::units_at`] returns: no product here reaches 64 bits.
const UNITS_MAX: u64 = u32::MAX as u64 * UNITS_PER_CDEG + MINUTE_US * MINUTE_US * UNITS_PER_PART;
const _: () = assert!(UNITS_MAX < u64::MAX / STEPS_IN_UNITS);

impl Shaft {
    /// Returns a shaft that rests at an angle in 1/100 degree.
    #[must_use]
    pub const fn at(angle_cdeg: u32) -> Self {
        Self { angle_cdeg, speed_rpm: 0, since: Instant::MIN, measuring_error: false }
    }

    /// Returns the angle at an instant in 1/100 degree, below a turn, rounded down.
    #[must_use]
    pub const fn angle_at(&self, now: Instant) -> u32 {
        (self.units_at(now) % TURN / UNITS_PER_CDEG) as u32
    }

    /// Returns the raw position at an instant: floor(angle × 16384 / 36000).
    #[inline]
    #[must_use]
    pub const fn position_at(&self, now: Instant) -> u32 {
        (self.units_at(now).wrapping_mul(STEPS_IN_UNITS) / UNITS_IN_STEPS) as u32 & POSITION_MAX
    }

    /// The angle in units, whole turns included.
    #[inline]
    const fn units_at(&self, now: Instant) -> u64 {
        let start = (self.angle_cdeg as u64).wrapping_mul(UNITS_PER_CDEG);
        // A shaft with a whole number of turns a minute is back where it was after each minute, and backwards by some parts
        // of a turn is forwards by the others.
        let elapsed = since(now, self.since).as_micros() % MINUTE_US;
        let parts = self.speed_rpm.rem_euclid(MINUTE_US as i32) as u64;
        start.wrapping_add(elapsed.wrapping_mul(parts).wrapping_mul(UNITS_PER_PART))
    }
}

impl Default for Shaft {
    /// Rests at 0.
    fn default() -> Self {
        Self::at(0)
    }
}

/// A position that a preset moves against the raw one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Preset {
    value: u32,
    /// What the position is ahead of the raw one, below a turn.
    offset: u32,
}

/// The highest position, and preset.
pub const POSITION_MAX: u32 = STEPS - 1;
// A position modulo a turn is the low bits of a number.
const _: () = assert!(STEPS.is_power_of_two());

impl Preset {
    /// No preset: the position is the raw one.
    pub const NONE: Self = Self { value: 0, offset: 0 };

    /// Returns the preset that makes the raw position `raw` read `value`; `None` above [`POSITION_MAX`].
    #[must_use]
    pub const fn new(value: u32, raw: u32) -> Option<Self> {
        if value > POSITION_MAX {
            return None;
        }
        Some(Self { value, offset: value.wrapping_sub(raw) & POSITION_MAX })
    }

    /// The value that was set.
    #[must_use]
    pub const fn value(self) -> u32 {
        self.value
    }

    /// Returns the position of a raw one.
    #[must_use]
    pub const fn position(self, raw: u32) -> u32 {
        raw.wrapping_add(self.offset) & POSITION_MAX
    }

    /// Returns the offset as −8192 … 8191, in the bits of an INTEGER32.
    #[must_use]
    pub const fn offset(self) -> u32 {
        if self.offset < STEPS / 2 { self.offset } else { self.offset.wrapping_sub(STEPS) }
    }

    /// Takes a stored value.
    pub const fn load_value(&mut self, value: u32) {
        self.value = value;
    }

    /// Takes a stored offset, in the bits of an INTEGER32.
    pub const fn load_offset(&mut self, offset: u32) {
        self.offset = offset & POSITION_MAX;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resting_shaft_at_every_angle() {
        for angle in 0..TURN_CDEG {
            let shaft = Shaft::at(angle);
            let now = Instant::from_secs(1_000_000);
            assert_eq!((shaft.angle_at(now), shaft.position_at(now)), (angle, angle * STEPS / TURN_CDEG));
        }
        assert_eq!(Shaft::at(TURN_CDEG).position_at(Instant::MIN), 0, "a whole turn is none");
    }

    #[test]
    fn a_turning_shaft_is_exact_at_every_instant() {
        for speed_rpm in [1, -1, 7, -33, 3000, -12_000, i32::MAX, i32::MIN] {
            let start = Instant::from_secs(5);
            let shaft = Shaft { speed_rpm, since: start, ..Shaft::at(12_345) };
            for elapsed in [0, 1, 999, 1_000, 59_999_999, 60_000_000, 3_600_000_001, u64::from(u32::MAX) * 1_000] {
                let units = 12_345_i128 * 60_000_000 + i128::from(speed_rpm) * i128::from(elapsed) * 36_000;
                let turn = 36_000 * 60_000_000;
                let expected = units.rem_euclid(turn) * 16_384 / turn;
                let now = Instant::from_micros(5_000_000 + elapsed);
                assert_eq!(i128::from(shaft.position_at(now)), expected, "{speed_rpm} rpm, {elapsed} us");
                assert_eq!(i128::from(shaft.angle_at(now)), units.rem_euclid(turn) / 60_000_000);
            }
        }
    }

    #[test]
    fn before_its_instant_it_rests() {
        let shaft = Shaft { speed_rpm: 60, since: Instant::from_secs(5), ..Shaft::at(100) };
        assert_eq!(shaft.angle_at(Instant::from_secs(4)), 100);
        assert_eq!(shaft.angle_at(Instant::from_millis(5_250)), 9_100);
    }
}
