//! What acts on a device that has no valve: its plant, by the words of a console, and by the button of a board.

use super::Senses;
use crate::actuator::{Position, SpoolFault, ValveSenses};

/// The plant. Of the senses all but the error mode of the bus, which is the controller's to tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Plant {
    /// What the device senses.
    pub senses: Senses,
    /// Every write to the memory fails.
    pub memory_fails: bool,
    /// The controller is kept off the bus, as in bus-off.
    pub bus_off: bool,
}

impl Plant {
    /// The plant with one thing changed: a word and its value, as the control interface of the simulator names them.
    /// `None` when they are not understood.
    #[must_use]
    pub fn with(mut self, word: &str, value: &str) -> Option<Self> {
        let senses = &mut self.senses;
        match word {
            "supply_mv" => senses.valve_mut()?.supply_mv = value.parse().ok()?,
            "temperature_c" => senses.valve_mut()?.temperature_c = value.parse().ok()?,
            "spool" => senses.valve_mut()?.spool.fault = spool_fault(value)?,
            "lever" if value == "off" => senses.valve_mut()?.spool.lever = None,
            "lever" => senses.valve_mut()?.spool.lever = Some(Position::new(value.parse().ok()?)?),
            "internal_fault" => senses.internal_fault = switch(value)?,
            "memory" => {
                self.memory_fails = match value {
                    "ok" => false,
                    "write-fails" => true,
                    _ => return None,
                }
            }
            "bus_off" => self.bus_off = switch(value)?,
            _ => return None,
        }
        Some(self)
    }
}

/// What a word stands at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// A number.
    Number(i32),
    /// Another word.
    Word(&'static str),
}

impl Plant {
    /// Every word with the value that it stands at, as both can be typed.
    #[must_use]
    pub fn words(&self) -> [(&'static str, Value); 7] {
        let switch = |on| Value::Word(if on { "on" } else { "off" });
        let Self { senses, memory_fails, bus_off } = self;
        let ValveSenses { supply_mv, temperature_c, spool } = senses.valve().copied().unwrap_or_default();
        let lever = spool.lever.map_or(Value::Word("off"), |lever| Value::Number(lever.raw().into()));
        let spool = SPOOL_FAULTS.iter().find(|(_, fault)| *fault == spool.fault).map_or("", |(name, _)| name);
        [
            ("supply_mv", Value::Number(i32::try_from(supply_mv).unwrap_or(i32::MAX))),
            ("temperature_c", Value::Number(temperature_c.into())),
            ("spool", Value::Word(spool)),
            ("lever", lever),
            ("internal_fault", switch(senses.internal_fault)),
            ("memory", Value::Word(if *memory_fails { "write-fails" } else { "ok" })),
            ("bus_off", switch(*bus_off)),
        ]
    }
}

const SPOOL_FAULTS: [(&str, SpoolFault); 5] = [
    ("ok", SpoolFault::None),
    ("stuck", SpoolFault::Stuck),
    ("slow", SpoolFault::Slow),
    ("drifting", SpoolFault::Drifting),
    ("no-float", SpoolFault::NoFloat),
];

fn spool_fault(value: &str) -> Option<SpoolFault> {
    SPOOL_FAULTS.iter().find(|(name, _)| *name == value).map(|(_, fault)| *fault)
}

fn switch(value: &str) -> Option<bool> {
    match value {
        "on" => Some(true),
        "off" => Some(false),
        _ => None,
    }
}

/// The faults that the button goes through, one a press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Injection {
    /// A healthy valve.
    #[default]
    None,
    /// Supply under 9 V.
    SupplyLow,
    /// Supply over 36 V.
    SupplyHigh,
    /// Hotter than 120 °C.
    Temperature,
    /// The spool is stuck.
    SpoolStuck,
    /// An internal fault.
    Internal,
}

impl Injection {
    /// The one that the next press brings.
    #[must_use]
    pub const fn next(self) -> Self {
        match self {
            Self::None => Self::SupplyLow,
            Self::SupplyLow => Self::SupplyHigh,
            Self::SupplyHigh => Self::Temperature,
            Self::Temperature => Self::SpoolStuck,
            Self::SpoolStuck => Self::Internal,
            Self::Internal => Self::None,
        }
    }

    /// The plant with this fault in the place of the ones that the button can bring; the rest stays.
    #[must_use]
    pub fn applied_to(self, plant: Plant) -> Plant {
        let mut senses = Senses { internal_fault: self == Self::Internal, ..plant.senses };
        if let Some(valve) = senses.valve_mut() {
            let ValveSenses { supply_mv, temperature_c, .. } = ValveSenses::default();
            *valve = ValveSenses { supply_mv, temperature_c, ..*valve };
            valve.spool.fault = SpoolFault::None;
            match self {
                Self::SupplyLow => valve.supply_mv = 8_500,
                Self::SupplyHigh => valve.supply_mv = 37_000,
                Self::Temperature => valve.temperature_c = 130,
                Self::SpoolStuck => valve.spool.fault = SpoolFault::Stuck,
                Self::None | Self::Internal => {}
            }
        }
        Plant { senses, ..plant }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString as _;

    use super::*;

    fn after(word: &str, value: &str) -> Option<Plant> {
        Plant::default().with(word, value)
    }

    #[test]
    fn every_word() {
        assert_eq!(after("supply_mv", "8500").unwrap().senses.valve().unwrap().supply_mv, 8500);
        assert_eq!(after("temperature_c", "-41").unwrap().senses.valve().unwrap().temperature_c, -41);
        assert_eq!(after("spool", "no-float").unwrap().senses.valve().unwrap().spool.fault, SpoolFault::NoFloat);
        assert_eq!(after("lever", "-4000").unwrap().senses.valve().unwrap().spool.lever, Position::new(-4000));
        assert_eq!(
            after("lever", "0").unwrap().with("lever", "off").unwrap().senses.valve().unwrap().spool.lever,
            None
        );
        assert!(after("internal_fault", "on").unwrap().senses.internal_fault);
        assert!(after("memory", "write-fails").unwrap().memory_fails);
        assert!(after("bus_off", "on").unwrap().bus_off);
    }

    #[test]
    fn every_word_stands_at_what_was_typed() {
        let typed = [
            ("supply_mv", "8500"),
            ("temperature_c", "-41"),
            ("spool", "stuck"),
            ("lever", "-4000"),
            ("internal_fault", "on"),
            ("memory", "write-fails"),
            ("bus_off", "on"),
        ];
        let plant = typed.iter().try_fold(Plant::default(), |plant, (word, value)| plant.with(word, value)).unwrap();
        for (told, typed) in plant.words().into_iter().zip(typed) {
            let value = match told.1 {
                Value::Number(number) => number.to_string(),
                Value::Word(word) => word.to_string(),
            };
            assert_eq!((told.0, value.as_str()), typed);
        }
        assert_eq!(Plant::default().words()[3], ("lever", Value::Word("off")));
    }

    #[test]
    fn a_value_that_there_is_not() {
        for (word, value) in [
            ("supply_mv", "x"),
            ("supply_mv", "-1"),
            ("temperature_c", "40000"),
            ("spool", "bent"),
            ("lever", "16385"),
            ("internal_fault", "1"),
            ("memory", "on"),
            ("bus_off", "true"),
            ("angle_cdeg", "1"),
        ] {
            assert_eq!(after(word, value), None, "{word} {value}");
        }
    }

    #[test]
    fn the_button_goes_round_and_leaves_the_rest_alone() {
        let lever = after("lever", "4000").unwrap();
        let mut injection = Injection::None;
        let mut seen = heapless::Vec::<Plant, 8>::new();
        loop {
            injection = injection.next();
            let plant = injection.applied_to(seen.last().copied().unwrap_or(lever));
            assert_eq!(plant.senses.valve().unwrap().spool.lever, lever.senses.valve().unwrap().spool.lever);
            assert!(!seen.contains(&plant), "{injection:?}");
            seen.push(plant).unwrap();
            if injection == Injection::None {
                break;
            }
        }
        assert_eq!(seen.len(), 6);
        assert_eq!(seen.last(), Some(&lever), "the fault of the press before is taken away");
    }
}
