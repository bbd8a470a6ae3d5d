//! The changes of the plant: parsing, printing and application.

use core::fmt;

use super::words::{
    ANGLE_CDEG, ANSWER_MS, BOOT_MS, BROWN_OUT_MV, BUS_OFF, CYCLE_MS, INTERNAL_FAULT, LEVER, MEASURING_ERROR, MEMORY,
    OFF, OIL, OK, ON, SPEED_RPM, SPOOL, SPOOL_WORDS, SUPPLY_MV, TEMPERATURE_C, Value, WORDS, WRITE_FAILS, Word,
};
use crate::actuator::{Position, SpoolFault};
use crate::device::{Inputs, ProductInputs};
use crate::encoder::Shaft;
use crate::time::Instant;

/// A change of the plant. It is printed as in a console line: `supply_mv 8500`. [`apply`](Self::apply) refuses a value
/// outside the range of its [word](Self::word).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// The supply voltage of a valve, in millivolts.
    SupplyMv(u32),
    /// The temperature of a valve, in °C.
    TemperatureC(i16),
    /// The fault of a valve's spool.
    Spool(SpoolFault),
    /// The position to which the hand lever pushes a valve's spool; `None` for a released lever.
    Lever(Option<i16>),
    /// The angle of an encoder's shaft, in 1/100 degree. A turning shaft continues from this angle.
    AngleCdeg(u32),
    /// The speed of an encoder's shaft, in turns per minute; positive values are clockwise. The shaft continues from
    /// its present angle, rounded down to 1/100 degree.
    SpeedRpm(i32),
    /// True if an encoder reports a measuring error.
    MeasuringError(bool),
    /// Whether an internal fault is injected.
    InternalFault(bool),
    /// Whether every write to the memory fails.
    MemoryFails(bool),
    /// Whether the CAN controller is held bus-off.
    BusOff(bool),
    /// The supply voltage below which a simulated valve is off, in millivolts; `None` for never.
    BrownOutMv(Option<u32>),
    /// True if the oil of a simulated valve is as cold as the valve.
    Oil(bool),
    /// The time from power-up to the start of the simulated program, in milliseconds.
    BootMs(u16),
    /// The minimum and maximum answer delay in the simulator, in milliseconds.
    AnswerMs(u16, u16),
    /// The cycle time of the simulated program, in milliseconds; 0 for none.
    CycleMs(u16),
}

/// The reason why a change cannot be applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inapplicable {
    /// The word belongs to another product.
    OtherProduct,
    /// The value is out of range.
    OutOfRange,
}

impl Change {
    /// Parses a word and its value. Returns `None` for an unknown word or a malformed value. The range is not checked.
    #[must_use]
    pub fn parse(word: &str, value: &str) -> Option<Self> {
        Self::parse_on_board(word, value).or_else(|| Self::parse_simulated(word, value))
    }

    /// Parses a word of a board and its value, as [`parse`](Self::parse) does.
    #[must_use]
    pub fn parse_on_board(word: &str, value: &str) -> Option<Self> {
        Some(match word {
            SUPPLY_MV => Self::SupplyMv(natural(value, DECIMAL)?),
            TEMPERATURE_C => Self::TemperatureC(small(value)?),
            SPOOL => Self::Spool(SPOOL_WORDS.iter().zip(SPOOL_FAULTS).find(|(name, _)| **name == value)?.1),
            LEVER if value == OFF => Self::Lever(None),
            LEVER => Self::Lever(Some(small(value)?)),
            ANGLE_CDEG => Self::AngleCdeg(natural(value, DECIMAL)?),
            SPEED_RPM => Self::SpeedRpm(integer(value)?),
            MEASURING_ERROR => Self::MeasuringError(switch(value)?),
            INTERNAL_FAULT => Self::InternalFault(switch(value)?),
            MEMORY if value == WRITE_FAILS => Self::MemoryFails(true),
            MEMORY if value == OK => Self::MemoryFails(false),
            BUS_OFF => Self::BusOff(switch(value)?),
            _ => return None,
        })
    }

    /// Parses a word that only the simulator has.
    fn parse_simulated(word: &str, value: &str) -> Option<Self> {
        let millis = |value: &str| natural(value, DECIMAL)?.try_into().ok();
        Some(match word {
            BROWN_OUT_MV if value == OFF => Self::BrownOutMv(None),
            BROWN_OUT_MV => Self::BrownOutMv(Some(natural(value, DECIMAL)?)),
            OIL => Self::Oil(switch(value)?),
            BOOT_MS => Self::BootMs(millis(value)?),
            ANSWER_MS => {
                let (from, to) = value.split_once("..").unwrap_or((value, value));
                Self::AnswerMs(millis(from)?, millis(to)?)
            }
            CYCLE_MS => Self::CycleMs(millis(value)?),
            _ => return None,
        })
    }

    /// Returns the entry of the word in [`WORDS`].
    #[must_use]
    pub const fn word(self) -> &'static Word {
        let [supply_mv, temperature_c, spool, lever, angle_cdeg, speed_rpm, measuring_error, common @ ..] = &WORDS;
        let [internal_fault, memory, bus_off, brown_out_mv, oil, boot_ms, answer_ms, cycle_ms] = common;
        match self {
            Self::SupplyMv(_) => supply_mv,
            Self::TemperatureC(_) => temperature_c,
            Self::Spool(_) => spool,
            Self::Lever(_) => lever,
            Self::AngleCdeg(_) => angle_cdeg,
            Self::SpeedRpm(_) => speed_rpm,
            Self::MeasuringError(_) => measuring_error,
            Self::InternalFault(_) => internal_fault,
            Self::MemoryFails(_) => memory,
            Self::BusOff(_) => bus_off,
            Self::BrownOutMv(_) => brown_out_mv,
            Self::Oil(_) => oil,
            Self::BootMs(_) => boot_ms,
            Self::AnswerMs(..) => answer_ms,
            Self::CycleMs(_) => cycle_ms,
        }
    }

    /// Returns the word and the value as text.
    #[must_use]
    pub fn text(self) -> (&'static str, Value) {
        (self.word().name, self.value())
    }

    fn value(self) -> Value {
        match self {
            Self::SupplyMv(number) | Self::AngleCdeg(number) | Self::BrownOutMv(Some(number)) => Value::Natural(number),
            Self::BootMs(ms) | Self::CycleMs(ms) => Value::Natural(ms.into()),
            Self::AnswerMs(from, to) if from == to => Value::Natural(to.into()),
            Self::AnswerMs(from, to) => Value::Range(from, to),
            Self::TemperatureC(number) | Self::Lever(Some(number)) => Value::Integer(number.into()),
            Self::SpeedRpm(speed) => Value::Integer(speed),
            Self::Lever(None) | Self::BrownOutMv(None) => Value::Word(OFF),
            Self::Spool(fault) => {
                let known = SPOOL_WORDS.iter().zip(SPOOL_FAULTS).find(|(_, known)| *known == fault);
                Value::Word(known.map_or("", |(name, _)| name))
            }
            Self::MeasuringError(on) | Self::InternalFault(on) | Self::BusOff(on) | Self::Oil(on) => {
                Value::Word(if on { ON } else { OFF })
            }
            Self::MemoryFails(fails) => Value::Word(if fails { WRITE_FAILS } else { OK }),
        }
    }

    /// Applies the change to the inputs of a device. Changes of the memory fault, of bus-off and of words that only the
    /// simulator has are ignored, because the platform executes them.
    ///
    /// # Errors Returns [`Inapplicable`], and changes nothing, for a word of another product or a value out of range.
    pub fn apply(self, inputs: &mut Inputs, now: Instant) -> Result<(), Inapplicable> {
        use ProductInputs::{Encoder, Valve};
        let word = self.word();
        if word.product.is_some_and(|product| product != (&inputs.product).into()) {
            return Err(Inapplicable::OtherProduct);
        }
        if !word.values.contain(self.value()) {
            return Err(Inapplicable::OutOfRange);
        }
        match (self, &mut inputs.product) {
            (Self::SupplyMv(millivolt), Valve(valve)) => valve.supply_mv = millivolt,
            (Self::TemperatureC(celsius), Valve(valve)) => valve.temperature_c = celsius,
            (Self::Spool(fault), Valve(valve)) => valve.spool.fault = fault,
            (Self::Lever(pushed), Valve(valve)) => valve.spool.lever = pushed.and_then(Position::new),
            (Self::AngleCdeg(angle_cdeg), Encoder(shaft)) => *shaft = Shaft { angle_cdeg, since: now, ..*shaft },
            (Self::SpeedRpm(speed_rpm), Encoder(shaft)) => {
                *shaft = Shaft { angle_cdeg: shaft.angle_at(now), speed_rpm, since: now, ..*shaft };
            }
            (Self::MeasuringError(there), Encoder(shaft)) => shaft.measuring_error = there,
            (Self::InternalFault(there), _) => inputs.internal_fault = there,
            // Words of the platform are not inputs. Words of another product were refused above.
            _ => {}
        }
        Ok(())
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (word, value) = self.text();
        write!(f, "{word} {value}")
    }
}

const DECIMAL: u32 = 10;

/// The faults of a spool, in the order of [`SPOOL_WORDS`].
const SPOOL_FAULTS: [SpoolFault; SPOOL_WORDS.len()] =
    [SpoolFault::None, SpoolFault::Stuck, SpoolFault::Slow, SpoolFault::Drifting, SpoolFault::NoFloat];

/// Parses an unsigned number.
#[must_use]
pub fn natural(value: &str, radix: u32) -> Option<u32> {
    u32::from_str_radix(value, radix).ok()
}

fn integer(value: &str) -> Option<i32> {
    match value.strip_prefix('-') {
        Some(signed) if signed.starts_with('+') => None,
        Some(digits) => 0i32.checked_sub_unsigned(natural(digits, DECIMAL)?),
        None => natural(value, DECIMAL)?.try_into().ok(),
    }
}

fn small(value: &str) -> Option<i16> {
    integer(value)?.try_into().ok()
}

fn switch(value: &str) -> Option<bool> {
    match value {
        ON => Some(true),
        OFF => Some(false),
        _ => None,
    }
}
