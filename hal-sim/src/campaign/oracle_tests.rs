//! Oracles: frames that prove nothing, and safe states that no fault affects.

use super::*;

/// A valve in ACTIVE, and a master whose set-points stop when the heartbeat is missing.
const MASTER: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
reactions = [
  { missing = "720", for_ms = 150, send = "7F0#" },
  { missing = "720", for_ms = 150, stop = "220" },
]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "620#2B17 1000 3200 0000", expect = "5A0#60.." },
  { send = "000#0120" },
  { send = "220#0F00 0000", every_ms = 50, expect = { dsm = "active" } },
  { at_ms = 400, send = "220#0F00 0040", every_ms = 50 },
  { at_ms = 900 },
]
"#;

fn plan(fault: &str, oracles: &str, scenario: &str) -> Plan {
    let text = format!(
        "scenario = \"x\"\nfaults = [{fault}]\ninstants = {{ from_ms = 300, to_ms = 300, step_ms = 1 }}\n{oracles}\nobserve_ms = 800"
    );
    Plan::parse(&text, |_| Ok(scenario.to_owned())).unwrap_or_else(|error| panic!("{text}: {error:?}"))
}

fn result(fault: &str, oracles: &str) -> CellResult {
    result_of(fault, oracles, MASTER)
}

fn result_of(fault: &str, oracles: &str, scenario: &str) -> CellResult {
    let plan = plan(fault, oracles, scenario);
    let campaign = Campaign::new(&plan).unwrap_or_else(|error| panic!("{error}"));
    campaign.numbered(0).and_then(|cell| campaign.cell(cell)).expect("a cell")
}

#[test]
fn a_frame_that_the_fault_withholds_has_not_stopped() {
    let stops = "detected = { stops = \"220\", for_ms = 120, within_ms = 500 }";
    for fault in [
        "{ destroy = \"220\", for_ms = 200 }",
        "{ delay = \"220\", ms = 200 }",
        "{ delay = \"220\", burst_ms = 170 }",
        "{ corrupt = \"220\", identifier = { toggle = \"1\" }, for_ms = 200 }",
        "{ swap = \"220\", within_ms = 300 }",
        "{ lose = \"220\", for_ms = 200 }",
    ] {
        let result = result(fault, stops);
        assert!(result.detected_us.is_none() && result.struck > 0, "{fault}: {result:?}");
    }
}

#[test]
fn a_frame_that_the_fault_inserts_does_not_hide_the_silence_of_its_sender() {
    let stops = "detected = { stops = \"220\", for_ms = 120, within_ms = 500 }";
    // The master stops when the valve follows a set-point of a stranger, whose set-points go on.
    let master =
        MASTER.replace("reactions = [", "reactions = [{ on = \"1A0#0F00 ??10\", from_ms = 310, stop = \"220\" },");
    let master = master.replace("  { at_ms = 400, send = \"220#0F00 0040\", every_ms = 50 },\n", "");
    let result = result_of("{ masquerade = \"220#0F00 0010\", every_ms = 20 }", stops, &master);
    assert!(result.detected_us.is_some_and(|time| (120_000..500_000).contains(&time)), "{result:?}");
}

#[test]
fn a_frame_that_the_fault_corrupts_is_no_proof() {
    let proof = "detected = { expect = \"221#0F..\", within_ms = 500 }";
    let fault = "{ corrupt = \"220\", identifier = { toggle = \"1\" } }";
    assert_eq!(result(fault, proof).detected_us, None);
}

#[test]
fn a_proof_between_two_samples_of_the_golden_run_is_found() {
    let proof = "detected = { expect = { position = { min = 5005, max = 5010 } }, within_ms = 500 }";
    let plan = plan("{ plant = { supply_mv = 23000 } }", proof, MASTER);
    let refused = Campaign::new(&plan).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(refused.contains("the proof holds without a fault"), "{refused}");
}

#[test]
fn the_end_of_a_frame_that_never_comes_proves_nothing() {
    let plan = plan("{ lose = \"220\" }", "detected = { stops = \"7F1\", for_ms = 50, within_ms = 500 }", MASTER);
    let refused = Campaign::new(&plan).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(refused.contains("no frame 7F1 comes without a fault"), "{refused}");
}

#[test]
fn a_safe_state_needs_no_effect_of_the_fault() {
    let detected = "detected = { expect = \"7F0\", within_ms = 200 }";
    let master = MASTER.replace("  { missing = \"720\", for_ms = 150, stop = \"220\" },\n", "");
    for safe in [", for_ms = 20", ""] {
        let oracles = format!("{detected}\nsafe = {{ expect = {{ powered = true }}, within_ms = 100{safe} }}");
        let result = result_of("{ lose = \"720\", count = 4 }", &oracles, &master);
        assert_eq!((result.verdict, result.safe_us), (Verdict::Safe, Some(0)), "{safe}");
    }
}

/// After the end of a strict scenario, time advances regardless of the frames from its devices.
#[test]
fn a_fault_after_the_end_of_a_strict_scenario_comes_at_its_instant() {
    let scenario = r#"
strict = true
devices = ["pvea-canopen@0x20"]
steps = [
  { expect = ["720#00", "0A0#0000 0000 0000 0000"] },
  { send = "000#0120" },
  { send = "220#0B00 0000", expect = "1A0#.." },
  { send = "220#0B00 0000", expect = "1A0#.." },
  { send = "220#0F00 0010", expect = "1A0#.." },
  { at_ms = 200 },
]
"#;
    let plan =
        plan("{ insert = \"000#0220\" }", "safe = { expect = { nmt = \"stopped\" }, within_ms = 100 }", scenario);
    let campaign = Campaign::new(&plan).unwrap_or_else(|error| panic!("{error}"));
    // The valve notices the loss of its master at 256 ms.
    let trace = campaign.trace(campaign.numbered(0).expect("a cell")).expect("a trace");
    let line = trace.lines().find(|line| line.contains("fault insert-000")).expect("the fault");
    assert!(line.trim_start().starts_with("300.000 ms"), "{trace}");
}

/// A controller that sends frames but receives none.
#[derive(Clone)]
struct Deaf;

impl Controller for Deaf {
    fn poll(&mut self, can: &mut crate::Client, now: crate::Instant) -> crate::Instant {
        use embedded_can::nb::Can as _;
        let id = embedded_can::StandardId::new(0x7F1).expect("an identifier");
        let frame = embedded_can::Frame::new(id, &[]).expect("a frame");
        if now.as_micros().is_multiple_of(10_000) {
            can.transmit(&frame).expect("the world is there");
        }
        crate::Instant::from_millis((now.as_millis() / 10 + 1) * 10)
    }
}

#[test]
fn a_controller_that_receives_nothing_does_not_stop_the_time() {
    let plan = plan("{ lose = \"7F1\" }", "detected = { expect = \"7F0\", within_ms = 100 }", MASTER);
    let campaign = Campaign::with_controller(&plan, || Deaf).unwrap_or_else(|error| panic!("{error}"));
    let result = campaign.numbered(0).and_then(|cell| campaign.cell(cell)).expect("a cell");
    assert_eq!((result.verdict, result.struck > 20), (Verdict::NoEffect, true), "{result:?}");
}

#[test]
fn only_the_instants_of_the_plan_have_cells() {
    let text = "scenario = \"x\"\nfaults = [{ lose = \"220\" }]\ninstants = { from_ms = 300, to_ms = 350, step_ms = 20 }\n\
                safe = { expect = { powered = true }, within_ms = 100 }";
    let plan = Plan::parse(text, |_| Ok(MASTER.to_owned())).expect("a plan");
    let campaign = Campaign::new(&plan).unwrap_or_else(|error| panic!("{error}"));
    let has = |row, at_us| campaign.at(row, crate::Instant::from_micros(at_us)).is_some();
    assert!(has(0, 300_000) && has(0, 311_500) && has(0, 340_000));
    assert!(!has(0, 299_999) && !has(0, 340_001) && !has(1, 300_000) && !has(0, u64::MAX));
}
