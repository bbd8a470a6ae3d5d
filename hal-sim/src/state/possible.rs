//! The possible values of each key of a device state, by kind, with and without power (SPEC 1, 2, 4.3, 5, 9). A
//! condition that requires any other value can never hold.

use std::ops::RangeInclusive;

use protocol_core::controller::BitRate;
use protocol_core::device::Protocol;
use protocol_core::device::pve::DeviceState as Dsm;
use protocol_core::encoder::POSITION_MAX;
use protocol_core::wire::{nmt, valve};
use serde::Serialize;
use serde_json::{Value as Json, json};

use super::device::{Color, Command, DeviceStateMachine, FloatWord, Led, Nmt};
use crate::Kind;

/// The position range of a spool from full stroke to full stroke (SPEC 2).
const STROKE: RangeInclusive<i64> = -16384..=16384;

/// The range of object 0x6004 of an angle sensor (SPEC 9).
const TURN: RangeInclusive<i64> = 0..=POSITION_MAX as i64;

/// All LED states of a powered valve (SPEC 2).
const LEDS: [Led; 5] = [
    Led { color: Color::Green, flashing: false },
    Led { color: Color::Green, flashing: true },
    Led { color: Color::Yellow, flashing: false },
    Led { color: Color::Red, flashing: false },
    Led { color: Color::Red, flashing: true },
];

/// A set of possible values of a key.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    /// Whole numbers.
    Numbers(RangeInclusive<i64>),
    /// A single value that is not a number: a word, a Boolean, null, or an LED.
    One(Json),
    /// Any subset of these names.
    Sets(Vec<&'static str>),
}

/// The share of the possible values that satisfy a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Share {
    None,
    Some,
    All,
}

/// The keys of a state with their possible values, in the order of [`DeviceState`](super::DeviceState).
type Table = [(&'static str, Vec<Values>); 14];

/// Returns the possible values of each key, for a device of this kind and name, with or without power.
pub(crate) fn table(kind: Kind, name: &str, powered: bool) -> Table {
    let is_valve = matches!(kind, Kind::Pve(_));
    let is_canopen = kind.protocol() == Protocol::Canopen;
    let (first, last) = kind.node_ids().into_inner();
    let faults = if powered { kind.fault_names().iter().copied().collect() } else { Vec::new() };
    // The values are possible only if the device is powered and has the key; otherwise the key is null.
    let shown = |has: bool, values: Vec<Values>| if has && powered { values } else { null() };
    [
        ("t_us", vec![Values::Numbers(0..=i64::MAX)]),
        ("name", one(name)),
        ("kind", one(kind.name())),
        // A device has no node ID if it is blank or has lost its address.
        ("node_id", shown(true, [numbers(first.into()..=last.into()), null()].concat())),
        ("bit_rate", shown(true, bit_rates(kind))),
        ("powered", one(powered)),
        ("nmt", shown(is_canopen, words(&nmt::State::ALL.map(Nmt::from)))),
        ("dsm", shown(is_canopen && is_valve, words(&Dsm::ALL.map(DeviceStateMachine::from)))),
        ("command", shown(!is_canopen, words(&valve::State::ALL.map(Command::from)))),
        ("set_point", shown(is_valve, [numbers(STROKE), words(&[FloatWord::Float])].concat())),
        ("position", if is_valve { numbers(if powered { STROKE } else { 0..=0 }) } else { shown(true, numbers(TURN)) }),
        ("solenoids", if is_valve { words(if powered { &[false, true] } else { &[false] }) } else { null() }),
        ("led", if is_valve { words(if powered { &LEDS } else { &[Led::OFF] }) } else { null() }),
        ("faults", vec![Values::Sets(faults)]),
    ]
}

fn null() -> Vec<Values> {
    one(Json::Null)
}

fn one(value: impl Into<Json>) -> Vec<Values> {
    vec![Values::One(value.into())]
}

fn numbers(range: RangeInclusive<i64>) -> Vec<Values> {
    vec![Values::Numbers(range)]
}

fn words<T: Serialize>(words: &[T]) -> Vec<Values> {
    words.iter().map(|word| Values::One(json!(word))).collect()
}

fn bit_rates(kind: Kind) -> Vec<Values> {
    let mut rates: Vec<i64> = kind.bit_rates().iter().copied().map(BitRate::bits_per_second).map(i64::from).collect();
    rates.sort_unstable();
    rates.into_iter().map(|rate| Values::Numbers(rate..=rate)).collect()
}

/// Refuses a value that a device of this kind and name never has, and values that never occur together. `none` is the
/// word for null in messages.
///
/// # Errors
/// A message with the key, its value, and its possible values.
pub(super) fn check(wanted: &[(String, Json)], kind: Kind, name: &str, none: &str) -> Result<(), String> {
    let [on, off] = [true, false].map(|powered| table(kind, name, powered));
    let (mut needs_on, mut needs_off) = (None, None);
    for (key, value) in wanted {
        if let Some(bounds) = bounds(value).filter(RangeInclusive::is_empty) {
            let (min, max) = bounds.into_inner();
            return Err(format!("{key}: min {min} is above max {max}"));
        }
        if value.as_object().is_some_and(serde_json::Map::is_empty) {
            let accepted = if key == "led" { "color, flashing" } else { "min, max" };
            return Err(format!("{key}: the condition is empty; give {accepted}, or both"));
        }
        match (share(&on, key, value), share(&off, key, value)) {
            (Share::None, Share::None) => {
                let (value, accepted) = (word(value, none), accepted(key, kind, name, none));
                return Err(format!("{key} is never {value} on {name}; accepted: {accepted}"));
            }
            (Share::None, _) => needs_off = needs_off.or(Some(key)),
            (_, Share::None) => needs_on = needs_on.or(Some(key)),
            _ => {}
        }
    }
    match (needs_on, needs_off) {
        (Some(on), Some(off)) => {
            Err(format!("{on} and {off} never hold together on {name}: {off} occurs only without power"))
        }
        _ => Ok(()),
    }
}

/// Returns whether every state of a device of this kind and name satisfies the condition.
pub(super) fn is_always_so(wanted: &[(String, Json)], kind: Kind, name: &str) -> bool {
    let tables = [true, false].map(|powered| table(kind, name, powered));
    wanted.iter().all(|(key, value)| tables.iter().all(|table| share(table, key, value) == Share::All))
}

/// Describes the possible values of a key for a device of this kind and name. `none` is the word for null in the text.
fn accepted(key: &str, kind: Kind, name: &str, none: &str) -> String {
    let mut accepted: Vec<Values> = Vec::new();
    for powered in [true, false] {
        for (_, values) in table(kind, name, powered).into_iter().filter(|(known, _)| *known == key) {
            for value in values {
                if !accepted.iter().any(|known| known.include(&value)) {
                    accepted.push(value);
                }
            }
        }
    }
    accepted.iter().map(|values| values.words(none)).collect::<Vec<_>>().join(", ")
}

fn share(table: &Table, key: &str, wanted: &Json) -> Share {
    let values = table.iter().find(|(known, _)| *known == key).map_or(&[][..], |(_, values)| values);
    let mut shares = values.iter().map(|values| values.share(wanted));
    let first = shares.next().unwrap_or(Share::None);
    shares.fold(first, |sum, share| if sum == share { sum } else { Share::Some })
}

impl Values {
    fn share(&self, wanted: &Json) -> Share {
        match (self, bounds(wanted)) {
            (Self::Numbers(range), Some(bounds)) => {
                let (first, last) = (range.start().max(bounds.start()), range.end().min(bounds.end()));
                match (first..=last).is_empty() {
                    true => Share::None,
                    false if first == range.start() && last == range.end() => Share::All,
                    false => Share::Some,
                }
            }
            (Self::Numbers(_), None) => Share::None,
            (Self::One(value), _) if is_part(wanted, value) => Share::All,
            (Self::One(_), _) => Share::None,
            (Self::Sets(names), _) => {
                let wanted = wanted.as_array().map_or(&[][..], Vec::as_slice);
                match wanted.iter().all(|name| names.iter().any(|known| name == known)) {
                    false => Share::None,
                    true if names.is_empty() => Share::All,
                    true => Share::Some,
                }
            }
        }
    }

    /// Returns whether this set includes all values of `other`. Any set of names counts as including any other set of
    /// names.
    fn include(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Numbers(range), Self::Numbers(other)) => {
                range.contains(other.start()) && range.contains(other.end())
            }
            (Self::Sets(_), Self::Sets(_)) => true,
            _ => self == other,
        }
    }

    fn words(&self, none: &str) -> String {
        match self {
            Self::Numbers(range) if range.start() == range.end() => range.start().to_string(),
            Self::Numbers(range) => format!("{} to {}", range.start(), range.end()),
            Self::One(value) => word(value, none),
            Self::Sets(names) => names.join(", "),
        }
    }
}

/// Returns the range of a number, or between limits; `None` for any other value.
fn bounds(value: &Json) -> Option<RangeInclusive<i64>> {
    if let Some(fields) = value.as_object() {
        let limit = |key, open| fields.get(key).map_or(Some(open), Json::as_i64);
        return match fields.contains_key("min") || fields.contains_key("max") {
            true => Some(limit("min", i64::MIN)?..=limit("max", i64::MAX)?),
            false => None,
        };
    }
    value.as_i64().map(|number| number..=number)
}

/// Returns whether a value equals the wanted value or, for an object, contains all wanted properties.
fn is_part(wanted: &Json, value: &Json) -> bool {
    match (wanted, value) {
        (Json::Object(wanted), Json::Object(fields)) => {
            wanted.iter().all(|(key, wanted)| fields.get(key) == Some(wanted))
        }
        _ => wanted == value,
    }
}

/// Formats a value. An LED is written without its keys; `none` is the word for null.
fn word(value: &Json, none: &str) -> String {
    match value {
        Json::Null => none.to_owned(),
        Json::Object(fields) if fields.contains_key("color") || fields.contains_key("flashing") => {
            let color = fields.get("color").and_then(Json::as_str);
            let flashing = match fields.get("flashing").and_then(Json::as_bool) {
                Some(true) => Some("flashing"),
                Some(false) => Some("constant"),
                None => None,
            };
            color.into_iter().chain(flashing).collect::<Vec<_>>().join(" ")
        }
        _ => value.to_string(),
    }
}

#[cfg(test)]
#[path = "possible_tests.rs"]
mod tests;
