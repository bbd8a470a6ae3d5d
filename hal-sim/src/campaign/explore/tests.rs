//! The search for pairs of faults: finds, their shortest form, and their scenarios.

use super::*;
use crate::campaign::Plan;
use crate::scenario::Scenario;

/// A master that stops its valve when the spool is beyond 50 %.
const RUNAWAY: &str = r#"
title = "A valve at 25 %"
devices = ["pvea-canopen@0x20,name=valve"]
reactions = [{ on = "1A0#0F00 ??2?", from_ms = 50, send = "000#0220" }, { on = "1A0#0F00 ??3?", send = "000#0220" }]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "000#0120" },
  { send = "220#0F00 0010", every_ms = 50, expect = { dsm = "active", position = 4096 } },
  { at_ms = 400, note = "nothing", send = "7FF#00" },
  { at_ms = 500, expect = { dsm = "active" } },
]
"#;

/// Faults that corrupt the set-point or lose the answers, and faults without consequence.
const RUNAWAY_PLAN: &str = r#"
scenario = "x"
faults = [
  { corrupt = "220", data = { toggle = "000000 20" } },
  { lose = "1A0", for_ms = [50, 377] },
  { plant = { temperature_c = [30, 60] } },
]
instants = { from_ms = 300, to_ms = 450, step_ms = 10 }
safe = { expect = { position = { min = -5000, max = 5000 } }, within_ms = 250 }
observe_ms = 400
"#;

fn plan(text: &str, scenario: &str) -> Plan {
    Plan::parse(text, |_| Ok(scenario.to_owned())).unwrap_or_else(|error| panic!("{error:?}"))
}

/// Searches for some rounds. Returns the finds, and the counters of the search.
fn search(plan: &Plan, seed: u64, rounds: usize) -> (Vec<Find>, Vec<u64>) {
    let campaign = Campaign::new(plan).unwrap_or_else(|error| panic!("{error}"));
    let mut explorer = Explorer::new(&campaign, seed);
    let mut finds = Vec::new();
    for _ in 0..rounds {
        let pairs = explorer.round();
        // In two parts, as two threads do.
        let (one, other) = pairs.split_at(17);
        let tried = [campaign.run_pairs(one), campaign.run_pairs(other)].into_iter().flatten();
        for (pair, tried) in pairs.iter().cloned().zip(tried) {
            finds.extend(explorer.take(pair, tried));
        }
    }
    let numbers = [explorer.states(), explorer.corpus()].map(|count| count as u64);
    let numbers = [&numbers[..], &[explorer.pairs, explorer.singles, explorer.not_injected]].concat();
    (finds, numbers)
}

/// Returns the failures of a scenario.
fn failures(text: &str) -> String {
    Scenario::parse(text).unwrap_or_else(|error| panic!("{error:?}\n{text}")).run(1).failures("find.toml")
}

/// Returns a scenario without the line that contains a text.
fn without(text: &str, mark: &str) -> String {
    text.lines().filter(|line| !line.contains(mark)).map(|line| format!("{line}\n")).collect()
}

#[test]
fn a_pair_that_only_together_fails_is_found_and_written() {
    let (finds, numbers) = search(&plan(RUNAWAY_PLAN, RUNAWAY), 1, 2);
    let find = finds.iter().find(|find| find.verdict == Verdict::NotSafe).expect("a find");
    // An answer after some 350 ms would be in time for the end of the observation, and the verdict another.
    assert_eq!(find.faults, "corrupt 220, data toggle 00000020 at 400 ms; lose 1A0, for 370 ms at 400 ms");
    let text = find.scenario.clone().expect("a scenario");
    assert!(failures(&text).contains("-- still safe"), "{text}\n{}", failures(&text));
    assert!(!text.contains("7FF"), "a step after the faults: {text}");
    for fault in ["the first fault", "the second fault"] {
        assert_eq!(failures(&without(&text, fault)), "", "{text}");
    }
    let [states, corpus, pairs, ..] = numbers[..] else { unreachable!() };
    assert_eq!(pairs, 2 * ROUND as u64);
    assert!(0 < corpus && corpus < pairs / 2 && corpus < states, "{numbers:?}");
}

#[test]
fn the_same_seed_gives_the_same_finds() {
    let plan = plan(RUNAWAY_PLAN, RUNAWAY);
    let (first, other) = (search(&plan, 7, 1), search(&plan, 8, 1));
    assert_eq!(first, search(&plan, 7, 1));
    assert_ne!(first.1, other.1);
}

/// A master that stops its valve at an EMCY.
const EMCY: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
reactions = [{ on = "0A0", from_ms = 50, send = "000#0220" }, { on = "0A0", from_ms = 50, stop = "220" }]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "000#0120" },
  { send = "220#0F00 0010", every_ms = 50, expect = { dsm = "active", position = 4096 } },
  { at_ms = 500 },
]
"#;

#[test]
fn a_broken_detection_is_an_expectation_since_the_first_fault() {
    for (detected, line) in [
        ("expect = \"000#02..\"", "since_ms = "),
        ("stops = \"220\", for_ms = 60", "never = \"220\""),
        ("expect = { nmt = \"stopped\" }", "nmt = \"stopped\""),
    ] {
        let text = format!(
            "scenario = \"x\"\nfaults = [{{ plant = {{ internal_fault = true }} }}, {{ lose = \"0A0\", count = [7, 9] }}]\n\
             instants = {{ from_ms = 300, to_ms = 450, step_ms = 10 }}\nobserve_ms = 400\n\
             detected = {{ {detected}, within_ms = 80 }}\nsafe = {{ expect = {{ solenoids = false }}, within_ms = 80 }}"
        );
        let (finds, _) = search(&plan(&text, EMCY), 1, 1);
        let faults: Vec<&str> = finds.iter().map(|find| find.faults.as_str()).collect();
        assert_eq!(faults, ["valve: internal_fault = true at 400 ms; lose 0A0, count 1 at 400 ms"], "{detected}");
        let text = finds[0].scenario.clone().expect("a scenario");
        let failed = failures(&text);
        assert!(failed.contains("-- detected") && !failed.contains("-- safe"), "{text}\n{failed}");
        assert!(text.contains(line), "{text}");
        assert_eq!(failures(&without(&text, "lose = ")), "", "{text}");
    }
}

#[test]
fn a_pair_with_a_fault_that_fails_alone_is_no_find() {
    let alone = RUNAWAY_PLAN.replace("within_ms = 250", "within_ms = 50");
    let (finds, numbers) = search(&plan(&alone, RUNAWAY), 1, 1);
    assert!(finds.iter().all(|find| !find.faults.contains("corrupt")), "{finds:?}");
    assert!(numbers[3] > 10, "{numbers:?}");
}
