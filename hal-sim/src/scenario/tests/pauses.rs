//! Runs that are paused and replaced by their clones.

use std::fs;
use std::path::Path;

use protocol_core::time::{Duration, Instant, after};

use super::*;
use crate::scenario::runner::Run;

/// Runs a scenario in pieces of length `span`. A clone continues after each piece.
fn in_pieces(scenario: &Scenario, span: Duration) -> Outcome {
    let (mut run, mut target) = (Run::new(scenario, true), scenario.powered(1));
    let mut until = Instant::from_ticks(0);
    while !run.advance(&mut target, until, &mut ()) {
        (run, target) = (run.clone(), target.clone());
        until = after(until, span);
    }
    run.outcome(&target)
}

fn is_the_same_in_pieces(scenario: &Scenario, name: &str) {
    let whole = scenario.run_traced(1);
    for micros in [9_973, 31_013] {
        let pieces = in_pieces(scenario, Duration::from_micros(micros));
        assert_eq!(pieces.trace, whole.trace, "{name}");
        assert_eq!(pieces, whole, "{name}");
    }
}

#[test]
fn a_run_in_pieces_is_the_run_at_once() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let mut files = 0;
    for entry in fs::read_dir(folder).expect("the scenarios") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|end| end == "toml") {
            let text = fs::read_to_string(&path).expect("a scenario");
            is_the_same_in_pieces(&Scenario::parse(&text).expect("a scenario"), &path.display().to_string());
            files += 1;
        }
    }
    assert!(files > 20, "{files}");
}

#[test]
fn failures_are_the_same_in_pieces() {
    let device = "devices = [\"pvea-canopen@0x20\"]\n";
    for (failures, text) in [
        (
            4,
            format!(
                "{device}steps = [{{ expect = \"720#01\" }}, {{ never = \"0A0\" }}, {ACTIVE}, {{ at_ms = 5 }}, {{ stop = \"220\", expect = {{ dsm = \"hold\" }} }}, {{ plant = {{ supply_mv = 1000 }} }}, {{ after_ms = 3000 }}]"
            ),
        ),
        (1, format!("{device}strict = true\nsteps = [{{ expect = \"720#00\", every_ms = 9 }}, {{ after_ms = 500 }}]")),
    ] {
        let scenario = Scenario::parse(&text).expect(&text);
        let outcome = scenario.run(1);
        assert_eq!(outcome.failures.len(), failures, "{}", outcome.failures("x.toml"));
        is_the_same_in_pieces(&scenario, &text);
    }
}
