//! What acts on a device from outside: its plant, by the words and units of the control interface, as a console takes
//! them and tells them; and the faults of a button.

use core::fmt;
use core::ops::RangeInclusive;

use super::{Kind, ProductSenses, Senses};
use crate::actuator::{Position, SpoolFault, ValveSenses};
use crate::encoder::{Shaft, TURN_CDEG};
use crate::time::Instant;

/// The highest supply that can be set, in millivolt (A): far beyond what any monitor tells apart.
pub const SUPPLY_MAX_MV: u32 = 100_000;

/// The temperatures that can be set, in °C (A): far beyond what any monitor tells apart.
pub const TEMPERATURES_C: RangeInclusive<i16> = -273..=1000;

/// What acts on a device. Of the senses all but the error mode of the bus, which is the controller's to tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plant {
    /// What the device senses.
    pub senses: Senses,
    /// Every write to the memory fails.
    pub memory_fails: bool,
    /// The controller is kept off the bus, as in bus-off.
    pub bus_off: bool,
}

/// A change of what acts on a device. Its text is the word and the value that a console takes: `supply_mv 8500`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Valves: the supply, in millivolt, up to [`SUPPLY_MAX_MV`].
    SupplyMv(u32),
    /// Valves: the temperature, in °C, one of [`TEMPERATURES_C`].
    TemperatureC(i16),
    /// Valves: what is wrong with the spool.
    Spool(SpoolFault),
    /// Valves: where the hand lever pushes the spool, −16384…16384; `None`: it is let go.
    Lever(Option<i16>),
    /// Encoders: the angle of the shaft, 0…35999 1/100 degree. A shaft that turns goes on from there.
    AngleCdeg(u32),
    /// Encoders: the speed of the shaft, in turns a minute, positive clockwise. It turns from where it is, to a whole
    /// 1/100 degree.
    SpeedRpm(i32),
    /// Encoders: the sensor unit detects a measuring error.
    MeasuringError(bool),
    /// An internal fault is there, or taken away.
    InternalFault(bool),
    /// Every write to the memory fails, or none.
    MemoryFails(bool),
    /// The CAN controller is kept bus-off, or left to recover.
    BusOff(bool),
}

/// A device cannot be changed so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inapplicable {
    /// Another product has that.
    OtherProduct,
    /// The value cannot be.
    OutOfRange,
}

/// What a word stands at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// A number that is not negative.
    Natural(u32),
    /// A number.
    Integer(i32),
    /// Another word.
    Word(&'static str),
}

impl Plant {
    /// Returns the plant of a healthy device of this kind.
    #[must_use]
    pub fn healthy(kind: Kind) -> Self {
        Self { senses: Senses::healthy(kind), memory_fails: false, bus_off: false }
    }

    /// Changes one thing, at this instant.
    ///
    /// # Errors
    /// [`Inapplicable`]; nothing is changed then.
    pub fn change(&mut self, change: Change, now: Instant) -> Result<(), Inapplicable> {
        match change {
            Change::MemoryFails(fails) => self.memory_fails = fails,
            Change::BusOff(there) => self.bus_off = there,
            change => change.apply(&mut self.senses, now)?,
        }
        Ok(())
    }

    /// Returns the changes that would make any plant of the product this one: one for each of its words.
    pub fn words(&self, now: Instant) -> impl Iterator<Item = Change> + use<> {
        let own = match &self.senses.product {
            ProductSenses::Valve(ValveSenses { supply_mv, temperature_c, spool }) => [
                Some(Change::SupplyMv(*supply_mv)),
                Some(Change::TemperatureC(*temperature_c)),
                Some(Change::Spool(spool.fault)),
                Some(Change::Lever(spool.lever.map(Position::raw))),
            ],
            ProductSenses::Encoder(shaft) => [
                Some(Change::AngleCdeg(shaft.angle_at(now))),
                Some(Change::SpeedRpm(shaft.speed_rpm)),
                Some(Change::MeasuringError(shaft.measuring_error)),
                None,
            ],
        };
        let common = [
            Change::InternalFault(self.senses.internal_fault),
            Change::MemoryFails(self.memory_fails),
            Change::BusOff(self.bus_off),
        ];
        own.into_iter().flatten().chain(common)
    }
}

impl Change {
    /// Reads a word and its value; `None` when they are not understood.
    #[must_use]
    pub fn parse(word: &str, value: &str) -> Option<Self> {
        Some(match word {
            "supply_mv" => Self::SupplyMv(natural(value, DECIMAL)?),
            "temperature_c" => Self::TemperatureC(small(value)?),
            "spool" => Self::Spool(SPOOL_FAULTS.iter().find(|(name, _)| *name == value)?.1),
            "lever" if value == OFF => Self::Lever(None),
            "lever" => Self::Lever(Some(small(value)?)),
            "angle_cdeg" => Self::AngleCdeg(natural(value, DECIMAL)?),
            "speed_rpm" => Self::SpeedRpm(integer(value)?),
            "measuring_error" => Self::MeasuringError(switch(value)?),
            "internal_fault" => Self::InternalFault(switch(value)?),
            "memory" if value == WRITE_FAILS => Self::MemoryFails(true),
            "memory" if value == OK => Self::MemoryFails(false),
            "bus_off" => Self::BusOff(switch(value)?),
            _ => return None,
        })
    }

    /// Returns the word and the value.
    #[must_use]
    pub fn text(self) -> (&'static str, Value) {
        let switch = |on| Value::Word(if on { ON } else { OFF });
        match self {
            Self::SupplyMv(millivolt) => ("supply_mv", Value::Natural(millivolt)),
            Self::TemperatureC(celsius) => ("temperature_c", Value::Integer(celsius.into())),
            Self::Spool(fault) => {
                let known = SPOOL_FAULTS.iter().find(|(_, known)| *known == fault);
                ("spool", Value::Word(known.map_or("", |(name, _)| name)))
            }
            Self::Lever(pushed) => ("lever", pushed.map_or(Value::Word(OFF), |raw| Value::Integer(raw.into()))),
            Self::AngleCdeg(angle) => ("angle_cdeg", Value::Natural(angle)),
            Self::SpeedRpm(speed) => ("speed_rpm", Value::Integer(speed)),
            Self::MeasuringError(there) => ("measuring_error", switch(there)),
            Self::InternalFault(there) => ("internal_fault", switch(there)),
            Self::MemoryFails(fails) => ("memory", Value::Word(if fails { WRITE_FAILS } else { OK })),
            Self::BusOff(there) => ("bus_off", switch(there)),
        }
    }

    /// Changes what a device senses, at this instant. Memory and bus-off are the platform's, and no sense.
    ///
    /// # Errors
    /// [`Inapplicable`]; nothing is changed then.
    pub fn apply(self, senses: &mut Senses, now: Instant) -> Result<(), Inapplicable> {
        use Inapplicable::{OtherProduct, OutOfRange};
        match self {
            Self::SupplyMv(millivolt) => {
                let valve = senses.valve_mut().ok_or(OtherProduct)?;
                valve.supply_mv = Some(millivolt).filter(|millivolt| *millivolt <= SUPPLY_MAX_MV).ok_or(OutOfRange)?;
            }
            Self::TemperatureC(celsius) => {
                let valve = senses.valve_mut().ok_or(OtherProduct)?;
                valve.temperature_c =
                    Some(celsius).filter(|celsius| TEMPERATURES_C.contains(celsius)).ok_or(OutOfRange)?;
            }
            Self::Spool(fault) => senses.valve_mut().ok_or(OtherProduct)?.spool.fault = fault,
            Self::Lever(pushed) => {
                let valve = senses.valve_mut().ok_or(OtherProduct)?;
                valve.spool.lever = pushed.map(|raw| Position::new(raw).ok_or(OutOfRange)).transpose()?;
            }
            Self::AngleCdeg(angle_cdeg) => {
                let shaft = senses.shaft_mut().ok_or(OtherProduct)?;
                if angle_cdeg >= TURN_CDEG {
                    return Err(OutOfRange);
                }
                *shaft = Shaft { angle_cdeg, since: now, ..*shaft };
            }
            Self::SpeedRpm(speed_rpm) => {
                let shaft = senses.shaft_mut().ok_or(OtherProduct)?;
                *shaft = Shaft { angle_cdeg: shaft.angle_at(now), speed_rpm, since: now, ..*shaft };
            }
            Self::MeasuringError(there) => senses.shaft_mut().ok_or(OtherProduct)?.measuring_error = there,
            Self::InternalFault(there) => senses.internal_fault = there,
            Self::MemoryFails(_) | Self::BusOff(_) => {}
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

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Natural(number) => number.fmt(f),
            Self::Integer(number) => number.fmt(f),
            Self::Word(word) => f.write_str(word),
        }
    }
}

const DECIMAL: u32 = 10;

const ON: &str = "on";
const OFF: &str = "off";
const OK: &str = "ok";
const WRITE_FAILS: &str = "write-fails";

const SPOOL_FAULTS: [(&str, SpoolFault); 5] = [
    (OK, SpoolFault::None),
    ("stuck", SpoolFault::Stuck),
    ("slow", SpoolFault::Slow),
    ("drifting", SpoolFault::Drifting),
    ("no-float", SpoolFault::NoFloat),
];

/// Reads a number without a minus sign. The one place for all numbers of a console: each reading takes 100 to 200 bytes
/// of flash.
#[inline(never)]
#[must_use]
pub fn natural(value: &str, radix: u32) -> Option<u32> {
    u32::from_str_radix(value, radix).ok()
}

#[inline(never)]
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

/// The faults that the button goes through, one a press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Injection {
    /// A healthy device.
    #[default]
    None,
    /// Valves: supply under 9 V.
    SupplyLow,
    /// Valves: supply over 36 V.
    SupplyHigh,
    /// Valves: hotter than 120 °C.
    Temperature,
    /// Valves: the spool is stuck.
    SpoolStuck,
    /// Encoders: a measuring error.
    MeasuringError,
    /// An internal fault.
    Internal,
}

impl Injection {
    /// Returns the one that the next press brings to the product of these senses.
    #[must_use]
    pub const fn next(self, product: &ProductSenses) -> Self {
        match (self, product) {
            (Self::None, ProductSenses::Valve(_)) => Self::SupplyLow,
            (Self::None, ProductSenses::Encoder(_)) => Self::MeasuringError,
            (Self::SupplyLow, _) => Self::SupplyHigh,
            (Self::SupplyHigh, _) => Self::Temperature,
            (Self::Temperature, _) => Self::SpoolStuck,
            (Self::SpoolStuck | Self::MeasuringError, _) => Self::Internal,
            (Self::Internal, _) => Self::None,
        }
    }

    /// Returns the plant with this fault in the place of the ones that the button can bring; the rest stays.
    #[must_use]
    pub fn applied_to(self, plant: Plant) -> Plant {
        let mut senses = Senses { internal_fault: self == Self::Internal, ..plant.senses };
        match &mut senses.product {
            ProductSenses::Valve(valve) => {
                let ValveSenses { supply_mv, temperature_c, .. } = ValveSenses::default();
                *valve = ValveSenses { supply_mv, temperature_c, ..*valve };
                valve.spool.fault = SpoolFault::None;
                match self {
                    Self::SupplyLow => valve.supply_mv = 8_500,
                    Self::SupplyHigh => valve.supply_mv = 37_000,
                    Self::Temperature => valve.temperature_c = 130,
                    Self::SpoolStuck => valve.spool.fault = SpoolFault::Stuck,
                    Self::None | Self::MeasuringError | Self::Internal => {}
                }
            }
            ProductSenses::Encoder(shaft) => shaft.measuring_error = self == Self::MeasuringError,
        }
        Plant { senses, ..plant }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::{String, ToString as _};
    use std::vec::Vec;

    use super::*;
    use crate::device::{hat, pve};

    const VALVE: Kind = Kind::Pve(pve::Kind::PveaCanopen);
    const SENSOR: Kind = Kind::Hat(hat::Kind::Hat3000);
    const NOW: Instant = Instant::from_secs(7);

    /// Types lines at a healthy device.
    fn after(kind: Kind, lines: &[&str]) -> Plant {
        let mut plant = Plant::healthy(kind);
        for line in lines {
            assert_eq!(plant.change(parse(line).expect(line), NOW), Ok(()), "{line}");
        }
        plant
    }

    fn parse(line: &str) -> Option<Change> {
        let (word, value) = line.split_once(' ').expect(line);
        Change::parse(word, value)
    }

    fn told(plant: &Plant, now: Instant) -> Vec<String> {
        plant.words(now).map(|change| change.to_string()).collect()
    }

    #[test]
    fn every_word_of_a_valve() {
        let typed = [
            "supply_mv 8500",
            "temperature_c -41",
            "spool no-float",
            "lever -4000",
            "internal_fault on",
            "memory write-fails",
            "bus_off on",
        ];
        let plant = after(VALVE, &typed);
        let valve = plant.senses.valve().unwrap();
        assert_eq!((valve.supply_mv, valve.temperature_c), (8500, -41));
        assert_eq!((valve.spool.fault, valve.spool.lever), (SpoolFault::NoFloat, Position::new(-4000)));
        assert!(plant.senses.internal_fault && plant.memory_fails && plant.bus_off);
        assert_eq!(told(&plant, NOW), typed, "every word stands at what was typed");
        let healthy = [
            "supply_mv 24000",
            "temperature_c 25",
            "spool ok",
            "lever off",
            "internal_fault off",
            "memory ok",
            "bus_off off",
        ];
        assert_eq!(told(&Plant::healthy(VALVE), NOW), healthy);
        for line in healthy {
            assert_eq!(plant.words(NOW).count(), 7);
            assert_eq!(after(VALVE, &[line]), Plant::healthy(VALVE), "{line}");
        }
    }

    #[test]
    fn every_word_of_an_angle_sensor() {
        let typed = [
            "angle_cdeg 35999",
            "speed_rpm -33",
            "measuring_error on",
            "internal_fault on",
            "memory write-fails",
            "bus_off on",
        ];
        let plant = after(SENSOR, &typed);
        let shaft = Shaft { angle_cdeg: 35_999, speed_rpm: -33, since: NOW, measuring_error: true };
        assert_eq!(plant.senses.shaft(), Some(&shaft));
        assert!(plant.senses.internal_fault && plant.memory_fails && plant.bus_off);
        assert_eq!(told(&plant, NOW), typed, "every word stands at what was typed");
        let healthy =
            ["angle_cdeg 0", "speed_rpm 0", "measuring_error off", "internal_fault off", "memory ok", "bus_off off"];
        assert_eq!(told(&Plant::healthy(SENSOR), NOW), healthy);
    }

    #[test]
    fn a_shaft_turns_by_itself_and_goes_on_from_a_new_angle() {
        let mut plant = after(SENSOR, &["angle_cdeg 9000", "speed_rpm 60"]);
        let at = |ms: u64| Instant::from_millis(7_000 + ms);
        assert_eq!(told(&plant, at(250))[..2], ["angle_cdeg 18000", "speed_rpm 60"]);
        plant.change(Change::SpeedRpm(-60), at(250)).unwrap();
        assert_eq!(told(&plant, at(500))[0], "angle_cdeg 9000");
        plant.change(Change::AngleCdeg(100), at(500)).unwrap();
        assert_eq!(told(&plant, at(750))[0], "angle_cdeg 27100");
    }

    #[test]
    fn a_word_of_the_other_product_is_told_from_a_value_that_there_is_not() {
        for (kind, lines) in [
            (VALVE, &["angle_cdeg 1", "speed_rpm 1", "measuring_error on", "angle_cdeg 36000"][..]),
            (SENSOR, &["supply_mv 1", "temperature_c 1", "spool ok", "lever off", "lever 16385"]),
        ] {
            for line in lines {
                let mut plant = Plant::healthy(kind);
                assert_eq!(plant.change(parse(line).unwrap(), NOW), Err(Inapplicable::OtherProduct), "{line}");
                assert_eq!(plant, Plant::healthy(kind));
            }
        }
        for (kind, line) in [
            (VALVE, "supply_mv 100001"),
            (VALVE, "temperature_c 1001"),
            (VALVE, "temperature_c -274"),
            (VALVE, "lever 16385"),
            (VALVE, "lever -16385"),
            (SENSOR, "angle_cdeg 36000"),
        ] {
            let mut plant = Plant::healthy(kind);
            assert_eq!(plant.change(parse(line).unwrap(), NOW), Err(Inapplicable::OutOfRange), "{line}");
            assert_eq!(plant, Plant::healthy(kind));
        }
    }

    #[test]
    fn what_is_no_word_or_no_value_is_not_understood() {
        for line in [
            "supply_mv x",
            "supply_mv -1",
            "temperature_c 40000",
            "spool bent",
            "lever 40000",
            "angle_cdeg -1",
            "angle_cdeg 90.0",
            "speed_rpm 2147483648",
            "speed_rpm -2147483649",
            "speed_rpm -+5",
            "speed_rpm --5",
            "speed_rpm -",
            "measuring_error 1",
            "internal_fault 1",
            "memory on",
            "bus_off true",
            "angle 1",
        ] {
            assert_eq!(parse(line), None, "{line}");
        }
    }

    #[test]
    fn the_button_goes_round_and_leaves_the_rest_alone() {
        for (kind, line, presses) in [(VALVE, "lever 4000", 6), (SENSOR, "speed_rpm 7", 3)] {
            let start = after(kind, &[line]);
            let (mut plant, mut injection, mut seen) = (start, Injection::None, Vec::new());
            for _ in 0..presses {
                injection = injection.next(&plant.senses.product);
                plant = injection.applied_to(plant);
                assert!(told(&plant, NOW).iter().any(|told| told == line), "{injection:?}");
                assert!(!seen.contains(&plant), "{injection:?}");
                seen.push(plant);
            }
            assert_eq!((injection, plant), (Injection::None, start), "the fault of the press before is taken away");
        }
    }
}
