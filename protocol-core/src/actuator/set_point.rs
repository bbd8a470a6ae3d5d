//! Set-points and positions, and the scales of the protocols (SPEC 2).

/// An actual or commanded spool position: −16384 (−100 %, retract, towards the A-port) … 0 (neutral) … +16384 (+100 %,
/// extend, towards the B-port).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Position(i16);

impl Position {
    /// The full stroke.
    pub const FULL: i16 = 16384;
    /// Neutral.
    pub const NEUTRAL: Self = Self(0);
    /// −100 %, on the A-port side.
    pub const MIN: Self = Self(-Self::FULL);
    /// +100 %, on the B-port side.
    pub const MAX: Self = Self(Self::FULL);

    /// Creates a position of −16384 … 16384; `None` outside this range.
    #[must_use]
    pub const fn new(raw: i16) -> Option<Self> {
        if raw >= -Self::FULL && raw <= Self::FULL { Some(Self(raw)) } else { None }
    }

    /// Returns the position `raw`, limited to −16384 … 16384.
    #[must_use]
    #[inline]
    pub fn clamped(raw: i32) -> Self {
        Self(raw.clamp(Self::MIN.0 as i32, Self::MAX.0 as i32) as i16)
    }

    /// Returns the position in units of 1/16384 of the full stroke.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> i16 {
        self.0
    }

    /// Returns the position at the same distance on the other side of neutral.
    #[must_use]
    pub const fn mirrored(self) -> Self {
        Self(self.0.saturating_neg())
    }

    /// Returns whether the position is exactly neutral.
    #[must_use]
    pub const fn is_neutral(self) -> bool {
        self.0 == 0
    }
}

/// The scale of a position in a protocol: ±N for ±100 % (SPEC 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// ±127: the 8-bit objects.
    Per127,
    /// ±1000: the 16-bit objects.
    Per1000,
    /// ±250: the port flow command, 0.4 % per bit.
    Per250,
    /// ±100: percent.
    Percent,
}

impl Scale {
    /// Returns N, the value for 100 %.
    #[must_use]
    pub const fn full(self) -> i16 {
        match self {
            Self::Per127 => 127,
            Self::Per1000 => 1000,
            Self::Per250 => 250,
            Self::Percent => 100,
        }
    }

    /// Converts a value to a position; `None` outside ±N.
    #[must_use]
    pub fn to_position(self, value: i16) -> Option<Position> {
        let full = self.full();
        (value.unsigned_abs() <= full.unsigned_abs())
            .then(|| Position::clamped(rescale(i32::from(value), i32::from(Position::FULL), i32::from(full))))
    }

    /// Converts a position to a value within ±N.
    #[must_use]
    #[inline]
    pub fn of_position(self, position: Position) -> i16 {
        rescale(i32::from(position.0), i32::from(self.full()), i32::from(Position::FULL)) as i16
    }
}

/// The set-point that the protocol gives to the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetPoint {
    /// The spool moves to this position.
    Position(Position),
    /// The spool moves fully to the B-port side, where both ports are connected to tank. Float is not a [`Position`].
    Float,
}

impl SetPoint {
    /// Neutral, the safe set-point.
    pub const NEUTRAL: Self = Self::Position(Position::NEUTRAL);
}

impl Default for SetPoint {
    fn default() -> Self {
        Self::NEUTRAL
    }
}

/// Returns `value × to / from`, rounded half away from zero. The product must fit 31 bits; here it fits 25.
#[inline]
fn rescale(value: i32, to: i32, from: i32) -> i32 {
    let half = from.wrapping_div(2);
    let product = value.saturating_mul(to);
    let rounded = if product < 0 { product.saturating_sub(half) } else { product.saturating_add(half) };
    rounded.checked_div(from).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_meet_at_neutral_and_full_stroke() {
        for scale in [Scale::Per127, Scale::Per1000, Scale::Per250, Scale::Percent] {
            let full = scale.full();
            assert_eq!(scale.to_position(full), Some(Position::MAX));
            assert_eq!(scale.to_position(-full), Some(Position::MIN));
            assert_eq!(scale.to_position(0), Some(Position::NEUTRAL));
            assert_eq!(scale.to_position(full + 1), None);
            assert_eq!(scale.to_position(-full - 1), None);
        }
        assert_eq!(Scale::Per127.to_position(i16::MIN), None);
    }

    #[test]
    fn rounds_half_away_from_zero() {
        // 1 × 16384 / 127 = 129.007…, 500 × 16384 / 1000 = 8192, 3 × 16384 / 1000 = 49.152
        assert_eq!(Scale::Per127.to_position(1).unwrap().raw(), 129);
        assert_eq!(Scale::Per1000.to_position(500).unwrap().raw(), 8192);
        assert_eq!(Scale::Per1000.to_position(-3).unwrap().raw(), -49);
        // 8192 × 127 / 16384 = 63.5
        assert_eq!(Scale::Per127.of_position(Position(8192)), 64);
        assert_eq!(Scale::Per127.of_position(Position(-8192)), -64);
    }

    #[test]
    fn every_value_comes_back_as_it_was_written() {
        for scale in [Scale::Per127, Scale::Per1000, Scale::Per250, Scale::Percent] {
            for value in -scale.full()..=scale.full() {
                assert_eq!(scale.of_position(scale.to_position(value).unwrap()), value);
            }
        }
    }
}
