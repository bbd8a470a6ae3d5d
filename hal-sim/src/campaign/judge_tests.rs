//! Cells whose controller is outside this library: a proof that holds without a fault proves nothing.

use super::*;
use crate::Duration;
use crate::devices::CONTROL;
use crate::simulation::{Command, Simulation};

/// A valve in ACTIVE, whose master hears nobody.
const SCENARIO: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "000#0120" },
  { send = "220#0F00 0010", every_ms = 50, expect = { dsm = "active" } },
  { at_ms = 500 },
]
"#;

/// Runs a cell whose controller is outside, and sends cyclic frames from the start, each with its period in
/// milliseconds. Returns the result and its reason.
pub(super) fn judged(
    campaign: &'static Campaign<'static>,
    number: u64,
    is_exact: bool,
    frames: &[(&str, u64)],
) -> (CellResult, Option<String>) {
    let cell = campaign.numbered(number).expect("a cell");
    let (mut simulation, mut judge) = Judge::new(campaign, cell, is_exact).expect("a row");
    simulation.send_as(CONTROL);
    simulation.power_up(Duration::from_millis(0));
    for (frame, ms) in frames {
        let send = Command::Send(frame.parse().expect("a frame"), Some(Duration::from_millis(*ms)));
        simulation.execute(send).expect("a cyclic frame");
    }
    loop {
        go(&mut simulation, &mut judge);
        if let Some(result) = judge.result() {
            return (result.clone(), judge.reason().map(str::to_owned));
        }
    }
}

fn go(simulation: &mut Simulation, judge: &mut Judge) {
    simulation.go(judge.due());
    while let Some(happened) = simulation.take_event() {
        judge.event(&happened);
    }
    simulation.poll();
    judge.poll(simulation);
}

/// Returns the results of the cells at 300, 340 and 380 ms.
fn cells(detected: &str, frames: &[(&str, u64)]) -> [(CellResult, Option<String>); 3] {
    let text = format!(
        "scenario = \"x\"\nfaults = [{{ plant = {{ internal_fault = true }} }}]\nobserve_ms = 400\n\
         instants = {{ from_ms = 300, to_ms = 380, step_ms = 40 }}\ndetected = {{ {detected}, within_ms = 100 }}"
    );
    let plan = Plan::parse(&text, |_| Ok(SCENARIO.to_owned())).unwrap_or_else(|error| panic!("{text}: {error:?}"));
    let plan = Box::leak(Box::new(plan));
    let campaign = Box::leak(Box::new(Campaign::new(plan).unwrap_or_else(|error| panic!("{error}"))));
    [0, 1, 2].map(|number| judged(campaign, number, true, frames))
}

#[test]
fn a_proof_that_holds_before_the_fault_proves_nothing() {
    let start = [("000: 01 20", 50), ("220: 0F 00 00 10", 50), ("7F0:", 30)];
    let once = [start[0], ("220: 0F 00 00 10", 10_000)];
    for (detected, frames, at_ms, verdicts) in [
        // The frame that is due at 300 ms ends after the first fault.
        ("expect = \"7F0#\"", &start[..], 301, [Verdict::Safe, Verdict::NotInjected, Verdict::NotInjected]),
        ("expect = [\"7F0#\", \"220\"]", &start[..], 350, [Verdict::Safe, Verdict::Safe, Verdict::NotInjected]),
        // Nobody starts the valve.
        ("expect = { nmt = \"pre-operational\" }", &[][..], 300, [Verdict::NotInjected; 3]),
        ("stops = \"220\", for_ms = 120", &once[..], 300, [Verdict::NotInjected; 3]),
    ] {
        let reason =
            format!("detected: the proof holds without a fault, at {at_ms} ms (seed 1), and so proves nothing");
        for ((result, told), verdict) in cells(detected, frames).into_iter().zip(verdicts) {
            assert_eq!(result.verdict, verdict, "{detected}: {result:?}");
            let reason = (verdict == Verdict::NotInjected).then_some(&*reason);
            assert_eq!((told.as_deref(), result.struck > 0), (reason, reason.is_none()), "{detected}: {result:?}");
        }
    }
}

#[test]
fn a_proof_that_comes_after_the_fault_counts() {
    let start = [("000: 01 20", 50), ("220: 0F 00 00 10", 50)];
    for detected in ["expect = { dsm = \"fault-hold\" }", "expect = \"0A0#..\"", "expect = \"7F0\""] {
        for (result, reason) in cells(detected, &start) {
            let wanted = if detected.contains("7F0") { Verdict::SafeUndetected } else { Verdict::Safe };
            assert_eq!((result.verdict, result.struck, reason), (wanted, 1, None), "{detected}");
        }
    }
}
