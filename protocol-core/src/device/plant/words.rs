//! The table of plant words, for consoles, control interface, scenarios, panel and pages.
//! [`Change::word`](super::Change::word) returns the entry of a change.

use core::fmt;

use super::Plant;
use crate::actuator::Position;
use crate::device::{Kind, ProductInputs, hat, pve};
use crate::encoder::TURN_CDEG;
use crate::time::Instant;
use crate::wire::decimal::decimal;

/// The highest supply voltage that can be set, in millivolts (A). It is far above all monitor limits.
const SUPPLY_MAX_MV: i32 = 100_000;
/// The lowest temperature that can be set, in °C (A). It is far below all monitor limits.
const TEMPERATURE_MIN_C: i32 = -273;
/// The highest temperature that can be set, in °C (A). It is far above all monitor limits.
const TEMPERATURE_MAX_C: i32 = 1000;

/// The longest start delay and the longest answer delay that can be set, in milliseconds (A).
const DELAY_MAX_MS: i32 = 60_000;
/// The longest cycle of a program that can be set, in milliseconds (A).
const CYCLE_MAX_MS: i32 = 1000;

pub(super) const SUPPLY_MV: &str = "supply_mv";
pub(super) const TEMPERATURE_C: &str = "temperature_c";
pub(super) const SPOOL: &str = "spool";
pub(super) const LEVER: &str = "lever";
pub(super) const ANGLE_CDEG: &str = "angle_cdeg";
pub(super) const SPEED_RPM: &str = "speed_rpm";
pub(super) const MEASURING_ERROR: &str = "measuring_error";
pub(super) const INTERNAL_FAULT: &str = "internal_fault";
pub(super) const MEMORY: &str = "memory";
pub(super) const BUS_OFF: &str = "bus_off";
pub(super) const BROWN_OUT_MV: &str = "brown_out_mv";
pub(super) const OIL: &str = "oil";
pub(super) const BOOT_MS: &str = "boot_ms";
pub(super) const ANSWER_MS: &str = "answer_ms";
pub(super) const CYCLE_MS: &str = "cycle_ms";

pub(super) const ON: &str = "on";
pub(super) const OFF: &str = "off";
pub(super) const OK: &str = "ok";
pub(super) const WRITE_FAILS: &str = "write-fails";
/// The words of the spool faults, in the order of `SPOOL_FAULTS`.
pub(super) const SPOOL_WORDS: [&str; 5] = [OK, "stuck", "slow", "drifting", "no-float"];

const SWITCH: Values = Values::Words(&[ON, OFF]);

/// The words of the plant, grouped by product, in the order in which consoles print them. Words that only the simulator
/// has come last.
pub static WORDS: [Word; 15] = [
    Word {
        name: SUPPLY_MV,
        values: Values::Number { min: 0, max: SUPPLY_MAX_MV, unit: "mV" },
        help: "supply voltage",
        product: Some(Product::Valve),
        simulated: false,
    },
    Word {
        name: TEMPERATURE_C,
        values: Values::Number { min: TEMPERATURE_MIN_C, max: TEMPERATURE_MAX_C, unit: "°C" },
        help: "temperature",
        product: Some(Product::Valve),
        simulated: false,
    },
    Word {
        name: SPOOL,
        values: Values::Words(&SPOOL_WORDS),
        help: "fault of the spool",
        product: Some(Product::Valve),
        simulated: false,
    },
    Word {
        name: LEVER,
        values: Values::NumberOrOff { min: Position::MIN.raw() as i32, max: Position::MAX.raw() as i32 },
        help: "position to which the hand lever pushes the spool; 16384 is 100 %",
        product: Some(Product::Valve),
        simulated: false,
    },
    Word {
        name: ANGLE_CDEG,
        values: Values::Number { min: 0, max: TURN_CDEG as i32 - 1, unit: "1/100 degree" },
        help: "angle of the shaft",
        product: Some(Product::Encoder),
        simulated: false,
    },
    Word {
        name: SPEED_RPM,
        values: Values::Number { min: i32::MIN, max: i32::MAX, unit: "turns a minute" },
        help: "speed of the shaft; positive values are clockwise",
        product: Some(Product::Encoder),
        simulated: false,
    },
    Word {
        name: MEASURING_ERROR,
        values: SWITCH,
        help: "measuring error",
        product: Some(Product::Encoder),
        simulated: false,
    },
    Word { name: INTERNAL_FAULT, values: SWITCH, help: "internal fault", product: None, simulated: false },
    Word {
        name: MEMORY,
        values: Values::Words(&[OK, WRITE_FAILS]),
        help: "result of memory writes",
        product: None,
        simulated: false,
    },
    Word { name: BUS_OFF, values: SWITCH, help: "holds the controller bus-off", product: None, simulated: false },
    Word {
        name: BROWN_OUT_MV,
        values: Values::NumberOrOff { min: 1, max: SUPPLY_MAX_MV },
        help: "supply in mV below which the valve is off",
        product: Some(Product::Valve),
        simulated: true,
    },
    Word {
        name: OIL,
        values: SWITCH,
        help: "cold oil slows the spool down",
        product: Some(Product::Valve),
        simulated: true,
    },
    Word {
        name: BOOT_MS,
        values: Values::Number { min: 0, max: DELAY_MAX_MS, unit: "ms" },
        help: "time from power-up to the start of the program",
        product: None,
        simulated: true,
    },
    Word {
        name: ANSWER_MS,
        values: Values::NumberOrRange { min: 0, max: DELAY_MAX_MS, unit: "ms" },
        help: "answer delay",
        product: None,
        simulated: true,
    },
    Word {
        name: CYCLE_MS,
        values: Values::Number { min: 0, max: CYCLE_MAX_MS, unit: "ms" },
        help: "cycle time of the program",
        product: None,
        simulated: true,
    },
];

/// A word of the plant. It is printed with its values in short form: `lever N|off`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word {
    /// The word. It is also the key in JSON and TOML.
    pub name: &'static str,
    /// The permitted values.
    pub values: Values,
    /// The description in a help line.
    pub help: &'static str,
    /// The product that has the word; `None` for all products.
    pub product: Option<Product>,
    /// Whether only the simulator has the word.
    pub simulated: bool,
}

/// The permitted values of a word. They are printed as a list: `0 to 100000 mV`, `on, off`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// An integer.
    Number {
        /// The minimum.
        min: i32,
        /// The maximum.
        max: i32,
        /// The unit.
        unit: &'static str,
    },
    /// An integer without a unit, or `off`.
    NumberOrOff {
        /// The minimum.
        min: i32,
        /// The maximum.
        max: i32,
    },
    /// An integer, or a range of integers with the smaller first: `5..20`.
    NumberOrRange {
        /// The minimum.
        min: i32,
        /// The maximum.
        max: i32,
        /// The unit.
        unit: &'static str,
    },
    /// One of these words.
    Words(&'static [&'static str]),
}

/// The value of a plant word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// An unsigned number.
    Natural(u32),
    /// A signed number.
    Integer(i32),
    /// A range of numbers.
    Range(u16, u16),
    /// A word such as `off`.
    Word(&'static str),
}

/// The products that the plant distinguishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {
    /// A valve.
    Valve,
    /// An angle sensor.
    Encoder,
}

impl Product {
    /// Returns the words of this product, in the order of [`WORDS`].
    pub fn words(self) -> impl Iterator<Item = &'static Word> {
        WORDS.iter().filter(move |word| word.product.is_none_or(|product| product == self))
    }

    /// Returns the words of this product that a board has, in the order of [`WORDS`].
    pub fn words_of_board(self) -> impl Iterator<Item = &'static Word> {
        self.words().filter(|word| !word.simulated)
    }
}

impl From<&ProductInputs> for Product {
    fn from(inputs: &ProductInputs) -> Self {
        match inputs {
            ProductInputs::Valve(_) => Self::Valve,
            ProductInputs::Encoder(_) => Self::Encoder,
        }
    }
}

impl Word {
    /// Returns the value of the word in a healthy device.
    #[must_use]
    pub fn healthy(&self) -> Option<Value> {
        let kind = match self.product {
            Some(Product::Valve) | None => Kind::Pve(pve::Kind::PveaCanopen),
            Some(Product::Encoder) => Kind::Hat(hat::Kind::Hat1000),
        };
        if self.simulated {
            return Some(match self.values {
                Values::Number { .. } | Values::NumberOrRange { .. } => Value::Natural(0),
                Values::NumberOrOff { .. } | Values::Words(_) => Value::Word(OFF),
            });
        }
        let mut words = Plant::healthy(kind).words(Instant::MIN);
        words.find_map(|change| Some(change.text()).filter(|(name, _)| *name == self.name)).map(|(_, value)| value)
    }

    /// Writes a help line to `put` in parts: the word, its description at `column`, and its values.
    pub fn tell(&self, column: usize, put: &mut dyn FnMut(&str)) {
        put(self.name);
        (self.name.len()..column).for_each(|_| put(" "));
        put(self.help);
        put(": ");
        self.values.tell(put);
    }
}

impl Values {
    /// Returns whether a value is permitted.
    #[must_use]
    pub fn contain(&self, value: Value) -> bool {
        let number = match value {
            Value::Natural(number) => i32::try_from(number).ok(),
            Value::Integer(number) => Some(number),
            Value::Range(from, to) => {
                let is_in_order = matches!(self, Self::NumberOrRange { .. }) && from <= to;
                Some(i32::from(to)).filter(|_| is_in_order)
            }
            Value::Word(word) => {
                return match self {
                    Self::Number { .. } | Self::NumberOrRange { .. } => false,
                    Self::NumberOrOff { .. } => word == OFF,
                    Self::Words(words) => words.contains(&word),
                };
            }
        };
        self.range().zip(number).is_some_and(|((min, max), number)| (min..=max).contains(&number))
    }

    /// Returns the minimum and maximum of the numbers; `None` for words only.
    #[must_use]
    pub const fn range(&self) -> Option<(i32, i32)> {
        match *self {
            Self::Number { min, max, .. } | Self::NumberOrRange { min, max, .. } | Self::NumberOrOff { min, max } => {
                Some((min, max))
            }
            Self::Words(_) => None,
        }
    }

    /// Writes the list of values to `put` in parts, because formatting code would not fit into the firmware.
    fn tell(&self, put: &mut dyn FnMut(&str)) {
        if let Some((min, max)) = self.range() {
            tell_number(min, put);
            put(" to ");
            tell_number(max, put);
        }
        match self {
            Self::Number { unit, .. } => {
                put(" ");
                put(unit);
            }
            Self::NumberOrRange { unit, .. } => {
                put(" ");
                put(unit);
                put(", or a range as in 5..20");
            }
            Self::NumberOrOff { .. } => put(", or off"),
            Self::Words(words) => tell_words(words, ", ", put),
        }
    }
}

fn tell_number(number: i32, put: &mut dyn FnMut(&str)) {
    if number < 0 {
        put("-");
    }
    // `from_utf8` would take 450 bytes of flash.
    for digit in decimal(number.unsigned_abs()) {
        put(char::from(digit).encode_utf8(&mut [0; 4]));
    }
}

fn tell_words(words: &[&str], between: &str, put: &mut dyn FnMut(&str)) {
    let mut first = true;
    for word in words {
        if !core::mem::take(&mut first) {
            put(between);
        }
        put(word);
    }
}

impl fmt::Display for Word {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ", self.name)?;
        match self.values {
            Values::Number { .. } => f.write_str("N"),
            Values::NumberOrOff { .. } => f.write_str("N|off"),
            Values::NumberOrRange { .. } => f.write_str("N|N..N"),
            Values::Words(words) => all_of(f, |put| tell_words(words, "|", put)),
        }
    }
}

impl fmt::Display for Values {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        all_of(f, |put| self.tell(put))
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Natural(number) => number.fmt(f),
            Self::Integer(number) => number.fmt(f),
            Self::Range(from, to) => write!(f, "{from}..{to}"),
            Self::Word(word) => f.write_str(word),
        }
    }
}

fn all_of(f: &mut fmt::Formatter<'_>, tell: impl FnOnce(&mut dyn FnMut(&str))) -> fmt::Result {
    let mut told = Ok(());
    tell(&mut |part| told = told.and_then(|()| f.write_str(part)));
    told
}
