//! The words of a console: their effect, their values, and rejected input.

extern crate std;
use std::string::{String, ToString as _};
use std::vec::Vec;

use super::*;
use crate::actuator::SpoolFault;
use crate::device::{hat, pve};
use crate::encoder::Shaft;

const VALVE: Kind = Kind::Pve(pve::Kind::PveaCanopen);
const SENSOR: Kind = Kind::Hat(hat::Kind::Hat3000);
const NOW: Instant = Instant::from_secs(7);

/// Applies console lines to a healthy device.
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
    let valve = plant.inputs.valve().unwrap();
    assert_eq!((valve.supply_mv, valve.temperature_c), (8500, -41));
    assert_eq!((valve.spool.fault, valve.spool.lever), (SpoolFault::NoFloat, Position::new(-4000)));
    assert!(plant.inputs.internal_fault && plant.memory_fails && plant.bus_off);
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
    assert_eq!(plant.inputs.shaft(), Some(&shaft));
    assert!(plant.inputs.internal_fault && plant.memory_fails && plant.bus_off);
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
        "brown_out_mv on",
        "oil 1",
        "boot_ms -1",
        "boot_ms 65536",
        "answer_ms 5..",
        "answer_ms ..5",
        "cycle_ms off",
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
            injection = injection.next(&plant.inputs.product);
            plant = injection.applied_to(plant);
            assert!(told(&plant, NOW).iter().any(|told| told == line), "{injection:?}");
            assert!(!seen.contains(&plant), "{injection:?}");
            seen.push(plant);
        }
        assert_eq!((injection, plant), (Injection::None, start), "the fault of the press before is taken away");
    }
}

#[test]
fn each_word_tells_its_values_and_stands_at_one_of_them() {
    for (word, form, values) in [
        (0, "supply_mv N", "0 to 100000 mV"),
        (1, "temperature_c N", "-273 to 1000 °C"),
        (2, "spool ok|stuck|slow|drifting|no-float", "ok, stuck, slow, drifting, no-float"),
        (3, "lever N|off", "-16384 to 16384, or off"),
        (4, "angle_cdeg N", "0 to 35999 1/100 degree"),
        (5, "speed_rpm N", "-2147483648 to 2147483647 turns a minute"),
        (8, "memory ok|write-fails", "ok, write-fails"),
        (9, "bus_off on|off", "on, off"),
        (10, "brown_out_mv N|off", "1 to 100000, or off"),
        (13, "answer_ms N|N..N", "0 to 60000 ms, or a range as in 5..20"),
    ] {
        assert_eq!((WORDS[word].to_string().as_str(), WORDS[word].values.to_string().as_str()), (form, values));
    }
    for (kind, product) in [(VALVE, Product::Valve), (SENSOR, Product::Encoder)] {
        let plant = Plant::healthy(kind);
        assert_eq!(Product::from(&plant.inputs.product), product);
        let (words, changes) = (product.words_of_board().collect::<Vec<_>>(), plant.words(NOW).collect::<Vec<_>>());
        assert_eq!(changes.iter().map(|change| change.word()).collect::<Vec<_>>(), words);
        for (word, change) in words.into_iter().zip(changes) {
            let (name, value) = change.text();
            assert_eq!((name, word.healthy()), (word.name, Some(value)));
            assert!(word.values.contain(value), "{name}");
        }
    }
}

#[test]
fn every_value_of_a_word_is_read_and_made_and_no_other() {
    for word in &WORDS {
        let kind = if word.product == Some(Product::Encoder) { SENSOR } else { VALVE };
        let parsed = |value: &str| Change::parse(word.name, value).filter(|change| change.word() == word);
        let made = |value: &str| {
            parsed(value).is_some_and(|change| {
                Plant::healthy(kind).change(change, NOW) == Ok(()) && change.text().1.to_string() == value
            })
        };
        if let Values::Words(words) = word.values {
            assert!(words.iter().all(|value| made(value)), "{word}");
        }
        if let Some((min, max)) = word.values.range() {
            let [below, above] = [i64::from(min) - 1, i64::from(max) + 1].map(|value| value.to_string());
            assert!(made(&min.to_string()) && made(&max.to_string()) && !made(&below) && !made(&above), "{word}");
        }
        let has_off = matches!(word.values, Values::NumberOrOff { .. } | Values::Words(["on", _]));
        assert_eq!(made("off"), has_off, "{word}");
        let has_ranges = matches!(word.values, Values::NumberOrRange { .. });
        assert_eq!((made("5..20"), made("20..5"), made("5..60001")), (has_ranges, false, false), "{word}");
        let healthy = word.healthy().expect(word.name).to_string();
        assert!(made(&healthy), "{word}: {healthy}");
    }
}
