//! The travel of the spool over time: legs of constant velocity, in integers.
//!
//! The steps of travel are so fine that every rate is an integer number of steps per microsecond. The default stroke
//! times give exact rates; the rates of other times are rounded. Travel is never rounded, so the number of computations
//! does not affect the result.

use super::Position;
use crate::time::{Duration, Instant, NEVER, delayed, since};

/// Travel from neutral towards the B-port, in steps of 1/[`FULL`](Self::FULL) of the full stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Travel(i32);

impl Travel {
    /// The number of steps in the full stroke: the least common multiple of 16384 (the units of a [`Position`]), the
    /// stroke times of 250 000 and 150 000 µs, eight times each of these times (for a slow spool), and 100 (percent).
    pub(super) const FULL: i32 = 768_000_000;
    /// The number of steps in one unit of a [`Position`].
    pub(super) const UNIT: i32 = Self::FULL / Position::FULL as i32;

    pub(super) const NEUTRAL: Self = Self(0);
    pub(super) const FULL_B: Self = Self(Self::FULL);
    pub(super) const FULL_A: Self = Self(-Self::FULL);

    pub(super) const fn steps(self) -> i32 {
        self.0
    }

    /// Converts a percentage of the full stroke to steps.
    pub(super) const fn percent(percent: i32) -> i32 {
        (Self::FULL / 100).saturating_mul(percent)
    }

    pub(super) const fn new(steps: i32) -> Self {
        Self(steps)
    }

    /// Returns the travel `steps` further towards B, or towards A if negative. Two full strokes fit an i32.
    pub(super) const fn shifted(self, steps: i32) -> Self {
        Self(self.0.wrapping_add(steps))
    }

    /// Converts the travel to a position, truncated towards neutral: only full stroke is ±100 %.
    #[inline]
    pub(super) fn position(self) -> Position {
        Position::clamped(self.0 / Self::UNIT)
    }
}

const _: () = assert!(Travel::UNIT * Position::FULL as i32 == Travel::FULL);

impl From<Position> for Travel {
    fn from(position: Position) -> Self {
        Self(i32::from(position.raw()).saturating_mul(Self::UNIT))
    }
}

/// A range of travel, both ends included.
#[derive(Clone, Copy, Debug)]
pub(super) struct Band {
    low: i32,
    high: i32,
}

impl Band {
    /// Creates the band that extends `steps` to either side of `centre`.
    pub(super) const fn around(centre: Travel, steps: i32) -> Self {
        Self { low: centre.shifted(steps.wrapping_neg()).0, high: centre.shifted(steps).0 }
    }

    /// Returns whether the travel lies within the band. Below the band, the unsigned difference wraps to a value above
    /// the width.
    pub(super) const fn contains(self, travel: Travel) -> bool {
        let width = self.high.wrapping_sub(self.low) as u32;
        travel.0.wrapping_sub(self.low) as u32 <= width
    }
}

/// The rate of a spool movement, in steps per microsecond.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rate(i32);

impl Rate {
    /// Returns the rate that covers the full stroke in a constant time. An assertion checks that the rate is an
    /// integer.
    pub(super) const fn of_full_stroke(full_stroke: Duration) -> Self {
        let micros = full_stroke.as_micros();
        assert!(micros <= Travel::FULL as u64);
        Self(divide(Travel::FULL, micros as i32))
    }

    /// Returns the rate that covers the full stroke in `millis` milliseconds, rounded: accurate to 0.4 % up to 5000 ms.
    pub(super) const fn nearest(millis: u16) -> Self {
        Self(rounded(Travel::FULL, (millis as i32).saturating_mul(1000)))
    }

    /// Returns the rate divided by `divisor`, rounded.
    pub(super) const fn slowed(self, divisor: i32) -> Self {
        Self(rounded(self.0, divisor))
    }
}

/// Returns the rounded quotient, at least 1: a spool with rate 0 would never arrive.
const fn rounded(dividend: i32, divisor: i32) -> i32 {
    let halved = match divisor.checked_div(2) {
        Some(half) => dividend.saturating_add(half),
        None => dividend,
    };
    match halved.checked_div(divisor) {
        Some(quotient) if quotient > 0 => quotient,
        _ => 1,
    }
}

/// Returns the quotient. An assertion checks that it is positive and exact.
const fn divide(dividend: i32, divisor: i32) -> i32 {
    let quotient = match dividend.checked_div(divisor) {
        Some(quotient) => quotient,
        None => 0,
    };
    assert!(quotient > 0 && quotient.saturating_mul(divisor) == dividend);
    quotient
}

/// A movement of the spool at constant velocity.
#[derive(Clone, Copy, Debug)]
struct Leg {
    from: Travel,
    to: Travel,
    start: Instant,
    /// The first microsecond at the travel `to`.
    end: Instant,
    /// The velocity in steps per microsecond, negative towards A.
    velocity: i32,
}

impl Leg {
    fn new(from: Travel, to: Travel, rate: Rate, start: Instant) -> Self {
        let velocity = if to < from { rate.0.wrapping_neg() } else { rate.0 };
        let leg = Self { from, to, start, end: start, velocity };
        Self { end: leg.reaches(to.0), ..leg }
    }

    #[inline]
    fn at(&self, now: Instant) -> Travel {
        if now >= self.end {
            return self.to;
        }
        // Before the end, the product is at most two full strokes, which fit an i32.
        let micros = since(now, self.start).as_micros() as i32;
        self.from.shifted(micros.wrapping_mul(self.velocity))
    }

    /// Returns the first microsecond at which the spool has reached `level`, which must lie between `from` and `to`.
    #[inline]
    fn reaches(&self, level: i32) -> Instant {
        let way = level.abs_diff(self.from.0);
        let rate = self.velocity.unsigned_abs();
        let micros = way.wrapping_add(rate.wrapping_sub(1)).checked_div(rate).unwrap_or(u32::MAX);
        delayed(self.start, Duration::from_micros(u64::from(micros)))
    }

    /// Returns the next time after `now` at which the spool enters or leaves the band; [`NEVER`] if there is no such
    /// time.
    fn crosses(&self, band: Band, now: Instant) -> Instant {
        if now >= self.end {
            return NEVER;
        }
        let here = self.at(now);
        let rising = self.to > self.from;
        let level = match (rising, band.contains(here)) {
            (true, true) => band.high.saturating_add(1),
            (false, true) => band.low.saturating_sub(1),
            (true, false) if here.0 < band.low => band.low,
            (false, false) if here.0 > band.high => band.high,
            _ => return NEVER,
        };
        let on_the_way = if rising { level <= self.to.0 } else { level >= self.to.0 };
        if on_the_way { self.reaches(level) } else { NEVER }
    }
}

/// The path of the spool: an approach to the destination, followed by the creep of a drifting spool.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    approach: Leg,
    creep: Option<Leg>,
}

impl Path {
    pub(super) const fn rest(place: Travel, now: Instant) -> Self {
        let leg = Leg { from: place, to: place, start: now, end: now, velocity: 1 };
        Self { approach: leg, creep: None }
    }

    pub(super) fn new(from: Travel, to: Travel, rate: Rate, now: Instant) -> Self {
        Self { approach: Leg::new(from, to, rate, now), creep: None }
    }

    /// Appends a creep from the destination of the path to `to`.
    pub(super) fn then(self, to: Travel, rate: Rate) -> Self {
        let Self { approach, .. } = self;
        Self { approach, creep: Some(Leg::new(approach.to, to, rate, approach.end)) }
    }

    #[inline]
    pub(super) fn at(&self, now: Instant) -> Travel {
        match &self.creep {
            Some(creep) if now >= creep.start => creep.at(now),
            _ => self.approach.at(now),
        }
    }

    /// Returns whether the spool creeps, or has crept to the end of its path.
    pub(super) fn creeps(&self, now: Instant) -> bool {
        self.creep.as_ref().is_some_and(|creep| now >= creep.start)
    }

    /// Returns the next time after `now` at which the velocity may change; [`NEVER`] once the spool is at rest. The
    /// last microsecond of a leg may cover a shorter distance, so the velocity also changes at the beginning of that
    /// microsecond.
    pub(super) fn bends(&self, now: Instant) -> Instant {
        let ends = |leg: &Leg| {
            let last = Instant::from_ticks(leg.end.as_ticks().saturating_sub(1));
            [last, leg.end].into_iter().find(|bend| *bend > now)
        };
        ends(&self.approach).or_else(|| self.creep.as_ref().and_then(ends)).unwrap_or(NEVER)
    }

    /// Returns the end of the approach. A spool that does not creep stays there.
    pub(super) const fn destination(&self) -> Travel {
        self.approach.to
    }

    /// Returns the time from which the spool is at rest.
    pub(super) const fn rests(&self) -> Instant {
        match &self.creep {
            Some(creep) => creep.end,
            None => self.approach.end,
        }
    }

    /// Returns the first microsecond after `now` at which the spool enters or leaves a band; [`NEVER`] if there is no
    /// such time.
    pub(super) fn crosses(&self, band: Band, now: Instant) -> Instant {
        let creeps = self.creep.as_ref().map_or(NEVER, |creep| creep.crosses(band, now));
        self.approach.crosses(band, now).min(creeps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUARTER_SECOND: Rate = Rate::of_full_stroke(Duration::from_millis(250));

    fn at_us(micros: u64) -> Instant {
        Instant::from_micros(micros)
    }

    #[test]
    fn positions_come_back_as_they_went_in() {
        for raw in -Position::FULL..=Position::FULL {
            let position = Position::new(raw).unwrap();
            assert_eq!(Travel::from(position).position(), position);
        }
    }

    #[test]
    fn arrives_in_the_microsecond_of_its_rate() {
        let path = Path::new(Travel::FULL_A, Travel::FULL_B, QUARTER_SECOND, at_us(7));
        assert_eq!(path.at(at_us(0)), Travel::FULL_A);
        assert_eq!(path.at(at_us(7 + 250_000)), Travel::NEUTRAL);
        assert!(path.at(at_us(7 + 499_999)) < Travel::FULL_B);
        assert_eq!(path.at(at_us(7 + 500_000)), Travel::FULL_B);
        assert_eq!(path.rests(), at_us(7 + 500_000));
    }

    #[test]
    fn crossings_are_the_first_microsecond_on_the_other_side() {
        let neutral = Band::around(Travel::NEUTRAL, Travel::percent(5));
        let to_b = Path::new(Travel::FULL_A, Travel::FULL_B, QUARTER_SECOND, at_us(0));
        let and_back = Path::new(Travel::FULL_B, Travel::FULL_A, QUARTER_SECOND.slowed(8), at_us(0));
        let creeping = Path::new(Travel::FULL_A, Travel::new(-Travel::percent(50)), QUARTER_SECOND, at_us(0))
            .then(Travel::FULL_B, QUARTER_SECOND.slowed(3));
        for path in [to_b, and_back, creeping] {
            let enters = path.crosses(neutral, at_us(0));
            assert!(!neutral.contains(path.at(enters - Duration::from_micros(1))) && neutral.contains(path.at(enters)));
            let leaves = path.crosses(neutral, enters);
            assert!(neutral.contains(path.at(leaves - Duration::from_micros(1))) && !neutral.contains(path.at(leaves)));
            assert_eq!(path.crosses(neutral, leaves), NEVER);
        }
        assert_eq!(to_b.crosses(neutral, at_us(0)), at_us(237_500));
        assert_eq!(to_b.crosses(neutral, at_us(237_500)), at_us(262_501));
    }

    #[test]
    fn what_rests_or_stops_short_crosses_nothing() {
        let neutral = Band::around(Travel::NEUTRAL, Travel::percent(5));
        assert_eq!(Path::rest(Travel::FULL_B, at_us(0)).crosses(neutral, at_us(0)), NEVER);
        let short = Path::new(Travel::FULL_B, Travel::new(Travel::percent(5) + 1), QUARTER_SECOND, at_us(0));
        assert_eq!(short.crosses(neutral, at_us(0)), NEVER);
    }
}
