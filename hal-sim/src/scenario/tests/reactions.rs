//! Rules that act independently of the steps.

use super::*;

/// Runs steps and rules with one valve on the bus.
fn outcome(reactions: &str, steps: &str) -> Outcome {
    let text = format!("devices = [\"pvea-canopen@0x20\"]\nreactions = [\n{reactions}\n]\nsteps = [\n{steps}\n]");
    Scenario::parse(&text).unwrap_or_else(|error| panic!("{error:?}")).run(1)
}

fn passes(reactions: &str, steps: &str) {
    let outcome = outcome(reactions, steps);
    assert!(outcome.is_success(), "{reactions}\n{steps}\n{}", outcome.failures("x.toml"));
}

/// Returns the reason why a rule is refused.
fn refused(reaction: &str) -> String {
    let text = format!(
        "devices = [\"pvea-canopen\"]\nreactions = [\n  {{ on = \"720\", send = \"000#0100\" }},\n  {reaction},\n]\nsteps = [{{ send = \"220#\", every_ms = 9 }}]"
    );
    let (line, reason) = refusal(&text);
    assert_eq!(line, Some(4), "{reaction}: {reason}");
    reason
}

/// The steps from power-up to ACTIVE.
fn active() -> String {
    format!("{{ expect = [\"720#00\", \"0A0\"] }}, {ACTIVE}")
}

#[test]
fn a_frame_is_answered_once_or_each_time() {
    let steps = r#"{ expect = ["720#00", "0A0"] }, { send = "620#2B17 1000 6400 0000" },
        { expect = ["5A0#4300 1000 ..", "5A0#4300 1000 .."] }"#;
    let sdo = |again: bool| format!(r#"{{ on = "720#7F", send = "620#4000 1000 0000 0000", again = {again} }}"#);
    passes(&sdo(true), steps);
    assert!(!outcome(&sdo(false), steps).is_success());
    // The boot-up message starts the node: the rule acts at the end of the frame, of some 0.5 ms.
    let start = r#"{ on = "720#00", send = "000#0120" }"#;
    passes(start, r#"{ expect = "720#00" }, { expect = { nmt = "operational" }, within_ms = 2 }"#);
}

#[test]
fn a_frame_that_stays_away_is_noticed() {
    let rule = r#"{ missing = "1A0", for_ms = 250, send = "000#0220" }"#;
    let lost = r#"{ at_ms = 1000, fault = { lose = "1A0" } }"#;
    // The last frame came up to 100 ms before, and the NMT command takes a frame.
    let noticed = r#"{ never = { nmt = "stopped" }, for_ms = 149 }, { expect = { nmt = "stopped" }, within_ms = 252 }"#;
    passes(rule, &format!("{}, {lost}, {noticed}", active()));
    // The set-points stop, so that the valve misses them.
    let stop = rule.replace(r#"send = "000#0220""#, r#"stop = "220""#);
    let guarded = r#"{ expect = { faults = ["time-guarding"] }, within_ms = 600 }"#;
    passes(&stop, &format!("{}, {lost}, {guarded}", active()));
    // A frame is not missing before its first arrival, or before `from_ms`.
    passes(rule, r#"{ never = { nmt = "stopped" } }, { at_ms = 2000 }"#);
    let late = rule.replace("for_ms", "from_ms = 1100, for_ms");
    passes(&late, &format!("{}, {lost}, {{ never = {{ nmt = \"stopped\" }} }}, {{ at_ms = 1500 }}", active()));
}

#[test]
fn a_lost_frame_and_the_masters_own_are_not_heard() {
    let rule = r#"{ on = "1A0#0F..", send = "000#0220" }"#;
    let never = r#"{ never = { nmt = "stopped" }, for_ms = 500 }"#;
    passes(rule, &format!(r#"{{ fault = {{ lose = "1A0" }} }}, {}, {never}"#, active()));
    assert!(!outcome(rule, &active()).is_success());
    let own = r#"{ on = "220", send = "000#0220" }"#;
    passes(own, &format!("{}, {never}", active()));
    // For the master, an inserted frame is a frame of a device.
    let inserted = r#"{ fault = { insert = "220#0F00 0000" }, expect = { nmt = "stopped" } }"#;
    passes(own, &format!("{}, {inserted}", active()));
}

#[test]
fn a_rule_that_cannot_act_is_refused() {
    for (reaction, wanted) in [
        (r#"{ on = "0A0" }"#, "no action; give send = \"000#0220\", or stop"),
        (r#"{ send = "000#0220" }"#, "no trigger; give on"),
        (r#"{ missing = "720", send = "000#0220" }"#, "for_ms is missing"),
        (r#"{ on = "720", for_ms = 5, send = "000#0220" }"#, "for_ms is only valid together with missing"),
        (r#"{ on = "720", missing = "720", for_ms = 5, send = "000#" }"#, "on and missing cannot be"),
        (r#"{ on = "720", stop = "220", send = "000#" }"#, "send and stop cannot be"),
        (r#"{ on = "720", stop = "220", every_ms = 5 }"#, "every_ms is only valid together with send"),
        (r#"{ on = "720", stop = "221" }"#, "there is no cyclic frame \"221\"; accepted: \"220\", \"all\""),
        (r#"{ on = "720#R", stop = "220" }"#, "on: '720#R': no device sends remote frames"),
        (r#"{ on = "720", sent = "000#" }"#, "did you mean 'send'?"),
        (r#"{ missing = "720", for_ms = 0, stop = "220" }"#, "for_ms 0 is not valid; accepted: a whole number from 1"),
    ] {
        let reason = refused(reaction);
        assert!(reason.contains(wanted), "{reaction}: {reason}");
    }
}
