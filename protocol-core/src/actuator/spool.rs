//! The spool, modelled or measured (SPEC 2).
//!
//! In the model two solenoids move the spool at a limited rate, and springs return it to neutral. The hand lever
//! overrides both.

use core::ops::RangeInclusive;

use super::Position;
use super::travel::{Band, Path, Rate, Travel};
use crate::time::{Duration, Instant};

/// The time for the solenoids to move the spool from neutral to full stroke (A).
pub const SOLENOID_STROKE: Duration = Duration::from_millis(250);
/// The time for the springs to return the spool from full stroke to neutral (A).
pub const SPRING_STROKE: Duration = Duration::from_millis(150);
/// The divisor by which [`SpoolFault::Slow`] reduces the rates (A).
pub const SLOWNESS: i32 = 8;
/// The time for a [`SpoolFault::Drifting`] spool to creep a full stroke (A).
pub const DRIFT_STROKE: Duration = Duration::from_secs(8);
/// The distance that a [`SpoolFault::Drifting`] spool creeps, in percent of the full stroke (A). Monitor 1 allows a
/// smaller deviation.
pub const DRIFT_PERCENT: i32 = 20;
/// The end position of a [`SpoolFault::NoFloat`] spool in float, in percent of the full stroke (A). The float band
/// begins beyond this position.
pub const NO_FLOAT_PERCENT: i32 = 80;
/// The tolerance of the neutral and float positions, in percent of the full stroke (A).
pub const END_BAND_PERCENT: i32 = 5;

const DRIFT: Rate = Rate::of_full_stroke(DRIFT_STROKE);

/// The band of the neutral position.
pub(super) const IN_NEUTRAL: Band = Band::around(Travel::NEUTRAL, Travel::percent(END_BAND_PERCENT));
/// The band of the float position.
pub(super) const IN_FLOAT: Band = Band::around(Travel::FULL_B, Travel::percent(END_BAND_PERCENT));

/// A fault of the spool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpoolFault {
    /// No fault.
    #[default]
    None,
    /// The spool is jammed: no force moves it.
    Stuck,
    /// Solenoids and springs move the spool too slowly.
    Slow,
    /// The spool does not hold its position: it creeps towards B, or towards A if there is no room.
    Drifting,
    /// The spool does not reach the float position.
    NoFloat,
}

/// The stroke times of a healthy spool. A user can set the measured times of a real valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpoolTimes {
    stroke_ms: u16,
    return_ms: u16,
}

impl SpoolTimes {
    /// The permitted times, in milliseconds (A).
    pub const RANGE_MS: RangeInclusive<u16> = 10..=5000;
    /// The default times, [`SOLENOID_STROKE`] and [`SPRING_STROKE`].
    pub const DEFAULT: Self =
        Self { stroke_ms: SOLENOID_STROKE.as_millis() as u16, return_ms: SPRING_STROKE.as_millis() as u16 };

    /// Creates stroke times: `stroke_ms` for the solenoids from neutral to full stroke, `return_ms` for the springs
    /// from full stroke to neutral. Returns `None` outside [`RANGE_MS`](Self::RANGE_MS). The model reproduces the times
    /// to within 0.4 %.
    #[must_use]
    pub fn new(stroke_ms: u16, return_ms: u16) -> Option<Self> {
        let are_possible = [stroke_ms, return_ms].iter().all(|ms| Self::RANGE_MS.contains(ms));
        are_possible.then_some(Self { stroke_ms, return_ms })
    }

    /// Returns the time that the solenoids take from neutral to full stroke, in milliseconds.
    #[must_use]
    pub const fn stroke_ms(self) -> u16 {
        self.stroke_ms
    }

    /// Returns the time that the springs take from full stroke to neutral, in milliseconds.
    #[must_use]
    pub const fn return_ms(self) -> u16 {
        self.return_ms
    }
}

impl Default for SpoolTimes {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The roughness of a simulated spool (A). By default the spool is smooth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Roughness {
    /// The present deviation of the spool from its set-point, which a simulator changes at random.
    pub offset: Position,
    /// The dead-band, in units of a [`Position`]. The spool ignores a new set-point within this distance of the last
    /// followed set-point.
    pub dead_band: u16,
}

impl Roughness {
    /// A smooth spool.
    pub const NONE: Self = Self { offset: Position::NEUTRAL, dead_band: 0 };
}

/// The rates at which solenoids and springs move the spool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Rates {
    solenoids: Rate,
    springs: Rate,
}

impl Rates {
    const fn of(times: SpoolTimes) -> Self {
        Self { solenoids: Rate::nearest(times.stroke_ms), springs: Rate::nearest(times.return_ms) }
    }
}

/// The influences on the spool from outside the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpoolSense {
    /// The fault of the spool.
    pub fault: SpoolFault,
    /// The position to which the hand lever pushes the spool.
    pub lever: Option<Position>,
    /// The position that a sensor has measured. It overrides the model. `None` without a sensor.
    pub measured: Option<Position>,
    /// The stroke times.
    pub times: SpoolTimes,
    /// The roughness.
    pub roughness: Roughness,
}

impl SpoolSense {
    /// A healthy spool without external influences.
    pub const FREE: Self = Self {
        fault: SpoolFault::None,
        lever: None,
        measured: None,
        times: SpoolTimes::DEFAULT,
        roughness: Roughness::NONE,
    };
}

/// The action of the device on the spool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// The solenoids are off; the springs move the spool.
    Release,
    /// The solenoids move the spool to this travel and hold it there.
    Move(Travel),
    /// The solenoids move the spool to the float position and hold it there.
    Float,
}

/// The influence that decides the travel of the spool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Influence {
    /// The spool follows the device alone.
    Device,
    /// The spool follows the device, with this fault and this roughness.
    Impaired(SpoolFault, Roughness),
    /// The lever or the sensor determines the position.
    At(Position),
    /// The spool cannot move.
    Stuck,
}

impl From<SpoolSense> for Influence {
    fn from(sense: SpoolSense) -> Self {
        match sense {
            SpoolSense { measured: Some(position), .. } => Self::At(position),
            SpoolSense { fault: SpoolFault::Stuck, .. } => Self::Stuck,
            SpoolSense { lever: Some(position), .. } => Self::At(position),
            SpoolSense { fault: SpoolFault::None, roughness: Roughness::NONE, .. } => Self::Device,
            // The solenoids do not hold a drifting spool, so it does not tremble.
            SpoolSense { fault: fault @ SpoolFault::Drifting, roughness, .. } => {
                Self::Impaired(fault, Roughness { offset: Position::NEUTRAL, ..roughness })
            }
            SpoolSense { fault, roughness, .. } => Self::Impaired(fault, roughness),
        }
    }
}

/// The spool and the influences on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spool {
    path: Path,
    action: Action,
    influence: Influence,
    rates: Rates,
}

impl Spool {
    /// Creates a spool at rest in neutral.
    pub(super) const fn new(now: Instant) -> Self {
        Self {
            path: Path::rest(Travel::NEUTRAL, now),
            action: Action::Release,
            influence: Influence::Device,
            rates: const { Rates::of(SpoolTimes::DEFAULT) },
        }
    }

    pub(super) fn sense(&mut self, sense: SpoolSense, now: Instant) {
        let (influence, rates) = (Influence::from(sense), Rates::of(sense.times));
        if (influence, rates) != (self.influence, self.rates) {
            self.influence = influence;
            self.rates = rates;
            // Neither roughness nor rates bring a creeping spool back to its set-point.
            let creeps_on = matches!(influence, Influence::Impaired(SpoolFault::Drifting, _)) && self.path.creeps(now);
            if !creeps_on {
                self.plan(self.at(now), now);
            }
        }
    }

    /// Applies an action of the device to the spool, which is at `here`.
    pub(super) fn act(&mut self, action: Action, here: Travel, now: Instant) {
        if action != self.action && !self.ignores(action) {
            self.action = action;
            self.plan(here, now);
        }
    }

    /// Returns whether a rough spool does not follow a new set-point.
    fn ignores(&self, action: Action) -> bool {
        let (Influence::Impaired(_, Roughness { dead_band, .. }), Action::Move(to), Action::Move(from)) =
            (self.influence, action, self.action)
        else {
            return false;
        };
        to.steps().abs_diff(from.steps()) <= u32::from(dead_band).saturating_mul(Travel::UNIT.unsigned_abs())
    }

    /// Returns whether the device alone moves a healthy spool. Such a spool moves at constant speed to its destination
    /// and stays there.
    #[inline]
    pub(super) fn is_free(&self) -> bool {
        matches!(self.influence, Influence::Device)
    }

    /// Applies [`Action::Move`] to a [free](Self::is_free) spool, which is at `here`.
    #[inline]
    pub(super) fn retarget(&mut self, target: Travel, here: Travel, now: Instant) {
        self.action = Action::Move(target);
        self.path = Path::new(here, target, self.rates.solenoids, now);
    }

    pub(super) fn at(&self, now: Instant) -> Travel {
        self.path.at(now)
    }

    /// Like [`at`](Self::at), inlined for the cyclic path.
    #[inline]
    pub(super) fn at_in_cycle(&self, now: Instant) -> Travel {
        self.path.at(now)
    }

    /// Returns the next time after `now` at which the velocity of the spool may change.
    pub(super) fn bends(&self, now: Instant) -> Instant {
        self.path.bends(now)
    }

    pub(super) const fn destination(&self) -> Travel {
        self.path.destination()
    }

    /// Returns the time from which the undisturbed spool is at rest.
    pub(super) const fn rests(&self) -> Instant {
        self.path.rests()
    }

    /// Returns the next time after `now` at which the spool enters or leaves a band.
    pub(super) fn crosses(&self, band: Band, now: Instant) -> Instant {
        self.path.crosses(band, now)
    }

    /// Plans the path of the spool from `here`.
    fn plan(&mut self, here: Travel, now: Instant) {
        self.path = match self.influence {
            Influence::Device => self.action.path(here, SpoolFault::None, Position::NEUTRAL, self.rates, now),
            Influence::Impaired(fault, Roughness { offset, .. }) => {
                self.action.path(here, fault, offset, self.rates, now)
            }
            Influence::At(position) => Path::rest(position.into(), now),
            Influence::Stuck => Path::rest(here, now),
        };
    }
}

impl Action {
    /// Returns the path of a spool that is neither stuck nor held, from `here`. The solenoids move the spool to their
    /// target plus `offset`.
    fn path(self, here: Travel, fault: SpoolFault, offset: Position, rates: Rates, now: Instant) -> Path {
        let (to, rate) = match self {
            Self::Release => (Travel::NEUTRAL, rates.springs),
            Self::Move(target) => {
                let beside = target.shifted(Travel::from(offset).steps());
                (beside.clamp(Travel::FULL_A, Travel::FULL_B), rates.solenoids)
            }
            Self::Float if fault == SpoolFault::NoFloat => (NO_FLOAT, rates.solenoids),
            Self::Float => (Travel::FULL_B, rates.solenoids),
        };
        let path = Path::new(here, to, if fault == SpoolFault::Slow { rate.slowed(SLOWNESS) } else { rate }, now);
        if fault == SpoolFault::Drifting && self != Self::Release { path.then(drifted(to), DRIFT) } else { path }
    }
}

const NO_FLOAT: Travel = Travel::new(Travel::percent(NO_FLOAT_PERCENT));

/// Returns the travel to which a drifting spool creeps from `target`.
fn drifted(target: Travel) -> Travel {
    let offset = Travel::percent(DRIFT_PERCENT);
    let towards_b = target.shifted(offset);
    if towards_b <= Travel::FULL_B { towards_b } else { target.shifted(offset.saturating_neg()) }
}
