//! Help, version, refusals, and what is printed for other tools.

use super::expected::{check, check_all};
use super::program::{printed, run};

const COMMANDS: [&str; 13] = [
    "run",
    "use-case",
    "scenario",
    "campaign",
    "campaign merge",
    "decode",
    "replay",
    "set",
    "status",
    "eds",
    "dbc",
    "completions",
    "man",
];

/// Each line alone is refused, with exit code 2 and one line.
const REFUSALS: &str = include_str!("refusals.txt");

/// The version is that of the workspace, and changes with each release.
fn without_version(text: &str) -> String {
    text.replace(concat!("pve-sim ", env!("CARGO_PKG_VERSION")), "pve-sim VERSION")
        .replace(concat!("v", env!("CARGO_PKG_VERSION")), "vVERSION")
}

/// Command lines with all that came of them.
fn transcript<S: AsRef<str>>(lines: impl IntoIterator<Item = S>) -> String {
    let one = |line: S| {
        let words: Vec<&str> = line.as_ref().split(' ').filter(|word| !word.is_empty()).collect();
        run(&words).transcript(line.as_ref())
    };
    without_version(&lines.into_iter().map(one).collect::<String>())
}

#[test]
fn help() {
    let helps = COMMANDS.iter().flat_map(|command| [format!("{command} --help"), format!("{command} -h")]);
    let lines = ["--help", "-h", "--version", "-V", "help"].map(str::to_owned).into_iter().chain(helps);
    let more = ["help use-case", "help help", "use-case"].map(str::to_owned);
    check("texts/help.txt", &transcript(lines.chain(more)));
}

#[test]
fn refusals() {
    check("texts/refusals.txt", &transcript(REFUSALS.lines()));
}

#[test]
fn the_manual_page() {
    check("texts/pve-sim.1", &without_version(&printed(&["man"])));
}

#[test]
fn completions() {
    let shells = ["bash", "zsh", "fish", "powershell", "elvish"];
    check_all(&shells.map(|shell| (format!("texts/completions.{shell}"), printed(&["completions", shell]))));
}

/// Of two kinds that are one but for their names, the second is told by what differs.
#[test]
fn descriptions() {
    let of = |kind: &str| printed(&[if kind.ends_with("isobus") { "dbc" } else { "eds" }, kind]);
    let pairs = [
        ("pvea-canopen.eds", "pveo-canopen.eds"),
        ("hat1000.eds", "hat3000.eds"),
        ("pvea-isobus.dbc", "pveo-isobus.dbc"),
    ];
    let kind = |file: &str| file.split('.').next().map(of).expect("a kind");
    let texts = pairs.into_iter().flat_map(|(first, second)| {
        let (text, other) = (kind(first), kind(second));
        let differences = differences(&text, &other);
        [(format!("texts/{first}"), text), (format!("texts/{second}.differences"), differences)]
    });
    check_all(&texts.collect::<Vec<_>>());
}

/// The lines of a text that are not those of another one of as many lines, each with its number.
fn differences(text: &str, other: &str) -> String {
    assert_eq!(text.lines().count(), other.lines().count(), "as many lines");
    let lines = text.lines().zip(other.lines()).enumerate().filter(|(_, (line, other))| line != other);
    lines.map(|(number, (_, other))| format!("{}: {other}\n", number + 1)).collect()
}

#[test]
fn the_schema_of_scenarios() {
    let schema = printed(&["scenario", "--schema"]);
    let page = std::fs::read_to_string(super::program::root().join("docs/scenario.schema.json")).expect("a file");
    assert!(schema == page, "docs/scenario.schema.json is not what pve-sim scenario --schema prints");
}
