//! Scenarios refused before they run: the line, the key, and the accepted values.

use super::*;

/// Line breaks in quoted parts of the file do not add lines to a message.
#[test]
fn a_refusal_and_a_verdict_are_one_line_whatever_they_quote() {
    let (_, reason) = refusal("devices = [\"pvea-c\\nopen\"]\nsteps = [{}]");
    assert!(reason.starts_with("unknown kind 'pvea-c\\nopen'"), "{reason}");
    let text = "title = \"one\\n1 passed, 0 failed\"\ndevices = [\"hat1000\"]\nsteps = [{ expect = \"701\" }]";
    let verdict = Scenario::parse(text).expect("a scenario").run(1).to_string();
    assert!(verdict.starts_with("one\\n1 passed, 0 failed; 1 step in "), "{verdict}");
}

/// A scenario that neither expects nor forbids anything would pass for any behaviour of the devices.
#[test]
fn a_scenario_without_an_expectation_is_refused() {
    for head in ["", "strict = true\n"] {
        for steps in [
            r#"{ note = "y" }"#,
            "{ after_ms = 100 }",
            r#"{ plant = { supply_mv = 8000 } }, { note = "y" }"#,
            r#"{ send = "000#0100" }, { fault = { lose = "220" } }"#,
        ] {
            let (line, reason) = refusal(&format!("{head}devices = [\"pvea-canopen\"]\nsteps = [{steps}]"));
            assert_eq!(reason, "no step has expect or never; add a step such as { expect = \"720#00\" }", "{steps}");
            assert_eq!(line, Some(1));
        }
    }
    // A reaction does not judge: a rule that never acts is no failure.
    let text =
        "devices = [\"pvea-canopen\"]\nreactions = [{ on = \"0A0\", send = \"000#0220\" }]\nsteps = [{ at_ms = 9 }]";
    assert!(refusal(text).1.starts_with("no step has expect or never; "));
    let never = "devices = [\"pvea-canopen\"]\nsteps = [{ never = \"080\", for_ms = 10 }]";
    assert!(Scenario::parse(never).expect(never).run(1).is_success());
}

/// Stopping a cyclic frame that does not exist is refused, because the intended frame would continue.
#[test]
fn only_a_cyclic_frame_is_stopped() {
    let cyclic = r#"{ send = "220#00", every_ms = 10 }, { send = "18EEFF27#", every_ms = 10 }"#;
    for (steps, reason) in [
        (r#"{ stop = "220" }"#.to_owned(), "stop: there is no cyclic frame \"220\"; accepted: \"all\""),
        (r#"{ send = "220#00" }, { stop = "220" }"#.to_owned(), "accepted: \"all\""),
        (format!(r#"{cyclic}, {{ stop = "221" }}"#), "accepted: \"220\", \"18EEFF27\", \"all\""),
        (format!(r#"{cyclic}, {{ stop = "00000220" }}"#), "no cyclic frame \"00000220\""),
        (format!(r#"{cyclic}, {{ stop = "220" }}, {{ stop = "220" }}"#), "accepted: \"18EEFF27\", \"all\""),
        (format!(r#"{cyclic}, {{ stop = "all" }}, {{ stop = "220" }}"#), "accepted: \"all\""),
    ] {
        let said = refused(&steps);
        assert!(said.starts_with("stop: ") && said.contains(reason), "{steps}\n{said}");
    }
    passes(&format!(r#"{cyclic}, {{ send = "220#01", every_ms = 20 }}, {{ stop = "220" }}, {{ stop = "all" }}"#));
}

/// Only the run shows whether a rule has sent or stopped a cyclic frame.
#[test]
fn a_stop_of_a_frame_that_is_not_active_fails() {
    let stops = |rule: &str, steps: &str| {
        let text = format!(
            "devices = [\"pvea-canopen@0x20\"]\nreactions = [{{ {rule} }}]\nsteps = [{{ expect = \"720#00\" }},\n{steps}]"
        );
        let outcome = Scenario::parse(&text).expect(&text).run(1);
        outcome.failures("x.toml")
    };
    let stop = "{ after_ms = 200, stop = \"7F0\" }";
    assert_eq!(stops(r#"on = "0A0", send = "7F0#", every_ms = 10"#, stop), "");
    let never_sent = stops(r#"on = "0A0#FFFF ..", send = "7F0#", every_ms = 10"#, stop);
    let stopped_before = stops(
        r#"on = "0A0", stop = "220""#,
        r#"{ send = "220#00", every_ms = 50, expect = "0A0", since_ms = 0 }, { after_ms = 200, stop = "220" }"#,
    );
    for (said, id) in [(never_sent, "7F0"), (stopped_before, "220")] {
        assert!(said.contains("x.toml:4: stop: failed at "), "{said}");
        assert!(said.contains(&format!("there is no cyclic frame \"{id}\"")), "{said}");
    }
}

/// Conditions that a device never or always satisfies are refused with their possible values.
#[test]
fn a_state_that_can_never_be_is_refused() {
    let refused = |device: &str, state: &str| {
        let [expect, never] = ["expect", "never"].map(|word| {
            let text = format!("devices = [\"{device},name=boom\"]\nsteps = [\n  {{ {word} = {{ {state} }} }}, {{}} ]");
            let (line, reason) = refusal(&text);
            assert_eq!(line, Some(3), "{text}: {reason}");
            // The table of the kind refuses values that the common schema accepts.
            let rest = reason.strip_prefix(word).and_then(|rest| rest.strip_prefix([':', '.']));
            rest.unwrap_or_else(|| panic!("{reason}")).trim_start().to_owned()
        });
        assert_eq!(expect, never);
        expect
    };
    for (device, state, reason) in [
        ("pvea-isobus", r#"dsm = "active""#, "dsm is never \"active\" on boom; accepted: \"none\""),
        ("pvea-canopen", r#"command = "extend""#, "command is never \"extend\" on boom; accepted: \"none\""),
        ("pvea-isobus", r#"nmt = "operational""#, "nmt is never \"operational\" on boom; accepted: \"none\""),
        ("hat1000", "set_point = 0", "set_point is never 0 on boom; accepted: \"none\""),
        ("hat1000", "solenoids = false", "accepted: \"none\""),
        ("hat1000", r#"led = { color = "green" }"#, "led is never green on boom; accepted: \"none\""),
        ("pvea-canopen", r#"name = "bom""#, "name is never \"bom\" on boom; accepted: \"boom\""),
        ("pvea-canopen", r#"kind = "pvea""#, "kind is never \"pvea\" on boom; accepted: \"pvea-canopen\""),
        (
            "pvea-canopen",
            "bit_rate = 800000",
            "bit_rate is never 800000 on boom; accepted: 125000, 250000, 500000, \"none\"",
        ),
        ("pvea-isobus", "bit_rate = 500000", "bit_rate is never 500000 on boom; accepted: 250000, \"none\""),
        ("pvea-canopen", "node_id = 200", "node_id is never 200 on boom; accepted: 1 to 127, \"none\""),
        ("hat3000", "node_id = 0", "accepted: 1 to 127, \"none\""),
        ("pvea-canopen", "bit_rate = 251000", "bit_rate 251000 is not valid; accepted: 1000000, 800000, 500000, "),
        ("pvea-canopen", "bit_rate = \"fast\"", "bit_rate \"fast\" is not valid; accepted: 1000000, 800000, 500000, "),
        ("pveo-isobus", "node_id = 0x20", "node_id is never 32 on boom; accepted: 128 to 143, \"none\""),
        ("pvea-canopen", "position = { min = 100, max = -100 }", "position: min 100 is above max -100"),
        ("pvea-canopen", "set_point = { min = 100, max = -100 }", "set_point: min 100 is above max -100"),
        ("pvea-canopen", "position = {}", "position: the condition is empty; give min, max, or both"),
        ("pvea-canopen", "set_point = {}", "set_point: the condition is empty; give min, max, or both"),
        ("pvea-canopen", "led = {}", "led: the condition is empty; give color, flashing, or both"),
        (
            "pvea-canopen",
            "position = 16385",
            "position 16385 is not valid; accepted: a whole number from -16384 to 16384",
        ),
        ("pvea-canopen", "position = { min = 20000 }", "-16384 to 16384"),
        ("pvea-canopen", "position = \"none\"", "position is never \"none\" on boom; accepted: -16384 to 16384"),
        ("pvea-isobus", "set_point = -16385", "-16384 to 16384"),
        ("hat1000", "position = -1", "position is never -1 on boom; accepted: 0 to 16383, \"none\""),
        ("hat1000", "position = { max = -1 }", "accepted: 0 to 16383, \"none\""),
        (
            "pvea-canopen",
            r#"led = { color = "yellow", flashing = true }"#,
            "led is never yellow flashing on boom; accepted: green constant, green flashing, yellow constant, red constant, red flashing, off constant",
        ),
        ("pvea-canopen", r#"solenoids = "none""#, "accepted: false, true"),
        (
            "pvea-canopen",
            r#"powered = false, dsm = "active""#,
            "dsm and powered never hold together on boom: powered occurs only without power",
        ),
        (
            "pvea-isobus",
            r#"faults = ["can-bus"], led = { color = "off" }"#,
            "faults and led never hold together on boom: led occurs only without power",
        ),
        ("pvea-isobus", r#"dsm = "none""#, "this condition is always true for boom; use one that can be false"),
        (
            "hat1000",
            r#"led = "none", set_point = "none""#,
            "this condition is always true for boom; use one that can be false",
        ),
        (
            "hat1000",
            r#"name = "boom", kind = "hat1000""#,
            "this condition is always true for boom; use one that can be false",
        ),
        (
            "pvea-canopen",
            "position = { min = -16384 }",
            "this condition is always true for boom; use one that can be false",
        ),
    ] {
        let said = refused(device, state);
        assert!(said.contains(reason), "{device} {state}\n{said}");
    }
}

/// A frame that no device on the bus can send is refused.
#[test]
fn a_frame_that_can_never_come_is_refused() {
    for (device, frame, reason) in [
        ("pvea-canopen", "720#R1", "no device sends remote frames; use a data frame"),
        ("pvea-isobus", "0CFE3080#R", "no device sends remote frames; use a data frame"),
        ("pvea-isobus", "1A0", "no device on the bus sends 11-bit identifiers; use 8 digits"),
    ] {
        for what in [format!("\"{frame}\""), format!("[\"???\", \"????????\", \"{frame}\"]")] {
            for word in ["expect", "never"] {
                let text =
                    format!("devices = [\"{device}\"]\nsteps = [\n  {{ {word} = {what} }}, {{ after_ms = 1 }} ]");
                let (line, said) = refusal(&text);
                assert_eq!(line, Some(3), "{said}");
                assert!(said.starts_with(&format!("{word}: ")) && said.contains("no device"), "{said}");
                if what.starts_with('"') {
                    assert_eq!(said, format!("{word}: '{frame}': {reason}"));
                }
            }
        }
    }
    for devices in [r#""hat1000""#, r#""pvea-isobus", "hat1000""#] {
        let text = format!("devices = [{devices}]\nsteps = [{{ never = [\"7F0\", \"18DAF1??\"], for_ms = 1 }}]");
        assert!(Scenario::parse(&text).is_ok(), "{devices}");
    }
}

#[test]
fn what_cannot_be_read_names_line_and_what_is_accepted() {
    assert_eq!(refusal(""), (Some(1), "no devices; add devices = [\"pvea-canopen@0x20\"]".to_owned()));
    let valve = "title = \"x\"\ndevices = [\"pvea-canopen@0x20\"]\n";
    assert_eq!(refusal(&format!("{valve}steps = []")).1, "no steps; add steps = [{ expect = \"720#00\" }]");
    for (text, line, reason) in [
        (
            "devices = [\n  \"pvea-canopen\",\n  \"pvex\" ]\nsteps = [{}]",
            3,
            "unknown kind 'pvex'; accepted: pvea-canopen",
        ),
        ("devices = [\"pvea-canopen\", \"pveo-canopen\"]\nsteps = [{}]", 1, "with @ID, or set allow_clash = true"),
        ("devices = [\"hat1000,name=a\", \"hat1000@2,name=a\"]\nsteps = [{}]", 1, "duplicate device name 'a'"),
        (
            "devices = [\"pvea-canopen\"]\nlinks = [\"a=b\"]\nsteps = [{}]",
            2,
            "no valve 'a' on the bus; accepted: pvea-canopen",
        ),
        ("devices = [\"pvea-canopen\"]\nbit_rate = 300\nsteps = [{}]", 2, "bit_rate 300 is not valid; accepted: "),
        (
            "device = [\"pvea-canopen\"]",
            1,
            "unknown key 'device'; did you mean 'devices'?; accepted: allow_clash, bit_rate, devices, links,",
        ),
        ("devices = [\"pvea-canopen\"]\nsteps = [{ expect = \"720#00\" ]", 2, "inline table"),
        ("devices = \"pvea-canopen\"", 1, "devices \"pvea-canopen\" is not valid; accepted: a list"),
    ] {
        let (found, said) = refusal(text);
        assert!(found == Some(line) && said.contains(reason), "{text}\n{found:?} {said}");
    }
}

#[test]
fn what_a_step_cannot_be() {
    for (step, reason) in [
        (r#"{ sent = "000#0100" }"#, "unknown key 'sent'; did you mean 'send'?; accepted: after_ms, any_order, at_ms,"),
        (r#"{ send = "000#01?0" }"#, "send: '000#01?0' is not a single frame"),
        (r#"{ send = "00#01" }"#, "send: '00#01': invalid identifier; accepted: IDENTIFIER#DATA"),
        (r#"{ expect = "1A0#0" }"#, "expect: '1A0#0': an incomplete byte"),
        ("{ expect = [] }", "expect: empty list"),
        ("{ expect = {} }", "expect: empty state"),
        (
            "{ expect = 5 }",
            "expect 5 is not valid; accepted: a frame as in \"1A0#0F00 0020\", a list of frames, or a state",
        ),
        (
            r#"{ expect = { dsn = "active" } }"#,
            "expect: unknown key 'dsn'; did you mean 'dsm'?; accepted: bit_rate, command, dsm,",
        ),
        (
            r#"{ expect = { dsm = "actve" } }"#,
            "expect.dsm: unknown value 'actve'; did you mean 'active'?; accepted: init, disabled",
        ),
        (
            r#"{ expect = { faults = ["set-up"] } }"#,
            "expect: 'set-up' is not a fault of pvea-canopen; accepted: spool-not-at",
        ),
        (
            r#"{ never = { position = "far" } }"#,
            "never.position \"far\" is not valid; accepted: a whole number from -16384 to 16384, {\"max\", \"min\"}, or \"none\"",
        ),
        ("{ plant = { suply_mv = 1 } }", "plant: unknown key 'suply_mv'; did you mean 'supply_mv'?"),
        (
            "{ plant = { supply_mv = 100001 } }",
            "plant.supply_mv 100001 is not valid; accepted: a whole number from 0 to 100000",
        ),
        (
            "{ plant = { supply_mv = 8.5 } }",
            "plant.supply_mv 8.5 is not valid; accepted: a whole number from 0 to 100000",
        ),
        (
            r#"{ plant = { spool = "bent" } }"#,
            "plant.spool: unknown value 'bent'; accepted: ok, stuck, slow, drifting, no-float, or",
        ),
        ("{ plant = { angle_cdeg = 5 } }", "plant: angle_cdeg 5: not a plant word of this kind"),
        (r#"{ plant = { supply_mv = "none" } }"#, "plant.supply_mv \"none\" is not valid; accepted: a whole number"),
        ("{ plant = {} }", "plant: empty change; give at least one key"),
        (r#"{ expect = "1A0", within_ms = 0 }"#, "within_ms must be at least 1 when expect is a frame"),
        ("{ power = { on = true, reset = \"watchdog\" } }", "power: must be { on = true }"),
        ("{ bus = { bit_rate = 1 } }", "bit_rate 1 is not valid; accepted: "),
        ("{ disturb = { frames = 1, extended = true } }", "disturb: extended is only valid together with id"),
        (r#"{ stop = "22G" }"#, "stop: \"22G\" is not an identifier; accepted: hex digits as in \"220\", or \"all\""),
        (
            r#"{ disturb = { frames = 1, id = "22G" } }"#,
            "disturb: id \"22G\" is not valid; accepted: 0 to 2047, or a hex string",
        ),
        (
            r#"{ send = "220#00", every_ms = 0 }"#,
            "every_ms 0 is not valid; accepted: a whole number from 1 to 4294967295",
        ),
        ("{ every_ms = 10 }", "every_ms is only valid together with send"),
        ("{ within_ms = 10 }", "within_ms is only valid together with expect"),
        ("{ for_ms = 10 }", "for_ms is only valid together with never"),
        (r#"{ expect = "1A0", any_order = true }"#, "any_order is only valid with two or more expected frames"),
        ("{ expect = { dsm = \"active\" }, since_ms = 1 }", "since_ms is only valid together with frames in expect or"),
        ("{ at_ms = 1, after_ms = 1 }", "at_ms and after_ms cannot be in the same step"),
        (r#"{ send = "220#00", stop = "220" }"#, "send and stop cannot be in the same step"),
        (r#"{ expect = "1A0", never = "0A0" }"#, "expect and never cannot be in the same step"),
        (
            r#"{ device = "pvea-canopen", send = "220#00" }"#,
            "device is only valid together with plant, power, or a state",
        ),
        (r#"{ device = "boom", power = { on = true } }"#, "device: 'boom' is not on the bus; accepted: pvea-canopen"),
    ] {
        let said = refused(step);
        assert!(said.contains(reason), "{step}\n{said}");
    }
    let two = "devices = [\"pvea-canopen\", \"hat1000\"]\nsteps = [{ expect = { position = 0 } }]";
    assert_eq!(refusal(two).1, "device is missing; accepted: pvea-canopen, hat1000");
}

/// The reported line is that of the key, not of the step.
#[test]
fn a_refusal_names_the_line_of_the_key() {
    let text =
        "devices = [\"pvea-canopen\"]\n[[steps]]\nnote = \"x\"\n[steps.plant]\nmemory = \"ok\"\nsupply_mv = 8.5\n";
    let reason = "plant.supply_mv 8.5 is not valid; accepted: a whole number from 0 to 100000".to_owned();
    assert_eq!(refusal(text), (Some(6), reason));
    let text = "devices = [\"pvea-canopen\"]\n[[steps]]\n[steps.expect]\nposition = {\n  max = 5,\n  mix = 5 }\n";
    assert_eq!(
        refusal(text),
        (Some(6), "expect.position: unknown key 'mix'; did you mean 'min'?; accepted: max, min".to_owned())
    );
}
