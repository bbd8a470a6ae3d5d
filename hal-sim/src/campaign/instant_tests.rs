//! Instants: the exact times of positions.

use super::*;

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
