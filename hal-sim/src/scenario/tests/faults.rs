//! Communication faults in scenarios.

use super::*;

#[test]
fn a_fault_affects_the_frames_of_the_next_steps() {
    passes(
        r#"{ send = "000#0120" },
           { fault = { lose = "220", count = 2 } },
           { send = "220#0F00 0020" }, { send = "220#0F00 0020" }, { after_ms = 50, expect = { dsm = "init" } },
           { end = "lose-220" },
           { send = "220#0F00 0020", every_ms = 20, expect = { dsm = "active" } },
           { fault = { corrupt = "1A0", data = { toggle = "01" }, count = 1 }, expect = "1A0#0E00 .." },
           { end = "all" }"#,
    );
}

/// The scenario continues while a fault delays its frame.
#[test]
fn a_delayed_frame_does_not_hold_back_the_next_one() {
    passes(
        r#"{ send = "000#0120" },
           { send = "220#0F00 0020", every_ms = 50, expect = { dsm = "active", position = 8192 } },
           { fault = { swap = "220", count = 1 } },
           { after_ms = 60, stop = "220" },
           { send = "220#0B00 0000", expect = ["1A0#0B00 0020", "1A0#0F00 ????"], within_ms = 2 },
           { fault = { delay = "220", ms = 1500, count = 1 } },
           { send = "220#0F00 0010" },
           { send = "620#4018 1001 0000 0000", expect = "5A0#4318 1001 1900 0001", within_ms = 5 },
           { stop = "all" },
           { at_ms = 1700, expect = "1A0#0300 0000", within_ms = 150 }"#,
    );
}

#[test]
fn a_fault_that_affects_no_frame_fails() {
    let report = fails(r#"{ fault = { lose = "7FF" } }, { after_ms = 100 }"#, 1);
    assert!(report.contains("x.toml:4: fault lose 7FF: failed at "), "{report}");
    assert!(report.contains("the fault affected no frame: nothing was tested"), "{report}");
    fails(r#"{ fault = { lose = "7FF" } }, { after_ms = 100, end = "lose-7FF" }"#, 1);
    // A fault with the same name replaces an expired fault.
    fails(
        r#"{ fault = { lose = "7FF", for_ms = 5, name = "one" } }, { after_ms = 100 },
           { fault = { lose = "7FE", probability = 0, name = "one" } }, { after_ms = 10 }"#,
        1,
    );
    passes(r#"{ fault = { lose = "220", probability = 0 } }, { after_ms = 100 }, { end = "all" }"#);
}

/// The same for a disturbance.
#[test]
fn a_disturbance_that_destroys_no_frame_fails() {
    for steps in [
        r#"{ disturb = { frames = 1, id = "221" } }, { after_ms = 200 }"#,
        r#"{ disturb = { frames = 32, id = "221" } }, { after_ms = 200 }, { disturb = { frames = 0 } }"#,
        r#"{ disturb = { frames = 1, id = "221" } }, { disturb = { frames = 1, id = "220" } }, { send = "220#00" }"#,
    ] {
        let report = fails(steps, 1);
        assert!(report.contains("x.toml:4: disturb: failed at "), "{report}");
        assert!(report.contains("no frame was destroyed: nothing was tested"), "{report}");
    }
    passes(r#"{ disturb = { frames = 9, id = "220" } }, { send = "220#00" }, { disturb = { frames = 0 } }"#);
    passes(r#"{ disturb = { frames = 0 } }"#);
}

#[test]
fn a_fault_that_cannot_be_is_refused() {
    for (step, reason) in [
        (r#"{ fault = {} }"#, "fault: a fault needs one of lose, delay, "),
        (r#"{ fault = { lose = "220", sender = "bucket" } }"#, "fault: no device or client 'bucket'; known: "),
        (r#"{ fault = { lose = "" } }"#, "fault: lose: id \"\" is not valid; "),
        (r#"{ fault = { lose = "220", probability = 1.5 } }"#, "fault.probability 1.5 is not valid; accepted: "),
        (r#"{ fault = { loose = "220" } }"#, "fault: unknown key 'loose'; did you mean 'lose'?"),
        (r#"{ end = "lose-220" }"#, "end: no fault 'lose-220'; there are no faults"),
        (
            r#"{ fault = { lose = "220", receivers = ["pvea-canopen", "the master"] } }"#,
            "fault: 'the master' receives no frames; receivers: pvea-canopen",
        ),
        (
            concat!(
                r#"{ fault = { insert = "123#00", every_ms = 5, name = "stranger" } }, "#,
                r#"{ fault = { lose = "220", receivers = ["stranger"] } }"#
            ),
            "fault: 'stranger' receives no frames; receivers: pvea-canopen",
        ),
        (r#"{ fault = { lose = "220" }, disturb = { frames = 1 } }"#, "disturb and fault cannot be in the same step"),
    ] {
        let refused = refused(step);
        assert!(refused.starts_with(reason), "{step}: {refused}");
    }
}

/// The master of a scenario, and the sender of inserted frames, can be named.
#[test]
fn senders_have_names() {
    passes(
        r#"{ fault = { delay = "220", ms = 5, sender = "the master", count = 1 } }, { send = "220#0000 0000" },
           { fault = { insert = "221#00", every_ms = 10, name = "intruder" } },
           { fault = { delay = "221", ms = 3, sender = "intruder" } }, { after_ms = 50 }, { end = "all" }"#,
    );
}

/// A fault that changes nothing affects no frame.
#[test]
fn a_fault_without_an_effect_fails() {
    for fault in [
        r#"corrupt = "220", data = { clear = "10" }"#,
        r#"corrupt = "220", data = { toggle = "00 00 00 00 80" }"#,
        r#"delay = "220", ms = 0"#,
        r#"lose = "321", receivers = ["pvea-canopen"]"#,
        r#"swap = "321", within_ms = 5"#,
        r#"repeat = "321", after_ms = 80000"#,
    ] {
        fails(&format!(r#"{{ fault = {{ {fault} }} }}, {{ send = "220#0F00 0020" }}, {{ send = "321#00" }}"#), 1);
    }
    fails(
        r#"{ power = { on = false } }, { fault = { lose = "220", receivers = ["pvea-canopen"] } },
           { send = "220#0F00 0020" }"#,
        1,
    );
}

/// New faults may replace expired faults; the names of expired faults can still be ended.
#[test]
fn any_number_of_faults_one_after_the_other() {
    let faults = (0..70).map(|number| {
        format!(
            r#"{{ fault = {{ lose = "{id:03X}", count = 1 }} }}, {{ send = "{id:03X}#00" }}, "#,
            id = 0x300 + number
        )
    });
    passes(&format!(r#"{}{{ end = "lose-345" }}"#, faults.collect::<String>()));
}

/// An inserting fault that is added again at the instant of its end keeps its controller.
#[test]
fn an_inserting_fault_is_added_again() {
    passes(
        r#"{ fault = { insert = "123#00", every_ms = 10 } }, { after_ms = 10, end = "insert-123" },
           { fault = { insert = "123#00", every_ms = 10 } }, { after_ms = 100 }"#,
    );
}
