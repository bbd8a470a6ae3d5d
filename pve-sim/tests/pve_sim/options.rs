//! Every line of the option tables of docs/pve-sim.md, typed once right and once wrong. A right one starts; a wrong one
//! exits with 2 and a line that names the accepted values.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::Stdio;

use crate::simulator::{Simulator, output, pve_sim, refusal};

/// The bus of each test; `--bus` has the one of its row.
const ANY_PORT: &str = "socketcand://127.0.0.1:0/pve0";

/// A line of a table: its name, the right words, the wrong ones, and a part of the refusal.
pub(crate) type Line = (&'static str, &'static str, &'static str, &'static str);

/// The options; `DIR` stands for a folder of the test.
const OPTIONS: &[Line] = &[
    ("--device", "--device pveo-canopen@0x7F,name=rear", "--device valve", "accepted: pvea-canopen, pveo-canopen,"),
    (
        "--link",
        "--device pvea-canopen --device hat1000,bit-rate=250k --link pvea-canopen=hat1000",
        "--link boom",
        "accepted: VALVE=SENSOR",
    ),
    ("--bus", "--bus socketcand://127.0.0.1:0/boom", "--bus can0", "accepted: socketcand://HOST:PORT/NAME"),
    ("--bit-rate", "--bit-rate 250k", "--bit-rate 300k", "accepted: 10000, 20000, 50000, 125000, 250000,"),
    ("--state", "--state DIR", "--state", "'--state <DIR>'"),
    ("--speed", "--speed step --http 127.0.0.1:0", "--speed 0", "a number above 0, as in 1, 0.5 or 100, or step"),
    ("--log", "--log DIR/frames.log", "--log", "'--log <FILE>'"),
    ("--log-overwrite", "--log DIR/frames.log --log-overwrite", "--log-overwrite", "--log <FILE>"),
    ("--error-frames", "--error-frames", "--error-frames=all", "no more were expected"),
    ("--beacon", "--beacon", "--beacon=loud", "no more were expected"),
    ("--color", "--color never", "--color red", "auto, always, never"),
    ("--verbose", "--verbose", "--verbose=2", "no more were expected"),
    ("--seed", "--seed 18446744073709551615", "--seed 18446744073709551616", "0–18446744073709551615"),
    ("--allow-clash", "--allow-clash --device pvea-canopen --device pvea-canopen", "--allow-clash=2", "no more"),
    ("--http", "--http 127.0.0.1:0", "--http 8408", "must be ADDR:PORT"),
    ("--allow-real-bus", "--allow-real-bus", "--allow-real-bus=can0", "no more"),
    ("--allow-remote", "--allow-remote --http 0.0.0.0:0", "--http 0.0.0.0:0", "or add --allow-remote"),
    ("--no-http", "--no-http", "--no-http=1", "no more were expected"),
];

/// The parts of `--device`.
const PARTS: &[Line] = &[
    ("KIND", "--device hat3000", "--device hat2000", "accepted: pvea-canopen,"),
    ("@ID", "--device pvea-isobus@0x8F", "--device pvea-isobus@0x90", "accepted: 128–143, or 0x80–0x8F"),
    (
        "name=",
        "--device pvea-canopen,name=boom-2",
        "--device pvea-canopen,name=Boom",
        "accepted: 1–32 characters of a–z,",
    ),
    ("serial=", "--device pvea-canopen,serial=0x7", "--device pvea-canopen,serial=x", "accepted: 0–4294967295,"),
    (
        "bit-rate=",
        "--device pvea-canopen,bit-rate=125k",
        "--device pvea-canopen,bit-rate=1M",
        "accepted: 125000, 250000, 500000",
    ),
    (
        "stroke-ms=",
        "--device pvea-canopen,stroke-ms=320",
        "--device pvea-canopen,stroke-ms=9",
        "accepted: 10–5000, in milliseconds",
    ),
    (
        "return-ms=",
        "--device pvea-canopen,return-ms=5000",
        "--device hat1000,return-ms=100",
        "'return-ms' applies to a valve's spool",
    ),
    (
        "boot-ms=",
        "--device hat1000,boot-ms=1500",
        "--device hat1000,boot-ms=60001",
        "accepted: 0–60000, in milliseconds",
    ),
    (
        "answer-ms=",
        "--device pvea-canopen,answer-ms=5..20",
        "--device pvea-canopen,answer-ms=20..5",
        "accepted: the smaller time first, as in 5..20",
    ),
    (
        "cycle-ms=",
        "--device pvea-isobus,cycle-ms=10",
        "--device pvea-isobus,cycle-ms=1001",
        "accepted: 0–1000, in milliseconds",
    ),
    (
        "brown-out-mv=",
        "--device pvea-canopen,brown-out-mv=5500",
        "--device hat1000,brown-out-mv=5500",
        "'brown-out-mv' applies to a valve's supply",
    ),
    ("noise=", "--device pvea-canopen,noise=16384", "--device hat1000,noise=9001", "accepted: 0–9000, in 1/100 degree"),
    (
        "dead-band=",
        "--device hat1000,dead-band=9000",
        "--device pvea-canopen,dead-band=16385",
        "accepted: 0–16384, 16384 is full stroke",
    ),
    ("oil", "--device pvea-canopen,oil", "--device hat1000,oil", "'oil' applies to a valve"),
    ("blank", "--device pvea-canopen,blank", "--device pvea-isobus,blank", "give @ID"),
];

/// The keys of `--link`.
const KEYS: &[Line] = &[
    (
        "rate=",
        "--link pvea-canopen=hat1000,rate=-50",
        "--link pvea-canopen=hat1000,rate=fast",
        "1/100 degree per second",
    ),
    ("min=", "--link pvea-canopen=hat1000,min=10,max=20", "--link pvea-canopen=hat1000,min=-1", "accepted: 0–35999"),
    ("max=", "--link pvea-canopen=hat1000,max=35999", "--link pvea-canopen=hat1000,max=36000", "accepted: 0–35999"),
    (
        "noise=",
        "--link pvea-canopen=hat1000,noise=100",
        "--link pvea-canopen=hat1000,noise=101",
        "accepted: 0–100, in percent",
    ),
    (
        "dead-band=",
        "--link pvea-canopen=hat1000,dead-band=16384",
        "--link pvea-canopen=hat1000,dead-band=-1",
        "accepted: 0–16384",
    ),
];

/// The console words for a valve: parts of the answers, right and wrong.
pub(crate) const VALVE_WORDS: &[Line] = &[
    ("supply_mv", "supply_mv 12000", "supply_mv low", "accepted: supply_mv N"),
    ("temperature_c", "temperature_c -40", "temperature_c hot", "temperature_c N"),
    ("spool", "spool no-float", "spool bent", "spool ok|stuck|slow|drifting|no-float"),
    ("lever", "lever -16384", "lever down", "lever N|off"),
    ("internal_fault", "internal_fault on", "internal_fault maybe", "internal_fault on|off"),
    ("memory", "memory write-fails", "memory full", "memory ok|write-fails"),
    ("bus_off", "bus_off off", "bus_off 2", "bus_off on|off"),
    ("brown_out_mv", "brown_out_mv 7000", "brown_out_mv low", "brown_out_mv N|off"),
    ("oil", "oil on", "oil cold", "oil on|off"),
    ("boot_ms", "boot_ms 300", "boot_ms soon", "boot_ms N"),
    ("answer_ms", "answer_ms 20", "answer_ms late", "answer_ms N|N..N"),
    ("cycle_ms", "cycle_ms 10", "cycle_ms slow", "cycle_ms N"),
    ("status", "status", "status all", "status, help"),
    ("help", "help", "help me", "status, help"),
];

/// The console words for an angle sensor only.
pub(crate) const ENCODER_WORDS: &[Line] = &[
    ("angle_cdeg", "angle_cdeg 35999", "angle_cdeg far", "accepted: angle_cdeg N"),
    ("speed_rpm", "speed_rpm -30", "speed_rpm fast", "speed_rpm N"),
    ("measuring_error", "measuring_error on", "measuring_error maybe", "measuring_error on|off"),
];

/// Returns the names in the first column of the table with this head, without placeholders.
pub(crate) fn documented(head: &str) -> BTreeSet<String> {
    documented_in("pve-sim.md", head)
}

/// Returns the same for another page.
fn documented_in(page: &str, head: &str) -> BTreeSet<String> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(page);
    let page = fs::read_to_string(page).expect("the page");
    let table = page.lines().skip_while(|line| !line.starts_with(head)).take_while(|line| line.starts_with('|'));
    let cells = table.skip(2).filter_map(|line| line.split('|').nth(1));
    let name = |name: &str| name.trim().trim_matches('`').split(' ').next().expect("a word").to_owned();
    cells
        .flat_map(|cell| cell.trim().trim_end_matches("repeatable").split(", "))
        .map(name)
        .filter(|name| !name.is_empty())
        .collect()
}

fn names(lines: &[Line]) -> BTreeSet<String> {
    lines.iter().map(|(name, ..)| (*name).to_owned()).collect()
}

/// Returns the words of a command line, with the bus of the test if the line has none, and a folder of its own.
fn words(line: &str, folder: &Path) -> Vec<String> {
    let bus = if line.contains("--bus") { String::new() } else { format!("--bus {ANY_PORT} ") };
    let line = format!("{bus}{line}").replace("DIR", folder.to_str().expect("text"));
    line.split(' ').map(str::to_owned).collect()
}

/// Types each line right and wrong, after common words.
fn type_each(lines: &[Line], common: &str) {
    for (name, right, wrong, accepted) in lines {
        let folder = tempfile::tempdir().expect("a folder");
        let typed = |line: &str| words(&format!("{common}{line}"), folder.path());
        let line = typed(right);
        let simulator = Simulator::start(&line.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(simulator.ready.starts_with("pve-sim ready "), "{name}: {line:?}");
        drop(simulator);
        let line = typed(wrong);
        let refusal = refusal(&line.iter().map(String::as_str).collect::<Vec<_>>(), 2);
        assert!(refusal.starts_with("pve-sim: ") && refusal.contains(accepted), "{name}: {refusal}");
    }
}

/// Returns the options in a help text.
fn shown(arguments: &[&str]) -> BTreeSet<String> {
    let help = String::from_utf8(output(arguments).stdout).expect("text");
    let words = help.split(|c: char| c.is_whitespace() || c == '[').filter(|word| word.starts_with("--")).map(|word| {
        let end = word.find(|c: char| !(c.is_ascii_lowercase() || c == '-')).unwrap_or(word.len());
        word[..end].to_owned()
    });
    let of_clap = ["--help", "--version"].map(str::to_owned);
    words.filter(|option| !of_clap.contains(option)).collect()
}

#[test]
fn every_option_of_scenario() {
    let mut documented = documented_in("scenarios.md", "| word |");
    assert!(documented.remove("FILE.toml…"));
    assert_eq!(shown(&["scenario", "--help"]), documented);
}

#[test]
fn every_option() {
    let mut shown = shown(&["--help"]);
    for option in ["--junit", "--html"] {
        assert!(shown.remove(option), "an example of another command");
    }
    let typed = names(OPTIONS);
    assert_eq!(documented("| option |"), typed);
    assert!(shown.is_subset(&typed), "{shown:?}");
    type_each(OPTIONS, "");
}

/// The help and the page have each form that a refusal accepts.
#[test]
fn every_form_of_a_bus() {
    let refusal = refusal(&["--bus", "can0"], 2);
    let (_, forms) = refusal.rsplit_once("accepted: ").expect("a list");
    let help = String::from_utf8(output(&["--help"]).stdout).expect("text");
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/pve-sim.md")).expect("the page");
    let option = page.lines().find(|line| line.starts_with("| `--bus URL`")).expect("a row");
    for form in forms.split(", ") {
        assert!(help.contains(&format!("  {form} ")), "{form} is missing in --help");
        assert!(option.contains(&format!("`{form}`")), "docs/pve-sim.md: {form} is missing at --bus");
        assert!(page.contains(&format!("\n| `{form}` |")), "docs/pve-sim.md: {form} is missing in the table of buses");
    }
}

#[test]
fn every_part_of_a_device() {
    assert_eq!(documented("| part |"), names(PARTS));
    type_each(PARTS, "");
}

#[test]
fn every_key_of_a_link() {
    assert_eq!(documented("| key |"), names(KEYS));
    type_each(KEYS, "--device pvea-canopen --device hat1000,bit-rate=250k ");
}

#[test]
fn every_word_on_stdin() {
    let typed: BTreeSet<String> = names(VALVE_WORDS).union(&names(ENCODER_WORDS)).cloned().collect();
    assert_eq!(documented("| word |"), typed);
    type_words("pvea-canopen", VALVE_WORDS);
    type_words("hat1000", ENCODER_WORDS);
}

/// Types each word right and wrong on the console of a simulator with one device.
fn type_words(kind: &str, lines: &[Line]) {
    let mut simulator =
        Simulator::spawn(pve_sim(&["--no-http", "--bus", ANY_PORT, "--device", kind]).stdin(Stdio::piped()));
    let mut stdin = simulator.process.stdin.take().expect("a pipe");
    let mut stderr = BufReader::new(simulator.process.stderr.take().expect("a pipe")).lines();
    // An answer ends before the next one: `status` begins with the name of the device, `help` ends with its own line.
    let mut answer = |line: &str, wanted: &str| {
        writeln!(stdin, "{line}").expect("it reads");
        let answer = stderr.find_map(|told| told.ok().filter(|told| told.contains(wanted)));
        assert!(answer.is_some(), "{line}");
    };
    for (name, right, wrong, accepted) in lines {
        let told = match *name {
            "status" => "pvea-canopen: ",
            "help" => "help                   this text",
            _ => "ok",
        };
        answer(right, told);
        answer(wrong, &format!("'{wrong}' is not a valid command; accepted: "));
        answer(wrong, accepted);
    }
}

#[test]
fn every_command() {
    for (right, wrong, accepted) in [
        ("run --help", "walk", "accepted: run, use-case, scenario, campaign, decode, replay, set, status, eds, dbc,"),
        ("use-case 1", "use-case 7", "accepted: 1, 2, 3, 4, 5, 6, isobus, hat, all"),
        ("scenario --schema", "scenario", "FILE.toml"),
        ("scenario --help", "scenario --junit x.toml y.toml", "use a file for the results, as in results.xml"),
        ("decode --help", "decode", "<FILE>"),
        ("replay --help", "replay frames.log", "--device <KIND[@ID][,KEY=VALUE…]>"),
        ("replay --help", "replay frames.log --device pvea-canopen --tolerance-ms 60001", "0..=60000"),
        ("set --help", "set boom", "<WORD=VALUE>"),
        ("set --help", "set boom supply_mv", "'supply_mv' for '<WORD=VALUE>...': must be WORD=VALUE, as in"),
        ("set --help", "set boom lever=0 lever=off", "duplicate word lever"),
        ("status --help", "status --http 127.0.0.1:0", "must be ADDR:PORT, as in 127.0.0.1:8408"),
        ("eds hat3000", "eds pvea-isobus", "pvea-canopen|pveo-canopen|hat1000|hat3000"),
        ("dbc pveo-isobus", "dbc hat1000", "pvea-isobus|pveo-isobus"),
        ("completions bash", "completions tcsh", "bash, elvish, fish, powershell, zsh"),
        ("man", "man run", "'run'"),
        ("help use-case", "help walk", "'walk'"),
    ] {
        assert_eq!(output(&right.split(' ').collect::<Vec<_>>()).status.code(), Some(0), "{right}");
        let refusal = refusal(&wrong.split(' ').collect::<Vec<_>>(), 2);
        assert!(refusal.contains(accepted), "{wrong}: {refusal}");
    }
}
