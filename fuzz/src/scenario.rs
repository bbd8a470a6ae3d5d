//! The scenario files.

use std::collections::BTreeSet;
use std::fs;

use hal_sim::scenario::{ReadError, Scenario};
use pve_sim::batch::{self, Options};
use pve_sim::output::CommandError;
use toml::{Table, Value};

use crate::room::{self, assert_one_line};

/// The longest virtual time of a scenario that is run, in milliseconds.
const LONGEST_MS: i64 = 20_000;

/// The maximum number of devices of a scenario that is run.
const DEVICES: usize = 6;

/// The time after which a frame of a scenario is on the bus or withdrawn, in milliseconds.
const SENT_MS: i64 = 1000;

/// Plays a scenario file of any bytes. It is refused with one line that names a line of the file, or runs to its
/// verdict. Two runs are the same to the last byte, and the bus has no frame of the scenario but those of its steps.
pub fn scenario(bytes: &[u8]) {
    let file = room::file("scenario.toml", bytes);
    let name = file.display().to_string();
    let junit = room::path("results.xml");
    let options = Options { files: vec![file], junit: Some(junit.clone()), seed: 1, verbose: true };
    let read = str::from_utf8(bytes).map(|text| (text, Scenario::parse(text)));
    let scenario = match &read {
        Ok((text, Ok(scenario))) => match longest_ms(text) {
            Some(_) => scenario,
            None => return,
        },
        _ => {
            let mut out = Vec::new();
            let Err(CommandError::Refused(line)) = batch::run(&options, &mut out) else {
                panic!("a scenario that cannot be read was run")
            };
            assert_one_line(&line);
            assert!(out.is_empty(), "a refused scenario prints something");
            if let Ok((text, Err(ReadError { line: number, reason }))) = &read {
                let number = number.unwrap_or(1);
                assert!((1..=text.split('\n').count()).contains(&number), "no line {number} in the file: {reason}");
                assert!(line.ends_with(&format!(":{number}: {reason}")), "{line}");
                check_place(text, number);
            }
            return;
        }
    };
    let text = str::from_utf8(bytes).unwrap_or_default();
    let outcome = scenario.run(1);
    let failures = outcome.failures(&name);
    assert_eq!(outcome.is_success(), failures.is_empty());
    let verdict = outcome.to_string();
    assert_one_line(&verdict);
    let mut out = Vec::new();
    let is_success = batch::run(&options, &mut out).expect("a scenario that can be read");
    assert_eq!(is_success, outcome.is_success(), "two runs differ");
    let out = String::from_utf8(out).expect("text");
    let (word, count) = if is_success { ("ok   ", "1 passed, 0 failed") } else { ("FAIL ", "0 passed, 1 failed") };
    let end = format!("{word}{name}: {verdict}\n{failures}{count}\n");
    let trace = out.strip_suffix(&end).unwrap_or_else(|| panic!("two runs differ:\n{out}\n{end}"));
    let end = verdict.rsplit_once(" in ").and_then(|(_, time)| micros(time)).expect("the time of the end");
    let longest = longest_ms(text).unwrap_or(LONGEST_MS);
    assert!(end <= longest as u64 * 1000, "{verdict}: longer than {longest} ms");
    check_trace(trace, &frames(text), end);
    let junit = fs::read_to_string(junit).expect("results");
    let is_xml = |char: char| matches!(char, '\t' | '\n' | '\r' | ' '..) && !matches!(char, '\u{FFFE}' | '\u{FFFF}');
    assert!(junit.chars().all(is_xml), "no XML: {junit:?}");
    assert_eq!(junit.matches("<testcase ").count(), 1, "{junit}");
    assert_eq!(junit.matches("<failure ").count(), usize::from(!is_success), "{junit}");
}

/// Asserts that a refusal names the line at which the file stops being TOML, or else a line with content.
fn check_place(text: &str, number: usize) {
    let error = toml::from_str::<Table>(text).err();
    if let Some(begun) = error.and_then(|error| error.span()).and_then(|place| text.get(..place.start)) {
        assert_eq!(number, begun.split('\n').count(), "no TOML");
    } else {
        let line = text.split('\n').nth(number - 1).unwrap_or_default().trim();
        assert!(number == 1 || !line.is_empty() && !line.starts_with('#'), "nothing in line {number}");
    }
}

/// Asserts that the times of the trace rise up to the end, and that it has no frame of the scenario but these.
fn check_trace(trace: &str, asked: &BTreeSet<String>, end: u64) {
    let mut last = 0;
    for line in trace.lines().filter(|line| !line.starts_with("-- ")) {
        let Some((time, rest)) = line.split_once(" ms  ") else { continue };
        let at = micros(&format!("{} ms", time.trim())).unwrap_or_else(|| panic!("{line}"));
        assert!((last..=end).contains(&at), "time goes back, or beyond the end: {line}");
        last = at;
        if let Some(frame) = rest.strip_prefix("->  ") {
            let frame = frame.split("  ").next().unwrap_or_default().trim_end();
            assert!(asked.contains(frame), "nobody asked for {frame}: {asked:?}");
        }
    }
}

/// Parses a printed time to microseconds.
fn micros(text: &str) -> Option<u64> {
    text.strip_suffix(" ms")?.replace('.', "").parse().ok()
}

/// Returns the steps of a scenario.
fn steps(text: &str) -> Vec<Table> {
    let table: Table = toml::from_str(text).unwrap_or_default();
    let steps = table.get("steps").and_then(Value::as_array).cloned().unwrap_or_default();
    steps.into_iter().filter_map(|step| step.try_into().ok()).collect()
}

/// Returns the longest virtual time of a scenario, in milliseconds; `None` if it exceeds the limits.
fn longest_ms(text: &str) -> Option<i64> {
    let table: Table = toml::from_str(text).ok()?;
    if table.get("devices").and_then(Value::as_array).is_none_or(|devices| devices.len() > DEVICES) {
        return None;
    }
    let mut total = 0_i64;
    for step in steps(text) {
        let number = |key: &str| step.get(key).and_then(Value::as_integer);
        let times = [number("at_ms"), number("after_ms"), number("for_ms")];
        let within = number("within_ms").or(step.contains_key("expect").then_some(1000));
        let sent = step.contains_key("send").then_some(2 * SENT_MS);
        total += times.into_iter().chain([within, sent]).flatten().sum::<i64>();
    }
    (total <= LONGEST_MS).then_some(total)
}

/// Returns the frames that the steps of a scenario send, as the manuals print them.
fn frames(text: &str) -> BTreeSet<String> {
    let sent = steps(text).into_iter().filter_map(|step| Some(step.get("send")?.as_str()?.to_owned()));
    sent.map(|text| frame(&text)).collect()
}

fn frame(text: &str) -> String {
    let (id, data) = text.split_once(['#', ':']).unwrap_or((text, ""));
    let id = id.trim().to_uppercase();
    let data: String = data.chars().filter(|char| !matches!(char, ' ' | '\t')).collect();
    let words = match data.strip_prefix('R') {
        Some(length) => vec![format!("R{}", if length.is_empty() { "0" } else { length })],
        None => data.to_uppercase().as_bytes().chunks(2).map(|pair| String::from_utf8_lossy(pair).into()).collect(),
    };
    let words: String = words.into_iter().map(|word| format!(" {word}")).collect();
    format!("{}:{words}", id.strip_prefix("0X").unwrap_or(&id))
}
