//! Mutations of the committed scenarios: a wrong expectation, number or key turns its scenario red.
//! `SCENARIO_MUTATIONS=10000 cargo test -p pve-sim --test pve_sim mutations -- --nocapture` runs more than `./test`
//! does and prints the figures.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::thread;

use hal_sim::scenario::Scenario;
use toml::{Table, Value};

/// Number of mutations in `./test`.
const FEW: usize = 60;

/// Seed of the choice.
const SEED: u64 = 21;

/// The class of a mutation, by the meaning of a survivor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    /// A changed or inverted promise: the scenario turns red.
    Promise,
    /// A state on the way to the promised one, at which `expect` ends earlier.
    OnTheWay,
    /// Another forbidden frame or state. The scenario stays green if that does not occur either.
    Never,
    /// Another time limit, within which the device still keeps its promise.
    Time,
    /// Another action. The scenario turns red if a later expectation depends on it.
    Act,
}

/// Mutations of class [`Class::Promise`] that hold, because the device does that as well: scenario, step from 1, the
/// change, and the reason.
const ALSO_TRUE: &[(&str, usize, &str, &str)] = &[
    ("brown-out", 3, "\"active\" is \"disabled\"", "the way from INIT to ACTIVE leads through DISABLED"),
    ("brown-out", 3, "\"active\" is \"hold\"", "the way from INIT to ACTIVE leads through HOLD"),
    (
        "boom-and-sensor",
        6,
        "\"1A0#0F00 ????\" is \"1A0#0900 ????\"",
        "the first answer to the cyclic set-points is from DISABLED",
    ),
    ("lost-avc", 2, "expect: the key is never", "nobody waits for the first AVEF: the AVC comes before it"),
    ("bus-off", 3, "expect: the key is never", "nobody waits for the position: the bus-off comes before it"),
    ("boom-and-sensor", 9, "expect: the key is never", "nobody waits for neutral: the next set-point comes before it"),
    (
        "fault-insertion-isobus",
        9,
        "expect: the key is never",
        "nobody waits for the position: the claim of the address comes before it",
    ),
    (
        "fault-insertion-isobus",
        9,
        "\"extend\" is \"emergency-stop\"",
        "as the emergency stop begins, the spool is still where it was",
    ),
    ("fault-delay-isobus", 12, "\"blocked\" is \"extend\"", "as the step begins, the valve still extends"),
    (
        "lost-avc",
        9,
        "expect: the key is never",
        "nobody waits for the second DM1: the next AVC ends the fault before it",
    ),
];

/// A mutated scenario.
struct Mutation {
    class: Class,
    file: String,
    /// The number of the step; 0 outside of the steps.
    step: usize,
    /// The path and the change.
    what: String,
    text: String,
}

/// A part of the path to a value in a file.
#[derive(Clone, Debug, PartialEq)]
enum Part {
    Key(String),
    Place(usize),
}

#[test]
fn a_scenario_with_a_wrong_promise_is_red() {
    let wanted = std::env::var("SCENARIO_MUTATIONS").map_or(FEW, |number| number.parse().expect("a number"));
    let mutations = mutations(wanted);
    assert!(mutations.len() >= wanted.min(FEW), "{} mutations", mutations.len());
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let parts = mutations.chunks(mutations.len().div_ceil(threads));
    let survivors: Vec<&Mutation> = thread::scope(|scope| {
        let runs: Vec<_> =
            parts.map(|part| scope.spawn(move || part.iter().filter(|it| is_green(it)).collect::<Vec<_>>())).collect();
        runs.into_iter().flat_map(|run| run.join().expect("no panic")).collect()
    });
    let mut figures: BTreeMap<Class, (usize, usize)> = BTreeMap::new();
    mutations.iter().for_each(|mutation| figures.entry(mutation.class).or_default().0 += 1);
    survivors.iter().for_each(|mutation| figures.entry(mutation.class).or_default().1 += 1);
    for (class, (made, green)) in &figures {
        println!("{class:?}: {made} mutations, {} red, {green} green", made - green);
    }
    if wanted > FEW {
        for Mutation { class, file, step, what, .. } in &survivors {
            println!("green: {class:?}: {file} step {step}: {what}");
        }
    }
    let unexplained: BTreeSet<String> = survivors
        .iter()
        .filter(|mutation| mutation.class == Class::Promise && !is_also_true(mutation))
        .map(|mutation| format!("{} step {}: {}", mutation.file, mutation.step, mutation.what))
        .collect();
    assert!(unexplained.is_empty(), "{} of {}:\n{:#?}", unexplained.len(), mutations.len(), unexplained);
}

/// Returns whether the program would end with exit code 0: neither refused nor failed.
fn is_green(mutation: &Mutation) -> bool {
    Scenario::parse(&mutation.text).is_ok_and(|scenario| scenario.run(1).is_success())
}

fn is_also_true(mutation: &Mutation) -> bool {
    let Mutation { file, step, what, .. } = mutation;
    ALSO_TRUE.iter().any(|(known, place, change, _)| known == file && place == step && what.contains(change))
}

/// Returns this many different mutations, or as many as are found.
fn mutations(wanted: usize) -> Vec<Mutation> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let mut paths: Vec<_> =
        fs::read_dir(folder).expect("the scenarios").map(|file| file.expect("a file").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    let scenarios: Vec<(String, Table)> = paths
        .iter()
        .map(|path| {
            let text = fs::read_to_string(path).expect("a scenario");
            (path.file_stem().expect("a name").to_string_lossy().into_owned(), text.parse().expect("TOML"))
        })
        .collect();
    for (file, table) in &scenarios {
        let text = toml::to_string(table).expect("TOML");
        assert!(Scenario::parse(&text).is_ok_and(|it| it.run(1).is_success()), "{file} itself is green");
    }
    let sites: Vec<(usize, Vec<Part>)> = scenarios
        .iter()
        .enumerate()
        .flat_map(|(place, (_, table))| {
            sites(&Value::Table(table.clone()), &[]).into_iter().map(move |site| (place, site))
        })
        .collect();
    let mut random = fastrand::Rng::with_seed(SEED);
    let (mut made, mut known) = (Vec::new(), BTreeSet::new());
    for _ in 0..wanted * 20 {
        if made.len() == wanted {
            break;
        }
        let (place, site) = &sites[random.usize(..sites.len())];
        let (file, table) = &scenarios[*place];
        let Some((class, what, text)) = mutated(table, site, &mut random) else { continue };
        if known.insert(text.clone()) {
            let step = match site.get(1) {
                Some(Part::Place(place)) if site[0] == Part::Key("steps".to_owned()) => place + 1,
                _ => 0,
            };
            made.push(Mutation { class, file: file.clone(), step, what, text });
        }
    }
    made
}

/// Returns the paths to all values except for text for people. A key can be changed, too.
fn sites(value: &Value, way: &[Part]) -> Vec<Vec<Part>> {
    let to = |part| [way, &[part]].concat();
    let below = match value {
        Value::Table(table) => table
            .iter()
            .filter(|(key, _)| !["title", "note"].contains(&key.as_str()))
            .flat_map(|(key, value)| sites(value, &to(Part::Key(key.clone()))))
            .collect(),
        Value::Array(values) => {
            values.iter().enumerate().flat_map(|(place, value)| sites(value, &to(Part::Place(place)))).collect()
        }
        _ => Vec::new(),
    };
    if way.is_empty() { below } else { [below, vec![way.to_vec()]].concat() }
}

/// Returns a scenario with a wrong value, or a wrong key, at a path; `None` if none was found.
fn mutated(table: &Table, way: &[Part], random: &mut fastrand::Rng) -> Option<(Class, String, String)> {
    let mut whole = Value::Table(table.clone());
    let is_key = matches!(way.last(), Some(Part::Key(_))) && random.u8(..4) == 0;
    let (class, change) =
        if is_key { changed_key(&mut whole, way, random)? } else { changed_value(&mut whole, way, random)? };
    let way: Vec<String> = way
        .iter()
        .skip(2)
        .map(|part| match part {
            Part::Key(key) => key.clone(),
            Part::Place(place) => place.to_string(),
        })
        .collect();
    Some((class, format!("{}: {change}", way.join(".")), toml::to_string(&whole).expect("TOML")))
}

fn at<'a>(mut value: &'a mut Value, way: &[Part]) -> &'a mut Value {
    for part in way {
        value = match part {
            Part::Key(key) => &mut value[key.as_str()],
            Part::Place(place) => &mut value[*place],
        };
    }
    value
}

/// Misspells a key, or inverts a promise between `expect` and `never`.
fn changed_key(whole: &mut Value, way: &[Part], random: &mut fastrand::Rng) -> Option<(Class, String)> {
    let (Some(Part::Key(key)), above) = (way.last(), &way[..way.len() - 1]) else { return None };
    let table = at(whole, above).as_table_mut()?;
    let value = table.remove(key)?;
    let span = |table: &mut Table, key| table.remove(key).and_then(|ms| ms.as_integer()).unwrap_or(1000).max(1);
    let turned = match key.as_str() {
        "expect" if random.bool() => {
            let for_ms = span(table, "within_ms");
            table.remove("any_order");
            // Only a single frame has an opposite: of several frames, none comes.
            if value.as_array().is_some_and(|frames| frames.len() > 1) {
                return None;
            }
            table.insert("for_ms".to_owned(), for_ms.into());
            "never"
        }
        "never" if random.bool() => {
            let within_ms = span(table, "for_ms");
            table.insert("within_ms".to_owned(), within_ms.into());
            "expect"
        }
        key => {
            let misspelt: String = key.chars().rev().collect();
            table.insert(misspelt.clone(), value);
            return Some((Class::Promise, format!("the key is {misspelt}")));
        }
    };
    table.insert(turned.to_owned(), value);
    Some((Class::Promise, format!("the key is {turned}")))
}

fn changed_value(whole: &mut Value, way: &[Part], random: &mut fastrand::Rng) -> Option<(Class, String)> {
    let keys: Vec<&str> = way
        .iter()
        .filter_map(|part| match part {
            Part::Key(key) => Some(key.as_str()),
            Part::Place(_) => None,
        })
        .collect();
    let within = at(whole, &way[..way.len().min(2)]).get("within_ms").and_then(Value::as_integer);
    let value = at(whole, way);
    let old = value.clone();
    let promise = |class| if keys.contains(&"never") { Class::Never } else { class };
    let (class, new) = match (keys.as_slice(), &old) {
        (["steps", "expect" | "never"], Value::String(frame)) => {
            (promise(Class::Promise), other_frame(frame, random)?.into())
        }
        (["steps", "expect" | "never"], Value::Array(frames)) if frames.len() > 1 => {
            let mut frames = frames.clone();
            let place = random.usize(1..frames.len());
            frames.swap(place - 1, place);
            let is_ordered = at(whole, &way[..2]).get("any_order").is_none() && Value::Array(frames.clone()) != old;
            (is_ordered.then_some(promise(Class::Promise))?, frames.into())
        }
        (["steps", "send"], Value::String(frame)) => (Class::Act, other_frame(frame, random)?.into()),
        (["steps", "stop"], Value::String(id)) => (Class::Promise, other_digit(id, 0, random)?.into()),
        (["steps", "device"], Value::String(name)) => (Class::Promise, format!("{name}x").into()),
        (["devices"], Value::String(device)) => {
            let (start, end) = (device.find('@')? + 3, device.find(',').unwrap_or(device.len()));
            let id = other_digit(device.get(start..end)?, end - start - 1, random)?;
            (Class::Promise, format!("{}{id}{}", &device[..start], &device[end..]).into())
        }
        (["steps", "expect" | "never", .., "position" | "set_point" | "min" | "max"], Value::Integer(number)) => {
            let new = number + if random.bool() { 1 } else { -1 } * random.i64(1..2000);
            let is_limit = matches!(keys.last(), Some(&"min" | &"max"));
            // Devices start from neutral, or return to it: all values in between are nearer.
            let is_beyond = if *number == 0 { new < 0 } else { new.abs() > number.abs() };
            let is_promise = within == Some(0) || (is_beyond && !is_limit);
            (promise(if is_promise { Class::Promise } else { Class::OnTheWay }), new.into())
        }
        (["steps", "expect" | "never", .., key], _) => (promise(Class::Promise), other_state(key, &old, random)?),
        (["steps", "after_ms" | "at_ms" | "within_ms" | "for_ms" | "every_ms"], Value::Integer(ms)) => {
            (Class::Time, other_number(*ms, random).into())
        }
        (_, Value::Integer(number)) => (Class::Act, other_number(*number, random).into()),
        (_, Value::Boolean(is)) => (Class::Act, (!is).into()),
        (["steps", "plant", ..], Value::String(word)) => {
            let words = ["stuck", "slow", "drifting", "no-float", "none"];
            let other = words[random.usize(..words.len())];
            (Class::Act, (other != word).then_some(other)?.into())
        }
        _ => return None,
    };
    *at(whole, way) = new.clone();
    Some((class, format!("{old} is {new}")))
}

/// Returns another valid value for a key of a state, so that the scenario is accepted.
fn other_state(key: &str, old: &Value, random: &mut fastrand::Rng) -> Option<Value> {
    let words: &[&str] = match key {
        "dsm" => &["init", "disabled", "hold", "active", "fault-hold", "none"],
        "nmt" => &["initialising", "pre-operational", "operational", "stopped", "none"],
        "command" => &["blocked", "extend", "retract", "float", "hand", "emergency-stop", "none"],
        "color" => &["green", "yellow", "red", "off"],
        "faults" => &["internal", "can-bus", "temperature", "supply-high", "supply-low", "time-guarding"],
        _ => &[],
    };
    match old {
        Value::String(old) => random.choice(words).filter(|word| *word != old).map(|word| (*word).into()),
        Value::Boolean(is) => Some((!is).into()),
        Value::Integer(number) => Some(other_number(*number, random).into()),
        Value::Array(old) => {
            let mut names = old.clone();
            match names.pop() {
                Some(_) if random.bool() => {}
                _ => names = vec![(*random.choice(words)?).into()],
            }
            (names != *old).then_some(names.into())
        }
        _ => None,
    }
}

fn other_number(number: i64, random: &mut fastrand::Rng) -> i64 {
    match random.u8(..4) {
        0 => number + 1,
        1 => (number - 1).max(0) + i64::from(number == 0) * 2,
        2 => number / 2 + i64::from(number < 2) * 7,
        _ => number * 2 + 1,
    }
}

/// Returns a frame with another digit, or another length.
fn other_frame(frame: &str, random: &mut fastrand::Rng) -> Option<String> {
    let is_exact = frame.contains('#') && !frame.contains("..");
    match random.u8(..8) {
        0 if is_exact => Some(format!("{frame}00")),
        1 if is_exact => frame.get(..frame.len() - 2).filter(|short| short.contains('#')).map(str::to_owned),
        _ => {
            let places: Vec<usize> =
                frame.char_indices().filter(|(_, c)| c.is_ascii_hexdigit()).map(|(place, _)| place).collect();
            other_digit(frame, *random.choice(&places)?, random)
        }
    }
}

/// Returns a text with another hex digit at a place.
fn other_digit(text: &str, place: usize, random: &mut fastrand::Rng) -> Option<String> {
    let old = text.get(place..=place)?.chars().next()?.to_digit(16)?;
    let new = char::from_digit((old + random.u32(1..16)) % 16, 16)?.to_ascii_uppercase();
    Some(format!("{}{new}{}", &text[..place], &text[place + 1..]))
}
