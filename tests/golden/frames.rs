//! What is on the bus, to the microsecond: the use cases (SPEC 8), the scenarios, and a life of each kind as a log. A
//! log is read again, explained, and replayed.

use std::fs;

use super::expected::{check, check_all, folder};
use super::program::{Simulator, printed, root, run};
use super::rig::{KINDS, NAME, Rig};

/// The start of a log, whatever the clock said.
const START_US: u64 = 1_700_000_000_000_000;

/// From power-up through motion, each fault that a client notices, a clearing, a reset and a power cut.
const CANOPEN_VALVE: &[&str] = &[
    "advance 10",
    "ask 620#4018100100000000 5A0",
    "ask 620#400A100000000000 5A0",
    "ask 620#6000000000000000 5A0",
    "ask 620#4052600000000000 5A0",
    "ask 620#4000200000000000 5A0",
    "ask 620#2B1710003C000000 5A0",
    "send 000#0120",
    "every 100 220#0F000020",
    "advance 400",
    "every 100 220#0F00 00C0",
    "advance 400",
    r#"plant {"spool": "stuck"}"#,
    "every 100 220#0F00 0040",
    "advance 600",
    r#"plant {"spool": "ok"}"#,
    "every 100 220#0300 0000",
    "advance 300",
    "every 100 220#0B00 0000",
    "advance 50",
    "every 100 220#0F00 FF7F",
    "advance 500",
    r#"plant {"supply_mv": 8000}"#,
    "advance 2100",
    r#"plant {"supply_mv": 24000, "temperature_c": 130}"#,
    "advance 2100",
    r#"plant {"temperature_c": 25, "lever": 4000}"#,
    "advance 300",
    r#"plant {"lever": null, "internal_fault": true}"#,
    "advance 200",
    r#"plant {"internal_fault": false}"#,
    "stop",
    "advance 300",
    "ask 620#4003100100000000 5A0",
    "send 1BC78820#03221001",
    "ask 620#23111005706B6473 5A0",
    "ask 620#2310100173617665 5A0",
    "send 000#0220",
    "send 7E5#0401000000000000",
    "ask 7E5#5E00000000000000 7E4",
    "send 000#8120",
    "advance 20",
    "send 000#8220",
    "advance 20",
    r#"power {"on": false}"#,
    "advance 20",
    r#"power {"on": true}"#,
    "advance 70",
];

/// The same for a valve on ISOBUS.
const ISOBUS_VALVE: &[&str] = &[
    "advance 400",
    "ask 18EAFF27#00EE00 18EEFF80",
    "ask 18EA8027#CBFE00 18FECB80",
    "ask 18EA8027#00FF00 18E8FF80",
    "ask 1BC78880#0322F195 1BC400F1",
    "every 100 0CFE3027#7DFF01FFFFFFFFFF",
    "advance 500",
    "every 100 0CFE3027#FAFF02FFFFFFFFFF",
    "advance 800",
    r#"plant {"spool": "stuck"}"#,
    "every 100 0CFE3027#00FF00FFFFFFFFFF",
    "advance 1200",
    r#"plant {"spool": "ok"}"#,
    "advance 500",
    "every 100 0CFE3027#FFFF03FFFFFFFFFF",
    "advance 1200",
    r#"plant {"supply_mv": 8000}"#,
    "advance 2300",
    r#"plant {"supply_mv": 24000}"#,
    "every 100 0CFE3027#00FF00FFFFFFFFFF",
    "advance 400",
    "stop",
    "advance 1600",
    "send 18EA8027#CBFE00",
    "advance 500",
    "send 18EA8027#CCFE00",
    "advance 100",
    "send 18EEFF80#0000000000000000",
    "advance 300",
    "send 1CEC8027#1009000200D8FE00",
    "advance 50",
    r#"power {"reset": "watchdog"}"#,
    "advance 600",
];

/// And for an angle sensor.
const SENSOR: &[&str] = &[
    "advance 10",
    "ask 601#4018100100000000 581",
    "ask 601#4008100000000000 581",
    "ask 601#4004600000000000 581",
    "ask 601#2301180181010000 581",
    "ask 601#2300180181010000 581",
    "ask 601#2B00180532000000 581",
    "ask 601#2B17100064000000 581",
    "send 000#0100",
    r#"plant {"angle_cdeg": 9000}"#,
    "advance 110",
    r#"plant {"speed_rpm": 30}"#,
    "advance 500",
    "ask 601#2303600010270000 581",
    "advance 200",
    "ask 601#2F00180201000000 581",
    "send 080#",
    "advance 20",
    r#"plant {"measuring_error": true, "speed_rpm": -5}"#,
    "advance 200",
    r#"plant {"measuring_error": false, "internal_fault": true}"#,
    "advance 200",
    r#"plant {"internal_fault": false, "bus_off": true}"#,
    "advance 200",
    r#"plant {"bus_off": false}"#,
    "advance 200",
    "ask 601#2310100173617665 581",
    "send 7E5#4C00000000000000",
];

/// The life of a kind.
fn life(kind: &str) -> &'static [&'static str] {
    match kind {
        kind if kind.starts_with("hat") => SENSOR,
        kind if kind.ends_with("isobus") => ISOBUS_VALVE,
        _ => CANOPEN_VALVE,
    }
}

/// Lives a life with a log of this ending; what the trace says, and the log.
fn lived(kind: &str, ending: &str) -> (String, std::path::PathBuf, tempfile::TempDir) {
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join(format!("life.{ending}"));
    let device = format!("{kind},name={NAME}");
    let simulator = Simulator::started(&["--device", &device, "--log", log.to_str().expect("text")]);
    let rig = Rig::new(simulator, kind);
    rig.play(life(kind));
    let trace = rig.trace();
    let ended = rig.simulator.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    (trace, log, dir)
}

/// The time of a line, `(1700000000.000268) …`.
fn micros(line: &str) -> u64 {
    let (seconds, fraction) = line[1..].split_once(')').expect("a time").0.split_once('.').expect("a fraction");
    assert_eq!(fraction.len(), 6, "{line}");
    seconds.parse::<u64>().expect("seconds") * 1_000_000 + fraction.parse::<u64>().expect("microseconds")
}

/// A log of candump whose first line is of this virtual time, as if its run had begun at [`START_US`].
fn from_start(log: &str, first_us: u64) -> String {
    let base = log.lines().next().map_or(0, micros) - first_us;
    let line = |line: &str| {
        let at = START_US + micros(line) - base;
        let rest = line.split_once(')').expect("a time").1;
        format!("({}.{:06}){rest}\n", at / 1_000_000, at % 1_000_000)
    };
    log.lines().map(line).collect()
}

#[test]
fn use_cases() {
    let titles = printed(&["use-case"]);
    let names = titles.lines().map(|line| line.split(' ').next().expect("a name"));
    let names: Vec<&str> = names.filter(|name| *name != "all").collect();
    check_all(
        &names
            .iter()
            .map(|name| (format!("frames/use-case-{name}.txt"), printed(&["use-case", name])))
            .collect::<Vec<_>>(),
    );
}

#[test]
fn scenarios() {
    let mut files: Vec<String> = fs::read_dir(root().join("scenarios"))
        .expect("a folder")
        .map(|file| file.expect("a file").file_name().into_string().expect("text"))
        .filter(|file| file.ends_with(".toml"))
        .collect();
    files.sort();
    let play = |file: &String| {
        let path = format!("scenarios/{file}");
        (format!("frames/scenario-{}.txt", file.trim_end_matches(".toml")), printed(&["scenario", "--verbose", &path]))
    };
    check_all(&files.iter().map(play).collect::<Vec<_>>());
}

#[test]
fn a_life_of_each_kind() {
    let mut texts = Vec::new();
    for kind in KINDS {
        let (trace, log, _dir) = lived(kind, "log");
        let log = fs::read_to_string(log).expect("a log");
        let first = trace.split_whitespace().next().and_then(|time| time.parse().ok()).expect("a frame");
        texts.push((format!("frames/life-{kind}.log"), from_start(&log, first)));
    }
    check_all(&texts);
}

/// What was recorded with another version is explained and answered as it was.
#[test]
fn recorded_lives() {
    let mut texts = Vec::new();
    for kind in KINDS {
        let log = format!("tests/golden/frames/life-{kind}.log");
        let device = format!("{kind},name={NAME}");
        let ended = run(&["decode", &log]);
        texts.push((format!("frames/decoded-{kind}.txt"), ended.transcript(&format!("decode {log}"))));
        let ended = run(&["replay", &log, "--device", &device]);
        texts.push((
            format!("frames/replayed-{kind}.txt"),
            ended.transcript(&format!("replay {log} --device {device}")),
        ));
    }
    check_all(&texts);
}

/// A life in the other formats is the same life.
#[test]
fn other_formats_of_logs() {
    // Without the time of the start, and the name of the bus: those are the format's.
    let explained = |path: &str| -> Vec<String> {
        let text = run(&["decode", path]).stdout;
        let first = text.lines().next().map_or(0, micros);
        let line = |line: &str| format!("{} {}", micros(line) - first, line.splitn(3, ' ').nth(2).expect("a frame"));
        text.lines().map(line).collect()
    };
    let plain = explained(folder().join("frames/life-pvea-canopen.log").to_str().expect("text"));
    for ending in ["asc", "pcapng"] {
        let (_, log, _dir) = lived("pvea-canopen", ending);
        let other = explained(log.to_str().expect("text"));
        let first = plain.iter().zip(&other).find(|(plain, other)| plain != other);
        assert!(plain == other, "{ending}: {first:?}, {} and {} lines", plain.len(), other.len());
    }
}

/// What is told when frames do not come as they should, or what is read makes no sense.
#[test]
fn what_differs() {
    let lines = [
        "scenario tests/golden/inputs/unreadable.toml tests/golden/inputs/never.toml nowhere.toml",
        "scenario tests/golden/inputs/fails.toml tests/golden/inputs/deaf.toml scenarios/use-case-1.toml",
        "decode tests/golden/inputs/other.log",
        "decode tests/golden/inputs/other.log --device pvea-canopen@0x20,name=boom",
        "replay tests/golden/inputs/other.log --device pvea-canopen@0x20",
        "replay tests/golden/inputs/other.log --device pvea-canopen@0x20 --tolerance-ms 50",
        "replay tests/golden/inputs/other.log --device pvea-canopen@0x21",
    ];
    let text: String = lines.iter().map(|line| run(&line.split(' ').collect::<Vec<_>>()).transcript(line)).collect();
    check("frames/differences.txt", &text);
}

#[test]
fn results_for_ci() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("results.xml");
    let words = ["scenario", "tests/golden/inputs/fails.toml", "scenarios/use-case-1.toml", "--junit"];
    let ended = run(&[&words[..], &[file.to_str().expect("text")]].concat());
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    check("frames/results.xml", &fs::read_to_string(file).expect("results"));
}
