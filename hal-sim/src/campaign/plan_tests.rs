//! Accepted and refused plans.

use std::collections::BTreeSet;

use super::Plan;
use crate::scenario::ReadError;

const SCENARIO: &str = r#"
devices = ["pvea-canopen@0x20,name=valve", "hat1000@1,bit-rate=250k,name=boom"]
steps = [{ expect = "720#00" }, { send = "220#0F00 0010", every_ms = 50 }, { at_ms = 500 }]
"#;

/// The beginning of each plan: two lines.
const HEAD: &str = "scenario = \"drive.toml\"\ninstants = { from_ms = 0, to_ms = 100, step_ms = 10 }\n";

const SAFE: &str = "safe = { device = \"valve\", expect = { solenoids = false }, within_ms = 100 }\n";

fn read(text: &str) -> Result<Plan, ReadError> {
    Plan::parse(text, |path| match path {
        "drive.toml" => Ok(SCENARIO.to_owned()),
        _ => Err(format!("{path}: no such file")),
    })
}

fn refusal(text: &str) -> (usize, String) {
    let ReadError { line, reason } = read(text).expect_err(text);
    (line.expect("a line"), reason)
}

#[test]
fn values_in_lists_are_varied() {
    let faults = r#"faults = [
  { plant = { supply_mv = [8000, 40000], temperature_c = [20, 130] }, device = "valve", for_ms = [100, 200] },
  { lose = "220", receivers = ["valve"], count = [1, 2, 5], reference = "IEC 61784-3: loss" },
  { delay = "220", ms = [5, 20] }, { delay = "220", ms = [5, 20, 50] },
  { power = { on = false }, device = ["valve", "boom"], for_ms = 50 },
  "all-of-pve", "communication",
]
"#;
    let plan = read(&format!("{HEAD}{SAFE}{faults}")).expect("a plan");
    let texts: Vec<Vec<&str>> = plan
        .faults
        .iter()
        .map(|entry| match entry {
            super::plan::Entry::Own(faults) => faults.iter().map(|fault| &*fault.text).collect(),
            super::plan::Entry::Communication => vec!["communication"],
        })
        .collect();
    assert_eq!(texts[0].len(), 8);
    assert_eq!(texts[0][0], "valve: for_ms = 100, supply_mv = 8000, temperature_c = 20");
    assert_eq!(texts[1], ["lose 220 for valve, count 1", "lose 220 for valve, count 2", "lose 220 for valve, count 5"]);
    assert_eq!((texts[2].len(), texts[3].len()), (1, 3));
    assert_eq!(texts[4], ["valve: power off for 50 ms", "boom: power off for 50 ms"]);
    assert_eq!((texts[5].len(), &*texts[6]), (13, &["communication"][..]));
    assert_eq!(plan.observe().as_millis(), 300);
}

#[test]
fn a_mistake_is_named_with_its_line_and_the_accepted_values() {
    let with = |rest: &str| refusal(&format!("{HEAD}{SAFE}{rest}"));
    let in_fault = |fault: &str| with(&format!("faults = [\n  {fault},\n]\n"));
    for (fault, wanted) in [
        ("{ plant = { suply_mv = 8000 }, device = \"valve\" }", "did you mean 'supply_mv'?"),
        (
            "{ plant = { supply_mv = [8000, 200000] }, device = \"valve\" }",
            "a whole number from 0 to 100000, or a list",
        ),
        ("{ plant = { supply_mv = 8000 } }", "device is missing; accepted: valve, boom"),
        ("{ plant = { supply_mv = 8000 }, device = \"boom\" }", "not a plant word of this kind"),
        ("{ plant = { supply_mv = 8000 }, device = \"valve\", count = 1 }", "count is a key of communication faults"),
        ("{ lose = \"220\", receivers = [\"bom\"] }", "no device or client 'bom'"),
        ("{ lose = \"220\", sender = \"none\" }", "no device or client 'none'"),
        ("{ loose = \"220\" }", "did you mean 'lose'?"),
        ("{ lose = \"220\", delay = \"220\" }", "a fault has exactly one of"),
        ("{ power = { on = true }, device = \"valve\", for_ms = 5 }", "for_ms is only valid with { on = false }"),
        ("{ reference = \"nothing\" }", "a fault needs exactly one of plant, power, lose"),
        ("\"all-of-pv\"", "did you mean 'all-of-pve'?"),
        ("{ lose = \"220\", count = [] }", "count: empty list; give at least one value"),
        ("{ plant = { supply_mv = [] }, device = \"valve\" }", "supply_mv: empty list; give at least one value"),
    ] {
        let (line, reason) = in_fault(fault);
        assert!(line == 5 && reason.contains(wanted), "{fault}: {line}: {reason}");
    }
    for (rest, line, wanted) in [
        ("faults = []", 4, "empty list"),
        ("faults = [\"all-of-pve\"]\nseeds = []", 5, "seeds: empty list"),
        ("faults = [\"all-of-pve\"]\nseeds = [1, 2, 1]", 5, "seeds: 1 is given twice"),
        ("faults = [\"all-of-pve\"]\nseed = 1", 5, "did you mean 'seeds'?"),
        ("faults = [\"all-of-pve\"]\nobserve_ms = 99", 5, "observe_ms of at least 100"),
        (
            "faults = [\"all-of-pve\"]\ndetected = { within_ms = 5 }",
            5,
            "expect and stops are both missing; give expect",
        ),
        ("faults = [\"all-of-pve\"]\ndetected = { stops = \"220\", within_ms = 5 }", 5, "for_ms is missing"),
        ("faults = [\"all-of-pve\"]\ndetected = { expect = \"22#\", within_ms = 5 }", 5, "invalid identifier"),
        (
            "faults = [\"all-of-pve\"]\ndetected = { expect = { dsm = \"hold\" }, device = \"boom\", within_ms = 5 }",
            5,
            "dsm is never \"hold\" on boom",
        ),
    ] {
        let told = with(rest);
        assert!(told.0 == line && told.1.contains(wanted), "{rest}: {told:?}");
    }
    let no_oracle = refusal(&format!("{HEAD}faults = [\"all-of-pve\"]"));
    assert!(no_oracle.1.contains("a plan needs detected, safe, or both"), "{no_oracle:?}");
    let (line, reason) =
        refusal("scenario = \"other.toml\"\nfaults = []\ninstants = { from_ms = 0, to_ms = 0, step_ms = 1 }");
    assert_eq!((line, &*reason), (1, "scenario: other.toml: no such file"));
}

#[test]
fn a_state_that_never_holds_proves_nothing() {
    for (expect, wanted) in [
        ("{ position = { min = 100, max = -100 } }", "min 100 is above max -100"),
        ("{ node_id = 200 }", "node_id is never 200 on valve"),
        ("{ powered = true, powered = false }", ""),
        ("{ t_us = 5 }", "t_us is an instant"),
        ("{ position = { min = -16384 } }", "always true"),
        ("{ dmm = \"hold\" }", "did you mean 'dsm'?"),
    ] {
        let safe = format!("safe = {{ device = \"valve\", expect = {expect}, within_ms = 100 }}\n");
        let (line, reason) = refusal(&format!("{HEAD}{safe}faults = [\"all-of-pve\"]"));
        assert!(line == 3 && reason.contains(wanted), "{expect}: {line}: {reason}");
    }
}

#[test]
fn more_than_ten_million_cells_are_refused() {
    let steps = |step: u32| {
        format!(
            "scenario = \"drive.toml\"\ninstants = {{ from_ms = 0, to_ms = 999999, step_ms = {step} }}\n{SAFE}faults = [\n  {}\n]",
            "{ plant = { supply_mv = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10] }, device = \"valve\" },\n".repeat(2)
        )
    };
    assert!(read(&steps(2)).is_ok());
    let (line, reason) = refusal(&steps(1));
    assert_eq!(line, 6);
    assert!(reason.contains("20000000 cells") && reason.contains("more than 10000000"), "{reason}");
    for (set, cells) in [("all-of-pve", 13_000_000), ("communication", 14_000_000)] {
        let to_ms = cells / if set == "communication" { 7 } else { 13 } - 1;
        let (line, reason) = refusal(&format!(
            "scenario = \"drive.toml\"\ninstants = {{ from_ms = 0, to_ms = {to_ms}, step_ms = 1 }}\n{SAFE}faults = [\"{set}\"]"
        ));
        assert!(line == 4 && reason.contains(&format!("{cells} cells")), "{line}: {reason}");
    }
}

/// The published schema is that of this version. `RENEW_SCHEMA=1` writes the schema.
#[test]
fn the_schema_for_editors_is_in_the_docs() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/campaign.schema.json");
    if std::env::var_os("RENEW_SCHEMA").is_some() {
        std::fs::write(&path, super::schema()).expect("the copy");
    }
    let copy = std::fs::read_to_string(path).unwrap_or_default().replace('\r', "");
    assert!(
        copy == super::schema(),
        "RENEW_SCHEMA=1 cargo test -p hal-sim --all-features --lib the_schema_for_editors"
    );
}

/// The schema has the keys that the reader accepts.
#[test]
fn the_schema_has_the_keys_of_the_reader() {
    let schema: serde_json::Value = serde_json::from_str(&super::schema()).expect("JSON");
    let keys = |schema: &serde_json::Value| {
        let keys: BTreeSet<String> = schema["properties"].as_object().expect("keys").keys().cloned().collect();
        keys
    };
    let accepted = |text: &str| {
        let reason = read(text).expect_err(text).reason;
        let (_, accepted) = reason.rsplit_once("accepted: ").expect("a list");
        accepted.split(", ").map(str::to_owned).collect::<BTreeSet<String>>()
    };
    assert_eq!(keys(&schema), accepted("qqq = 1"));
    let defs = &schema["$defs"];
    assert_eq!(keys(&defs["FaultTable"]), accepted(&format!("{HEAD}{SAFE}faults = [{{ qqq = 1 }}]")));
    assert_eq!(keys(&defs["PlantChange"]), accepted(&format!("{HEAD}{SAFE}faults = [{{ plant = {{ qqq = 1 }} }}]")));
    assert_eq!(keys(&defs["Detected"]), accepted(&format!("{HEAD}detected = {{ qqq = 1 }}\nfaults = []")));
    assert!(!schema.to_string().contains("\"null\"") && !schema.to_string().contains("components"), "{schema:#}");
}
