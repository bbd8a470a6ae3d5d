//! Instants: effects that end before the next sample, and the exact times of positions.

use super::judge_tests::judged;
use super::*;

const ISOBUS: &str = r#"
devices = ["pvea-isobus@0x80,name=valve"]
steps = [{ expect = "18EEFF80" }, { at_ms = 1500 }]
"#;

const SENSOR: &str = r#"
devices = ["hat1000@1,bit-rate=250k,name=hat"]
steps = [{ expect = "701#00" }, { send = "000#0101" }, { at_ms = 1500 }]
"#;

/// A master that stops its valve at an EMCY or a missing heartbeat.
const VALVE: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
reactions = [
  { on = "0A0", from_ms = 100, stop = "220" },
  { missing = "720", for_ms = 253, send = "000#0220" },
  { missing = "720", for_ms = 253, stop = "220" },
]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "620#2B17 1000 6400 0000", expect = "5A0#60.." },
  { send = "000#0120" },
  { send = "220#0F00 0020", every_ms = 50, expect = { dsm = "active", position = 8192 } },
  { at_ms = 2000 },
]
"#;

fn plan(scenario: &str, fault: &str, step_ms: u32, oracles: &str) -> Plan {
    let to_ms = 1000 + step_ms * 9;
    let text = format!(
        "scenario = \"x\"\nfaults = [{fault}]\ninstants = {{ from_ms = 1000, to_ms = {to_ms}, step_ms = {step_ms} }}\n\
         {oracles}\nobserve_ms = 600"
    );
    Plan::parse(&text, |_| Ok(scenario.to_owned())).unwrap_or_else(|error| panic!("{text}: {error:?}"))
}

/// Returns the results of the ten cells of the grid.
fn cells(plan: &Plan) -> Vec<CellResult> {
    let campaign = Campaign::new(plan).unwrap_or_else(|error| panic!("{error}"));
    (0..10).map(|number| campaign.numbered(number).and_then(|cell| campaign.cell(cell)).expect("a cell")).collect()
}

/// A proof that never comes, and a safe state that is never reached.
const NEVER_SAFE: &str = "detected = { expect = \"7F0\", within_ms = 100 }";

const BETWEEN: [(&str, &str); 9] = [
    (ISOBUS, "{ plant = { internal_fault = true }, for_ms = 3 }"),
    (ISOBUS, "{ power = { on = false }, for_ms = 5 }"),
    (ISOBUS, "{ power = { reset = \"watchdog\" } }"),
    (ISOBUS, "{ plant = { lever = 16384 }, for_ms = 3 }"),
    (SENSOR, "{ power = { on = false }, for_ms = 5 }"),
    (SENSOR, "{ power = { reset = \"watchdog\" } }"),
    (SENSOR, "{ insert = \"000#8101\" }"),
    (SENSOR, "{ insert = \"000#8201\" }"),
    (VALVE, "{ plant = { internal_fault = true }, for_ms = 3 }"),
];

#[test]
fn an_effect_that_ends_before_the_next_sample_is_found() {
    for (scenario, fault) in BETWEEN {
        let plan = plan(scenario, fault, 7, NEVER_SAFE);
        let silent: Vec<CellResult> =
            cells(&plan).into_iter().filter(|cell| cell.verdict == Verdict::NoEffect).collect();
        assert!(silent.is_empty(), "{fault}: {silent:?}");
    }
}

#[test]
fn an_effect_before_the_next_sample_is_found_with_a_controller_outside() {
    for (scenario, fault) in BETWEEN.into_iter().filter(|(scenario, _)| *scenario == ISOBUS) {
        // Without an exact controller, positions are not compared.
        let is_exact = if fault.contains("lever") { vec![true] } else { vec![true, false] };
        let plan = Box::leak(Box::new(plan(scenario, fault, 7, NEVER_SAFE)));
        let campaign = Box::leak(Box::new(Campaign::new(plan).unwrap_or_else(|error| panic!("{error}"))));
        for (number, is_exact) in (0..10).flat_map(|number| is_exact.iter().map(move |is_exact| (number, *is_exact))) {
            let (result, _) = judged(campaign, number, is_exact, &[]);
            assert_ne!(result.verdict, Verdict::NoEffect, "{fault}, exact: {is_exact}: {result:?}");
        }
    }
}

#[test]
fn a_position_is_reached_at_the_same_time_whatever_the_instant() {
    for oracle in ["safe", "detected"] {
        let oracles = format!("{oracle} = {{ expect = {{ position = {{ max = 8100 }} }}, within_ms = 252 }}");
        let plan = plan(VALVE, "{ plant = { temperature_c = 130 } }", 3, &oracles);
        let cells = cells(&plan);
        let times: Vec<_> = cells.iter().map(CellResult::reaction_us).collect();
        assert!(times[0].is_some() && times.iter().all(|time| *time == times[0]), "{oracle}: {times:?}");
    }
}

/// The movement begins with a frame of the master, which no event of the bus announces.
#[test]
fn a_position_that_a_frame_of_the_master_begins_to_change_has_an_exact_time() {
    for span in ["", ", for_ms = 1"] {
        let limits = if span.is_empty() { "max = 8100" } else { "min = 7900, max = 8100" };
        let oracles = format!("safe = {{ expect = {{ position = {{ {limits} }} }}, within_ms = 500{span} }}");
        let plan = plan(VALVE, "{ lose = \"720\" }", 1, &oracles);
        let cells = cells(&plan);
        // A heartbeat comes every 100 ms; the master misses the first one after the fault.
        let ends: Vec<_> = cells.iter().map(|cell| cell.safe_us.map(|safe| (cell.at_us + safe) % 100_000)).collect();
        assert!(ends[0].is_some() && ends.iter().all(|end| *end == ends[0]), "{span}: {ends:?}");
    }
}
