//! The effects and times of steps, refused scenarios, and failure reports.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;

mod faults;
mod pauses;
mod reactions;
mod refusals;
mod strict;

/// Runs the steps with one valve that has booted.
fn outcome(steps: &str) -> Outcome {
    let text =
        format!("devices = [\"pvea-canopen@0x20\"]\nsteps = [\n{{ expect = [\"720#00\", \"0A0\"] }},\n{steps}\n]");
    Scenario::parse(&text).unwrap_or_else(|error| panic!("{error:?}")).run(1)
}

fn passes(steps: &str) {
    let outcome = outcome(steps);
    assert!(outcome.is_success(), "{steps}\n{}", outcome.failures("x.toml"));
}

/// Runs steps with the given number of failures. Returns the report.
fn fails(steps: &str, failures: usize) -> String {
    let outcome = outcome(steps);
    let text = outcome.failures("x.toml");
    assert_eq!(outcome.failures.len(), failures, "{steps}\n{text}");
    text
}

/// Returns the line and the reason of a refused scenario.
fn refusal(text: &str) -> (Option<usize>, String) {
    let ReadError { line, reason } = Scenario::parse(text).expect_err(text);
    assert!(!reason.contains('\n'), "one line: {reason}");
    (line, reason)
}

/// Returns the reason why a step is refused in a scenario with one valve.
fn refused(step: &str) -> String {
    let (line, reason) = refusal(&format!("devices = [\"pvea-canopen@0x20\"]\nsteps = [\n  {step},\n]"));
    assert_eq!(line, Some(3), "{step}: {reason}");
    reason
}

/// The steps into ACTIVE with a set-point of 25 %, sent every 100 ms.
const ACTIVE: &str = r#"{ send = "000#0120" }, { send = "220#0F00 0010", every_ms = 100, expect = { dsm = "active", position = 4096 } }"#;

/// A spool with 1000 ms forward and 600 ms back is half-way after half of each time.
#[test]
fn a_spool_takes_the_times_that_are_written() {
    let half_way = |ms: u32| {
        format!("{{ after_ms = {ms}, expect = {{ position = {{ min = 3896, max = 4296 }} }}, within_ms = 0 }}")
    };
    let text = format!(
        "devices = [\"pvea-canopen@0x20,stroke-ms=1000,return-ms=600\"]\nsteps = [\n{{ expect = \"720#00\" }}, \
         {{ send = \"000#0120\" }}, {{ send = \"220#0F00 0020\", every_ms = 50, expect = {{ dsm = \"active\" }} }},\n\
         {}, {{ expect = {{ position = 8192 }} }}, {{ send = \"220#0000 0000\", every_ms = 50 }}, {}]",
        half_way(250),
        half_way(150)
    );
    let outcome = Scenario::parse(&text).expect(&text).run(1);
    assert!(outcome.is_success(), "{}", outcome.failures("x.toml"));
}

#[test]
fn a_state_at_the_instant_of_the_deadline_is_in_time() {
    passes(&format!(
        r#"{ACTIVE}, {{ at_ms = 1000, plant = {{ supply_mv = 8000 }}, expect = {{ dsm = "fault-hold" }}, within_ms = 2000 }}"#
    ));
    let late = format!(
        r#"{ACTIVE}, {{ at_ms = 1000, plant = {{ supply_mv = 8000 }}, expect = {{ dsm = "fault-hold" }}, within_ms = 1999 }}"#
    );
    let text = fails(&late, 1);
    assert!(text.contains("within 1999 ms: failed at 2999.000 ms"), "{text}");
    assert!(text.contains("dsm       expected \"fault-hold\", seen \"active\""), "{text}");
}

#[test]
fn never_holds_up_to_its_last_instant_and_from_its_first() {
    let trip = |for_ms: u32| {
        format!(
            r#"{ACTIVE}, {{ at_ms = 1000, plant = {{ supply_mv = 8000 }}, never = {{ dsm = "fault-hold" }}, for_ms = {for_ms} }}"#
        )
    };
    passes(&trip(1999));
    let text = fails(&trip(2000), 1);
    assert!(text.contains("never state of pvea-canopen for 2000 ms: failed at 3000.000 ms"), "{text}");
    assert!(text.contains("seen      dsm = \"fault-hold\""), "{text}");
    // Violated from the first instant, but reported once; later steps continue.
    let text = fails(r#"{ never = { powered = true } }, { send = "000#0120", expect = { nmt = "operational" } }"#, 1);
    assert!(text.contains("x.toml:4: never state") && text.contains("powered = true"), "{text}");
}

/// Frames sent while a command waits for the bus precede the prohibition.
#[test]
fn never_begins_when_what_is_done_is_done() {
    let busy = r#"{ send = "000#0120" }, { send = "220#0F00 0010", every_ms = 1 }"#;
    for stop in [r#"{ send = "000#0220", never = "1A0" }"#, r#"{ send = "000#0220" }, { never = "1A0" }"#] {
        for after_ms in [45, 46, 47, 48, 49, 50] {
            passes(&format!("{busy}, {{ after_ms = {after_ms} }}, {stop}, {{ after_ms = 50 }}"));
        }
    }
}

/// A prohibition is checked only while time passes.
#[test]
fn never_needs_time_in_which_something_could_come() {
    let last = "never: the scenario ends with this step; add for_ms, or a later step";
    for step in [r#"{ never = "0A0" }"#, "{ never = { powered = false } }", r#"{ after_ms = 9, never = "0A0" }"#] {
        assert_eq!(refused(step), last);
    }
    let after = "never: no time passes in the later steps; add for_ms, or a later step that takes time";
    for never in [r#"never = "0A0""#, "never = { powered = false }"] {
        for timeless in [
            r#"{ note = "the end" }"#,
            "{ after_ms = 0 }",
            "{ plant = { supply_mv = 8000 } }",
            "{ power = { on = false } }",
            "{ bus = { bit_rate = 250000 } }",
            "{ disturb = { frames = 1 } }",
            r#"{ stop = "all" }"#,
            "{ expect = { powered = true }, within_ms = 0 }",
        ] {
            assert_eq!(refused(&format!("{{ {never} }}, {timeless}")), after, "{timeless}");
        }
        assert_eq!(refused(&format!("{{ {never}, for_ms = 0 }}")), "for_ms must be at least 1");
        passes(&format!("{{ {never} }}, {{ after_ms = 1 }}"));
        passes(&format!("{{ {never} }}, {{ never = {{ powered = false }}, for_ms = 1 }}"));
        passes(&format!("{{ never = {{ powered = false }}, for_ms = 1 }}, {{ {never} }}"));
        // Only the run shows whether time passes.
        let text = fails(&format!("{{ {never} }}, {{ expect = {{ powered = true }} }}"), 1);
        assert!(
            text.contains("x.toml:4: never: failed at ") && text.contains("no time has passed: nothing was checked"),
            "{text}"
        );
        let gone = format!("{{ never = {{ powered = false }}, for_ms = 1 }}, {{ after_ms = 2, {never} }}");
        assert!(fails(&gone, 1).contains("no time has passed: nothing was checked"), "{gone}");
    }
    for t_us in [0, 1, 20_000_000] {
        let text = fails(&format!("{{ never = {{ t_us = {t_us} }}, for_ms = 10 }}"), 1);
        assert!(text.contains("t_us was outside the checked time"), "{text}");
    }
}

/// Numbers are described in TOML terms.
#[test]
fn a_number_that_is_none_says_what_is_accepted() {
    for (key, number) in [("after_ms", "-1"), ("at_ms", "1.5"), ("at_ms", "4294967296"), ("after_ms", "\"1\"")] {
        let reason = refused(&format!("{{ {key} = {number} }}"));
        assert_eq!(reason, format!("{key} {number} is not valid; accepted: a whole number from 0 to 4294967295"));
    }
}

/// With `since_ms`, frames count from an earlier instant, including frames of the scenario.
#[test]
fn frames_count_since_an_earlier_instant_also_the_own_ones() {
    let steps = |check: &str| {
        format!(
            "{{ at_ms = 300, send = \"000#0120\" }}, {{ after_ms = 100 }}, {{ at_ms = 500, {check} }}, {{ at_ms = 600 }}"
        )
    };
    passes(&steps(r#"expect = "000#01..", since_ms = 300, within_ms = 0"#));
    // The boot-up came before the step.
    passes(&steps(r#"expect = ["720#00", "000#0120"], since_ms = 0, within_ms = 0"#));
    let said = fails(&steps(r#"expect = "000#01..", since_ms = 301, within_ms = 0"#), 1);
    assert!(said.contains("expect 000: 01 .. since 301 ms within 0 ms: failed at 500.000 ms"), "{said}");
    passes(&steps(r#"never = "000", since_ms = 301, for_ms = 1"#));
    let said = fails(&steps(r#"never = "000", since_ms = 300, for_ms = 1"#), 1);
    assert!(said.contains("never 000 since 300 ms for 1 ms: failed at 500.000 ms"), "{said}");
    // The own frame proves nothing otherwise, and a frame of a fault never does.
    fails(&steps(r#"expect = "000#01..", within_ms = 100"#), 1);
    let insert = r#"{ at_ms = 300, fault = { insert = "7FF#00" } }, { after_ms = 50, "#;
    fails(&format!(r#"{insert} expect = "7FF", since_ms = 300, within_ms = 0 }}"#), 1);
}

/// An identifier alone stands for any frame, `#..` for data frames.
#[test]
fn remote_frames_count_for_an_identifier_alone() {
    let after = |check: &str| format!("{{ after_ms = 10, send = \"321#R4\" }}, {{ {check}, since_ms = 0 }}");
    let text = fails(&after(r#"never = "321", for_ms = 100"#), 1);
    assert!(text.contains("x.toml:4: never 321 since 0 ms for 100 ms: failed at "), "{text}");
    assert!(text.contains("seen      321: R4  at "), "{text}");
    passes(&after(r#"expect = "321""#));
    passes(&after(r#"expect = "321#R4""#));
    passes(&after(r#"never = "321#..", for_ms = 100"#));
}

/// A prohibition whose frames count from a time that does not come, or that the history has forgotten, proves nothing.
#[test]
fn never_needs_the_frames_since_its_time() {
    let never =
        |since_ms: u32, for_ms: &str| format!("{{ at_ms = 300, never = \"0A0\", since_ms = {since_ms}{for_ms} }}, ");
    let reason = "the prohibition ends before since_ms: nothing was checked";
    for (since_ms, for_ms) in [(600, ""), (4_000_000_000, ""), (350, ", for_ms = 50"), (600, ", for_ms = 10")] {
        let text = fails(&format!("{}{{ at_ms = 600 }}", never(since_ms, for_ms)), 1);
        assert!(text.contains("x.toml:4: never: failed at ") && text.contains(reason), "{text}");
    }
    passes(&format!("{}{{ at_ms = 600 }}", never(599, "")));
    passes(&format!("{}{{ at_ms = 600 }}", never(350, ", for_ms = 51")));
    // One frame every millisecond: after 5 s, the frames of the start are gone.
    let busy = |since_ms: u32| {
        let send = r#"{ send = "7FF#00", every_ms = 1 }"#;
        format!("{send}, {{ at_ms = 5000, never = \"7FE\", since_ms = {since_ms}, for_ms = 1 }}")
    };
    let text = fails(&busy(0), 1);
    assert!(text.contains("since_ms is too early: the first frames after it are no longer kept"), "{text}");
    passes(&busy(2000));
}

/// A frame that matches several patterns does not leave another pattern unmatched.
#[test]
fn frames_in_any_order_are_given_to_whom_they_fit() {
    let text = |expected: &str| {
        format!("devices = [\"pvea-canopen@0x20\"]\nsteps = [{{ expect = [{expected}], any_order = true }}]")
    };
    let run = |expected: &str| Scenario::parse(&text(expected)).unwrap().run(1).is_success();
    for expected in [r#""???", "720#00""#, r#""720#00", "???""#, r#""0A0", "720""#, r#""?20", "???""#] {
        assert!(run(expected), "{expected}");
    }
    for expected in [r#""???", "???", "720""#, r#""720", "7??""#, r#""720#00", "720#00""#] {
        assert!(!run(expected), "{expected}");
    }
}

#[test]
fn a_frame_that_must_not_come_is_shown_with_what_was_before() {
    let text = fails(r#"{ never = "5A0" }, { send = "620#4000 1000 0000 0000" }, { after_ms = 5 }"#, 1);
    assert!(text.contains("x.toml:4: never 5A0: failed at "), "{text}");
    assert!(text.contains("seen      5A0: 43 00 10 00 98 01 00 00  at "), "{text}");
    assert!(text.contains("->  620: 40 00 10 00 00 00 00 00  master → pvea-canopen: SDO read"), "{text}");
    // Until the end of the scenario, or of the prohibition's duration.
    passes(r#"{ never = "5A0", for_ms = 10 }, { after_ms = 11, send = "620#4000 1000 0000 0000" }, { after_ms = 5 }"#);
    passes(r#"{ never = "5A0" }, { after_ms = 5 }"#);
    // The scenario waits until the last step's prohibition ends.
    let text = fails(r#"{ send = "620#2B17 1000 6400 0000" }, { never = "720#7F", for_ms = 150 }"#, 1);
    assert!(text.contains("seen      720: 7F"), "{text}");
}

#[test]
fn one_frame_fulfils_one_expectation() {
    let read = r#"send = "620#4000 1000 0000 0000""#;
    let text = fails(&format!(r#"{{ {read}, expect = ["5A0#43..", "5A0#43.."], within_ms = 20 }}"#), 1);
    assert!(text.contains("expect 2 frames (1 received) within 20 ms"), "{text}");
    assert!(text.contains("received  5A0: 43 ..") && text.contains("expected  5A0: 43 .."), "{text}");
    assert!(text.contains("seen      no device frame"), "{text}");
    let text = fails(
        &format!(r#"{{ {read}, expect = "5A0#43..", within_ms = 20 }}, {{ expect = "5A0#43..", within_ms = 20 }}"#),
        1,
    );
    assert!(text.contains("a matching frame was received before the step, at "), "{text}");
    passes(&format!(r#"{{ {read} }}, {{ {read}, expect = ["5A0#43..", "5A0#43.."] }}"#));
}

#[test]
fn frames_in_order_and_in_any_order() {
    let reset = r#"send = "000#8220""#;
    passes(&format!(r#"{{ {reset}, expect = ["720#00", "0A0#.."] }}"#));
    passes(&format!(r#"{{ {reset}, expect = ["0A0#..", "720#00"], any_order = true }}"#));
    let text = fails(&format!(r#"{{ {reset}, expect = ["0A0#..", "720#00"], within_ms = 50 }}"#), 1);
    assert!(text.contains("received  0A0: ..") && text.contains("expected  720: 00"), "{text}");
}

/// The window of an expectation begins with its step: a response to an earlier request does not match.
#[test]
fn a_frame_from_before_the_step_fulfils_nothing() {
    // The status word is 0x0008 (INIT) at the first request, and 0x0009 (DISABLED) at the second.
    let (read, enable) = (r#"send = "620#4041 6000 0000 0000""#, r#"{ send = "620#2B40 6000 0100 0000" }"#);
    let twice = |expected: &str| {
        format!(
            r#"{{ {read} }}, {{ send = "700#05" }}, {enable}, {{ send = "700#05" }}, {{ send = "700#05" }}, {{ {read}, {expected}, within_ms = 20 }}"#
        )
    };
    passes(&twice(r#"expect = "5A0#4B41 6000 0900 0000""#));
    for expected in [
        r#"expect = "5A0#4B41 6000 0800 0000""#,
        r#"expect = ["5A0#4B41 6000 0800 0000", "5A0#4B41 6000 0900 0000"]"#,
        r#"expect = ["5A0#4B41 6000 0900 0000", "5A0#4B41 6000 0800 0000"], any_order = true"#,
    ] {
        let text = fails(&twice(expected), 1);
        assert!(text.contains("a matching frame was received before the step, at "), "{text}");
    }
    // The same applies to all other actions, and to a pause.
    let request = r#"{ send = "620#4000 1000 0000 0000" }, { send = "700#05" }, { send = "700#05" }"#;
    for step in [
        r#"expect = "5A0#43..""#,
        r#"send = "700#05", expect = "5A0#43..""#,
        r#"send = "700#05", every_ms = 100, expect = "5A0#43..""#,
        r#"plant = { supply_mv = 20000 }, expect = "5A0#43..""#,
        r#"disturb = { frames = 0 }, expect = "5A0#43..""#,
        r#"after_ms = 10, expect = "5A0#43..""#,
        r#"at_ms = 100, expect = "5A0#43..""#,
    ] {
        let text = fails(&format!("{request}, {{ {step}, within_ms = 10 }}"), 1);
        assert!(text.contains("a matching frame was received before the step, at "), "{step}\n{text}");
    }
}

/// A frame received while the step's own frame waits for the bus belongs to the step.
#[test]
fn nothing_is_lost_within_a_step() {
    passes(r#"{ send = "620#4000 1000 0000 0000" }, { send = "700#05", expect = "5A0#43.." }"#);
    passes(r#"{ send = "620#4000 1000 0000 0000" }, { plant = { supply_mv = 20000 } }, { expect = "5A0#43.." }"#);
}

#[test]
fn a_wrong_byte_is_marked_and_every_failure_is_told() {
    let text = fails(
        r#"{ note = "Device type", send = "620#4000 1000 0000 0000", expect = "5A0#4300 1000 9901 0000", within_ms = 10 },
           { expect = "7E4#44..", within_ms = 10 }"#,
        2,
    );
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].starts_with("  x.toml:4: expect 5A0: 43 00 10 00 99 01 00 00 within 10 ms: failed at "), "{text}");
    assert_eq!(lines[1], "    -- Device type", "{text}");
    assert!(lines[2].starts_with("    expected  5A0: 43 00 10 00 99 01 00 00  pvea-canopen: SDO"), "{text}");
    assert!(lines[3].starts_with("    seen      5A0: 43 00 10 00 98 01 00 00  at "), "{text}");
    assert_eq!(lines[4].find("^^"), lines[3].find("98"), "{text}");
    assert!(text.contains("x.toml:5: expect 7E4: 44 .."), "{text}");
    assert!(text.ends_with("no bus traffic since the previous failure\n"), "{text}");
}

/// The springs take 37.5 ms for a quarter of the stroke, with and without a program.
#[test]
fn a_spool_returns_in_its_time_without_power() {
    for power in ["{ on = false }", "{ reset = \"watchdog\" }"] {
        let cut = |within_ms| {
            format!("{ACTIVE}, {{ power = {power}, expect = {{ position = 0 }}, within_ms = {within_ms} }}")
        };
        passes(&cut(38));
        fails(&cut(37), 1);
        fails(&cut(38).replace("{ power", "{ plant = { spool = \"stuck\" } }, { power"), 1);
    }
}

#[test]
fn a_power_cut_in_the_middle_of_a_write_is_a_power_cut() {
    // "save" has no response, and the defaults are restored at the next start.
    passes(
        r#"{ send = "620#2B17 1000 6400 0000", expect = "5A0#60.." }, { send = "620#2310 1001 7361 7665" },
           { power = { on = false } }, { never = "5A0" }, { expect = { powered = false }, within_ms = 0 }, { after_ms = 10, power = { on = true } },
           { expect = ["720#00", "0A0#0000 0000 0000 0000"] }"#,
    );
    let text = fails(r#"{ power = { on = false } }, { power = { reset = "watchdog" } }"#, 1);
    assert!(text.contains("x.toml:4: power: failed at ") && text.contains("its watchdog cannot reset it"), "{text}");
    passes(r#"{ power = { reset = "watchdog" }, expect = "0A0#0010 0101 .." }"#);
}

#[test]
fn a_disturbance_takes_the_sender_off_the_bus() {
    let text = fails(
        &format!(
            r#"{ACTIVE}, {{ disturb = {{ frames = 32, id = 0x1A0 }}, expect = {{ faults = ["can-bus"] }} }}, {{ expect = "111#", within_ms = 1 }}"#
        ),
        1,
    );
    assert!(
        text.contains("!!  error frame: bit error in 1A0: ") && text.contains("!!  pvea-canopen: bus-off"),
        "{text}"
    );
    // A frame of the scenario itself is withdrawn after one second.
    let text = fails(r#"{ disturb = { frames = 100000000, id = 0x220 } }, { send = "220#00" }"#, 1);
    assert!(text.contains("send 220: 00: failed") && text.contains("not sent within 1 s"), "{text}");
}

#[test]
fn cyclic_frames_begin_change_and_end() {
    passes(
        r#"{ send = "000#0120" }, { send = "220#0100 0000", every_ms = 10, expect = ["1A0#09..", "1A0#09..", "1A0#09.."], within_ms = 30 },
           { send = "220#0300 0000", every_ms = 10, expect = ["1A0#0B..", "1A0#0B.."], within_ms = 15 },
           { stop = "220" }, { after_ms = 1, never = "1A0", for_ms = 100 }"#,
    );
    passes(r#"{ stop = "all" }"#);
}

#[test]
fn a_step_that_begins_too_late_says_so() {
    let text = fails(r#"{ after_ms = 100 }, { at_ms = 50, note = "too early" }"#, 1);
    assert!(text.contains("x.toml:4: at_ms = 50: failed at ") && text.contains("still running at 50.000 ms"), "{text}");
}

#[test]
fn enormous_times_are_times() {
    let max = u32::MAX;
    passes(&format!(
        r#"{{ at_ms = {max} }}, {{ after_ms = {max} }}, {{ never = "1A0", for_ms = {max} }}, {{ after_ms = {max} }}"#
    ));
}

/// A spool fault can be a word or an object, and `ok` means healthy, as on the console and in Python.
#[test]
fn a_spool_is_broken_and_mended_by_a_word() {
    for (broken, healthy) in [
        (r#""stuck""#, r#""ok""#),
        (r#"{ fault = "stuck" }"#, r#"{ fault = "ok" }"#),
        (r#"{ fault = "stuck" }"#, r#"{ fault = "none" }"#),
    ] {
        passes(&format!(
            r#"{ACTIVE}, {{ plant = {{ spool = {broken} }} }}, {{ send = "220#0F00 0040", every_ms = 100 }},
            {{ expect = {{ faults = ["spool-not-at-set-point"] }} }},
            {{ plant = {{ spool = {healthy} }}, expect = {{ position = 0, faults = [] }} }}"#
        ));
    }
}

/// Numbers are decimal, strings are hexadecimal.
#[test]
fn identifiers_of_steps() {
    for (stop, disturb) in
        [("\"220\"", "\"1A0\""), ("\"0x220\"", "\"0x1A0\""), ("0x220", "0x1A0"), ("544", "416"), ("\"all\"", "\"1a0\"")]
    {
        passes(&format!(
            r#"{ACTIVE}, {{ stop = {stop} }}, {{ expect = {{ faults = ["time-guarding"] }} }},
            {{ disturb = {{ frames = 1, id = {disturb} }} }}, {{ send = "220#0F00 0010", expect = "1A0" }}"#
        ));
    }
    for stop in ["0x0CFE3027", "\"0x0CFE3027\""] {
        passes(&format!(r#"{{ send = "0CFE3027#00", every_ms = 10 }}, {{ stop = {stop} }}, {{ send = "0x220#00" }}"#));
    }
}

#[test]
fn a_frame_that_differs_in_its_length_alone_is_told_so() {
    let text = fails(r#"{ send = "000#0120" }, { send = "220#0300 0000", expect = "1A0#????" }"#, 1);
    assert!(text.contains("differs only in its length: 4 bytes instead of 2 bytes; append \"..\""), "{text}");
    let text = fails(r#"{ send = "000#0120" }, { send = "220#0300 0000", expect = "1A0#FF??" }"#, 1);
    assert!(text.contains("seen      1A0: ") && !text.contains("length"), "{text}");
}

#[test]
fn what_is_null_in_json_is_none() {
    passes(
        r#"{ expect = { command = "none", nmt = "pre-operational" } }, { power = { on = false }, expect = { dsm = "none", node_id = "none" } }"#,
    );
    passes(
        r#"{ plant = { lever = 4000, spool = { fault = "stuck" } } }, { plant = { lever = "none", spool = { fault = "none" } } }"#,
    );
    let text = fails(
        r#"{ expect = { dsm = "none" }, within_ms = 0 }, { expect = { led = { color = "red" }, faults = ["internal"] }, within_ms = 0 }"#,
        2,
    );
    for seen in [
        "dsm       expected \"none\", seen \"init\"",
        "led       expected { color = \"red\" }, seen { color = \"yellow\", flashing = false }",
        "faults    expected [\"internal\"], seen []",
    ] {
        assert!(text.contains(seen), "{text}");
    }
}

/// A scenario whose failures depend on the start times of its devices.
const WITH_FAILURES: &str = "devices = [\"pvea-canopen@0x20\", \"hat1000,bit-rate=250k\"]\nsteps = [\n\
    { send = \"000#0100\", after_ms = 10 }, { expect = \"111#\" }, { device = \"hat1000\", expect = { position = 1 } } ]";

/// Two seeds may happen to start the devices at the same times; the first 20 seeds do not.
#[test]
fn another_seed_starts_the_devices_at_other_instants() {
    let scenario = Scenario::parse(WITH_FAILURES).expect("a scenario");
    let runs: BTreeSet<String> = (0..20).map(|seed| scenario.run(seed).failures("x")).collect();
    assert_eq!(runs.len(), 20);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases.div_ceil(10)))]

    /// Two runs with the same seed are byte-identical.
    #[test]
    fn one_seed_is_one_run(seed: u64) {
        let scenario = Scenario::parse(WITH_FAILURES).expect("a scenario");
        let (one, other) = (scenario.run(seed), scenario.run(seed));
        prop_assert_eq!(one.failures("x"), other.failures("x"));
        prop_assert_eq!(one.to_string(), other.to_string());
    }

    /// Any text is parsed as a scenario or refused in one line.
    #[test]
    fn nothing_panics(text in "(devices|steps|=|\\[|\\]|\\{|\\}|\"|send|pvea-canopen|expect|720#00|,|\n| ){0,40}") {
        if let Err(ReadError { reason, .. }) = Scenario::parse(&text) {
            prop_assert!(!reason.contains('\n'), "{}", reason);
        }
    }
}
