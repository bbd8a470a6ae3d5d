//! Strict scenarios: steps claim every frame from a device in order, and cyclic frames keep their period.

use super::*;

fn strictly(steps: &str) -> Outcome {
    let text = format!("strict = true\ndevices = [\"pvea-canopen@0x20\"]\nsteps = [\n{steps}\n]");
    Scenario::parse(&text).unwrap_or_else(|error| panic!("{error:?}")).run(1)
}

/// Runs the steps after boot and start, with one failure. Returns the report.
fn differs(steps: &str) -> String {
    let outcome = strictly(&format!("{BOOT}\n{steps}"));
    let text = outcome.failures("x.toml");
    assert_eq!(outcome.failures.len(), 1, "{steps}\n{text}");
    text
}

fn agrees(steps: &str) {
    let outcome = strictly(&format!("{BOOT}\n{steps}"));
    assert!(outcome.is_success(), "{steps}\n{}", outcome.failures("x.toml"));
}

const BOOT: &str =
    "{ expect = [\"720#00\", \"0A0#0000 0000 0000 0000\"] },\n{ send = \"000#0100\" },\n{ send = \"220#0000 0000\" },";
/// The response to the set-point in [`BOOT`].
const ANSWER: &str = "{ expect = \"1A0#0800 0000\" },";
/// A set-point sent every 100 ms, with its responses.
const CYCLE: &str = "{ send = \"220#0000 0000\", every_ms = 100 }, { expect = \"1A0#0800 0000\", every_ms = 100 },";

#[test]
fn a_frame_that_no_step_expects_fails_at_the_step_in_which_it_comes() {
    agrees(&format!("{ANSWER} {{ after_ms = 200 }}"));
    for (steps, said) in [
        ("{ after_ms = 200 }", "x.toml:7: strict: failed at "),
        // Too early for the step that expects the frame.
        ("{ after_ms = 20, expect = \"1A0\" }", "x.toml:7: strict: failed at "),
        // Another frame is expected first.
        ("\n{ expect = [\"720\", \"1A0\"] }", "x.toml:8: expect 2 frames (0 received) within 1000 ms: failed at "),
        // The state is not reached, but the frame is received.
        ("{ expect = { dsm = \"active\" } }", "x.toml:7: strict: failed at "),
    ] {
        let text = differs(steps);
        assert!(text.contains(said), "{steps}\n{text}");
        assert!(text.contains("    strict    no step expects  1A0: 08 00 00 00  at "), "{steps}\n{text}");
    }
    let text = differs("{ expect = \"1A0#0900 0000\" }");
    assert!(text.contains("x.toml:7: expect 1A0: 09 00 00 00 within 1000 ms: failed at "), "{text}");
    assert!(text.contains("    seen      1A0: 08 00 00 00  at ") && !text.contains("no step"), "{text}");
    // The same scenario without the strict option.
    passes("{ send = \"000#0100\" }, { send = \"220#0000 0000\" }, { after_ms = 200 }");
}

#[test]
fn a_strict_scenario_ends_with_its_first_failure() {
    let text = differs("{ expect = \"1A0#0900 0000\" }, { expect = \"7FF\", within_ms = 60000 }");
    assert!(text.contains("failed at 5."), "at once: {text}");
}

#[test]
fn frames_come_in_their_order_unless_any_will_do() {
    let (steps, swapped) = ("[\"720#00\", \"0A0#..\"]", "[\"0A0#..\", \"720#00\"]");
    assert!(strictly(&format!("{{ expect = {steps} }}")).is_success());
    assert!(!strictly(&format!("{{ expect = {swapped} }}")).is_success());
    assert!(strictly(&format!("{{ expect = {swapped}, any_order = true }}")).is_success());
}

/// A cyclic frame may arrive at any time within its period, until its identifier is expected again or stopped.
#[test]
fn a_frame_that_comes_again_keeps_its_cycle() {
    let start = format!("{ANSWER} {CYCLE}");
    agrees(&format!("{start} {{ after_ms = 1000 }}"));
    let slower =
        format!("{start} {{ after_ms = 95, send = \"220#0000 0000\", every_ms = 160 }},\n{{ after_ms = 500 }}");
    let text = differs(&slower);
    assert!(text.contains("x.toml:8: strict: ") && text.contains("not received since "), "{text}");
    assert!(text.contains(", expected every 100 ms: 1A0: 08 00 00 00"), "{text}");
    let faster = format!("{start} {{ after_ms = 95, send = \"220#0000 0000\", every_ms = 40 }},\n{{ after_ms = 500 }}");
    assert!(differs(&faster).contains("repeated after only "));
    let text = differs(&format!(
        "{start} {{ after_ms = 95, send = \"220#0300 0000\", every_ms = 100 }},\n{{ after_ms = 500 }}"
    ));
    assert!(text.contains("no step expects  1A0: "), "other data: {text}");
    // The cycle ends when its identifier is expected again.
    let text = differs(&format!("{start} {{ expect = \"1A0\" }},\n{{ after_ms = 500 }}"));
    assert!(text.contains("x.toml:8: strict: ") && text.contains("no step expects  1A0: "), "{text}");
    // The cycle ends with a stop.
    let stopped = "{ after_ms = 120, stop = \"220\" }, { stop = \"1A0\" }, { after_ms = 1000 }";
    agrees(&format!("{start} {stopped}"));
    let text = differs(&format!("{start} {{ after_ms = 120, stop = \"220\" }},\n{{ after_ms = 1000 }}"));
    assert!(text.contains("not received since "), "{text}");
}

/// A period that no frame was compared with is a failure, at the step that gives it.
#[test]
fn a_period_that_nothing_was_compared_with_fails() {
    let start = format!("{ANSWER} {{ send = \"220#0000 0000\", every_ms = 100 }},\n");
    let again = |period: u32| format!("{{ expect = \"1A0#0800 0000\", every_ms = {period} }}");
    let after_that = |rest: &str| format!("{start}{}, {rest}", again(100));
    agrees(&after_that("{ after_ms = 151 }"));
    agrees(&after_that("{ after_ms = 200, stop = \"1A0\" }, { stop = \"220\" }"));
    // Another step looks at the next frame.
    agrees(&after_that("{ expect = \"1A0#0800 0000\", within_ms = 150 }, { stop = \"220\" }, { after_ms = 50 }"));
    for steps in [
        format!("{start}{}", again(1)),
        format!("{start}{}, {{ after_ms = 49, stop = \"220\" }}, {{ after_ms = 300 }}", again(5000)),
        after_that("{ stop = \"1A0\" }, { stop = \"220\" }, { after_ms = 300 }"),
        after_that("{ stop = \"all\" }, { after_ms = 300 }"),
    ] {
        let text = differs(&steps);
        assert!(text.contains("x.toml:8: every_ms: failed at "), "{steps}\n{text}");
        assert!(text.contains("the frame did not come again: its period was not checked"), "{steps}\n{text}");
    }
}

/// A frame received while the step's own frame waits for the bus belongs to the step.
#[test]
fn what_comes_while_the_step_sends_is_the_steps() {
    let steps = "{ expect = \"720#00\" }, { send = \"7FF#00\", expect = \"0A0#0000 0000 0000 0000\" }";
    let outcome = strictly(steps);
    assert!(outcome.is_success(), "{}", outcome.failures("x.toml"));
}

#[test]
fn a_strict_scenario_that_cannot_look_is_refused() {
    let refusal =
        |steps: &str| refusal(&format!("strict = true\ndevices = [\"pvea-canopen@0x20\"]\nsteps = [\n{steps}\n]"));
    let (line, reason) = refusal("{ expect = \"720#00\" },\n{ never = \"0A0\", for_ms = 10 }");
    assert_eq!(line, Some(5));
    assert!(reason.starts_with("never: a strict scenario already forbids unexpected frames; use "));
    for step in [
        "{ every_ms = 100 }",
        "{ expect = { dsm = \"active\" }, every_ms = 100 }",
        "{ expect = [\"720\", \"0A0\"], every_ms = 100 }",
        "{ expect = \"7?0\", every_ms = 100 }",
    ] {
        let (line, reason) = refusal(&format!("{{ expect = \"720#00\" }},\n{step}"));
        assert_eq!(line, Some(5), "{step}");
        assert_eq!(
            reason,
            "every_ms is only valid together with send or, in a strict scenario, with a single expected frame"
        );
    }
    assert!(refusal("{ expect = \"720\", every_ms = 0 }").1.starts_with("every_ms 0 is not valid"));
    // The second expectation has ended the cycle.
    let ended = "{ expect = \"720\", every_ms = 100 }, { expect = \"720\" },\n{ stop = \"720\" }";
    assert_eq!(refusal(ended), (Some(5), "stop: there is no cyclic frame \"720\"; accepted: \"all\"".to_owned()));
    // Not strict: the step sends no frame.
    assert!(refused("{ expect = \"720\", every_ms = 100 }").starts_with("every_ms is only valid together with send"));
}
