//! The protocol-independent single-turn encoder (SPEC 9): the shaft as an exact function of time, and the preset.

use crate::time::{Instant, since};

/// One turn, in 1/100 degree.
pub const TURN_CDEG: u32 = 36_000;

/// The number of position steps in a turn (A): 14 bits.
pub const STEPS: u32 = 16_384;

/// The shaft of the encoder. It turns at a constant speed from a reference time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaft {
    /// The angle at `since`, in 1/100 degree. Whole turns are ignored.
    pub angle_cdeg: u32,
    /// The speed in turns per minute; positive values are clockwise. The position increases clockwise.
    pub speed_rpm: i32,
    /// The reference time of `angle_cdeg`. Before it the shaft is at rest.
    pub since: Instant,
    /// Set while the sensor reports a measuring error. The position still follows the shaft.
    pub measuring_error: bool,
}

/// The number of microseconds in a minute. A *part* is 1/60 000 000 turn: the shaft turns by one part per microsecond
/// at one turn per minute.
const MINUTE_US: u64 = 60_000_000;

/// The whole turns per microsecond that are added to a negative speed. The sum is positive, and whole turns do not
/// change the angle.
const TURNS_FORWARDS: u64 = 36;
const _: () = assert!(TURNS_FORWARDS * MINUTE_US > i32::MIN.unsigned_abs() as u64);

/// The number of angle units in a turn: the least common multiple of 36 000 (1/100 degrees) and 60 000 000 (*parts*).
const TURN: u64 = 180_000_000;

const UNITS_PER_CDEG: u32 = 5_000;
const UNITS_PER_PART: u64 = 3;
const _: () = assert!(UNITS_PER_CDEG as u64 * TURN_CDEG as u64 == TURN && UNITS_PER_PART * MINUTE_US == TURN);

/// The position steps in an angle unit, as a fraction in lowest terms: 64 steps cover 703 125 units.
const STEPS_IN_UNITS: u64 = 64;
const UNITS_IN_STEPS: u64 = 703_125;
const _: () = assert!(STEPS_IN_UNITS * TURN == UNITS_IN_STEPS * STEPS as u64);

/// The maximum result of [`Shaft::units_at`].
const UNITS_MAX: u64 =
    u32::MAX as u64 * UNITS_PER_CDEG as u64 + MINUTE_US * TURNS_FORWARDS * MINUTE_US * UNITS_PER_PART;

const MINUTES: Ratio = Ratio::new(1, MINUTE_US, u64::MAX);
const TURNS: Ratio = Ratio::new(1, TURN, UNITS_MAX);
const STEPS_OF_UNITS: Ratio = Ratio::new(STEPS_IN_UNITS, UNITS_IN_STEPS, UNITS_MAX);

/// A constant ratio below 1 for 64-bit numbers. The Cortex-M4 has no 64-bit division. The ratio multiplies by a scaled
/// reciprocal instead, which saves 115 instructions per position.
struct Ratio {
    /// The number of factors 2 in the denominator. The multiplicand is first shifted right by this number of bits.
    twos: u32,
    /// The numerator divided by the odd part of the denominator, times 2^(64 + `shift`), rounded up.
    scaled: u64,
    shift: u32,
}

impl Ratio {
    /// Creates the ratio of two constants in lowest terms, for multiplicands up to `max`. Assertions check that the
    /// rounding of `scaled` never changes a product.
    #[expect(clippy::arithmetic_side_effects, reason = "constant operands: an overflow is a compile error")]
    const fn new(numerator: u64, denominator: u64, max: u64) -> Self {
        let twos = denominator.trailing_zeros();
        let odd = (denominator >> twos) as u128;
        let shift = (odd / numerator as u128).ilog2();
        let exact = (numerator as u128) << (64 + shift);
        let scaled = exact / odd + 1;
        assert!(scaled <= u64::MAX as u128);
        // The fractional part of the exact product is at most 1 − 1/odd, and the computed product exceeds the exact
        // product by less than 1/odd. So both have the same integer part.
        let excess = scaled * odd - exact;
        assert!((max >> twos) as u128 * excess < 1 << (64 + shift));
        Self { twos, scaled: scaled as u64, shift }
    }

    /// Returns the product of the ratio and a number, rounded down.
    #[inline]
    const fn of(&self, number: u64) -> u64 {
        let product = ((number >> self.twos) as u128).wrapping_mul(self.scaled as u128);
        (product >> 64) as u64 >> self.shift
    }
}

impl Shaft {
    /// Creates a shaft at rest at an angle in 1/100 degree.
    #[must_use]
    pub const fn at(angle_cdeg: u32) -> Self {
        Self { angle_cdeg, speed_rpm: 0, since: Instant::MIN, measuring_error: false }
    }

    /// Returns the angle at `now` in 1/100 degree, below one turn, rounded down.
    #[must_use]
    pub const fn angle_at(&self, now: Instant) -> u32 {
        let units = self.units_at(now);
        let within_turn = units.wrapping_sub(TURNS.of(units).wrapping_mul(TURN)) as u32;
        within_turn / UNITS_PER_CDEG
    }

    /// Returns the raw position at `now`: floor(angle × 16384 / 36000).
    #[inline]
    #[must_use]
    pub const fn position_at(&self, now: Instant) -> u32 {
        STEPS_OF_UNITS.of(self.units_at(now)) as u32 & POSITION_MAX
    }

    /// Returns the angle at `now` in units of 1/[`TURN`] turn. It may exceed one turn.
    #[inline]
    const fn units_at(&self, now: Instant) -> u64 {
        let start = (self.angle_cdeg as u64).wrapping_mul(UNITS_PER_CDEG as u64);
        // At an integer number of turns per minute the shaft returns to its angle after each minute.
        let elapsed = since(now, self.since).as_micros();
        let within_minute = elapsed.wrapping_sub(MINUTES.of(elapsed).wrapping_mul(MINUTE_US));
        let turns = if self.speed_rpm < 0 { TURNS_FORWARDS * MINUTE_US } else { 0 };
        let parts = turns.wrapping_add_signed(self.speed_rpm as i64);
        start.wrapping_add(within_minute.wrapping_mul(parts).wrapping_mul(UNITS_PER_PART))
    }
}

impl Default for Shaft {
    /// Returns a shaft at rest at 0.
    fn default() -> Self {
        Self::at(0)
    }
}

/// A preset: the offset between the raw and the reported position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Preset {
    value: u32,
    /// The offset, below one turn.
    offset: u32,
}

/// The maximum position, and the maximum preset value.
pub const POSITION_MAX: u32 = STEPS - 1;
// The low bits of a number of steps are then the position within the turn.
const _: () = assert!(STEPS.is_power_of_two());

impl Preset {
    /// No preset: the reported position is the raw position.
    pub const NONE: Self = Self { value: 0, offset: 0 };

    /// Returns the preset that changes the reported position from `position` to `value`. Returns `None` for a `value`
    /// above [`POSITION_MAX`].
    #[must_use]
    pub const fn moved(self, position: u32, value: u32) -> Option<Self> {
        if value > POSITION_MAX {
            return None;
        }
        Some(Self { value, offset: self.offset.wrapping_add(value).wrapping_sub(position) & POSITION_MAX })
    }

    /// Returns the preset value.
    #[must_use]
    pub const fn value(self) -> u32 {
        self.value
    }

    /// Converts a raw position to the reported position.
    #[must_use]
    pub const fn position(self, raw: u32) -> u32 {
        raw.wrapping_add(self.offset) & POSITION_MAX
    }

    /// Returns the offset as −8192 … 8191, in the bits of an INTEGER32.
    #[must_use]
    pub const fn offset(self) -> u32 {
        if self.offset < STEPS / 2 { self.offset } else { self.offset.wrapping_sub(STEPS) }
    }

    /// Loads a stored preset value.
    pub const fn load_value(&mut self, value: u32) {
        self.value = value;
    }

    /// Loads a stored offset, in the bits of an INTEGER32.
    pub const fn load_offset(&mut self, offset: u32) {
        self.offset = offset & POSITION_MAX;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::time::Duration;

    #[test]
    fn a_resting_shaft_at_every_angle() {
        for angle in 0..TURN_CDEG {
            let shaft = Shaft::at(angle);
            let now = Instant::from_secs(1_000_000);
            assert_eq!((shaft.angle_at(now), shaft.position_at(now)), (angle, angle * STEPS / TURN_CDEG));
        }
        assert_eq!(Shaft::at(TURN_CDEG).position_at(Instant::MIN), 0, "a whole turn is none");
    }

    /// Returns position and angle, computed directly from their definition.
    fn formula(shaft: &Shaft, elapsed: u64) -> (i128, i128) {
        let turn = 36_000 * 60_000_000;
        let angle = i128::from(shaft.angle_cdeg) * 60_000_000;
        let units = (angle + i128::from(shaft.speed_rpm) * i128::from(elapsed) * 36_000).rem_euclid(turn);
        (units * 16_384 / turn, units / 60_000_000)
    }

    fn found(shaft: &Shaft, now: Instant) -> (i128, i128) {
        (shaft.position_at(now).into(), shaft.angle_at(now).into())
    }

    #[test]
    fn a_turning_shaft_is_exact_at_every_instant() {
        let minutes = u64::MAX / MINUTE_US * MINUTE_US;
        for speed_rpm in [0, 1, -1, 7, -33, 3000, -12_000, 59_999_999, -60_000_000, i32::MAX, i32::MIN] {
            for angle_cdeg in [0, 12_345, 35_999, 36_000, u32::MAX] {
                let shaft = Shaft { speed_rpm, ..Shaft::at(angle_cdeg) };
                for elapsed in [0, 1, 999, 1_000, 59_999_999, 60_000_000, 3_600_000_001, minutes - 1, minutes, u64::MAX]
                {
                    let now = Instant::from_micros(elapsed);
                    assert_eq!(found(&shaft, now), formula(&shaft, elapsed), "{shaft:?}, {elapsed} us");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn every_shaft_is_where_the_formula_says(
            angle_cdeg: u32, speed_rpm: i32, start: u32, elapsed in prop_oneof![0..=u64::MAX >> 32, 0..=u64::MAX >> 1],
        ) {
            let since = Instant::from_micros(start.into());
            let shaft = Shaft { speed_rpm, since, ..Shaft::at(angle_cdeg) };
            prop_assert_eq!(found(&shaft, since + Duration::from_micros(elapsed)), formula(&shaft, elapsed));
        }

        #[test]
        fn a_ratio_rounds_down(number: u64, steps in 0..u64::from(STEPS) * 2_160_000_000) {
            prop_assert_eq!(MINUTES.of(number), number / MINUTE_US);
            // The last number of units before a step, and the first that reaches the step.
            let first = (u128::from(steps) * u128::from(UNITS_IN_STEPS)).div_ceil(STEPS_IN_UNITS.into()) as u64;
            prop_assume!(first < UNITS_MAX);
            prop_assert_eq!(STEPS_OF_UNITS.of(first), steps);
            prop_assert_eq!(STEPS_OF_UNITS.of(first.saturating_sub(1)), steps.saturating_sub(1));
        }
    }

    #[test]
    fn before_its_instant_it_rests() {
        let shaft = Shaft { speed_rpm: 60, since: Instant::from_secs(5), ..Shaft::at(100) };
        assert_eq!(shaft.angle_at(Instant::from_secs(4)), 100);
        assert_eq!(shaft.angle_at(Instant::from_millis(5_250)), 9_100);
    }
}
