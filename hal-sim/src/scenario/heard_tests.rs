//! Devices at a bit rate different from the bus: detected at power-up, after each bit rate change, and at the end.

use super::*;

/// Returns the failures of a scenario with these devices and steps, each with its line number.
fn failures(devices: &str, steps: &str) -> Vec<(usize, String)> {
    let text = format!("devices = [{devices}]\nsteps = [\n{steps}\n]");
    let outcome = Scenario::read(&text).unwrap_or_else(|error| panic!("{text}: {error:?}")).run(1);
    outcome.failures.into_iter().map(|failure| (failure.line, failure.headline)).collect()
}

fn passes(devices: &str, steps: &str) {
    assert_eq!(failures(devices, steps), [], "{devices} {steps}");
}

const DEAF_SENSOR: &str = "hat1000 runs at 500 kbit/s and the bus at 250 kbit/s: it cannot communicate and will disturb \
                           the bus; use hat1000,bit-rate=250k, or a bus at 500k";

const DEAF_VALVE: &str = "pvea-canopen runs at 500 kbit/s and the bus at 250 kbit/s: it cannot communicate and will \
                          disturb the bus; use a bus at 500k";

const LEFT_VALVE: &str = "pvea-canopen runs at 250 kbit/s and the bus at 500 kbit/s: it cannot communicate and will \
                          disturb the bus; use pvea-canopen,bit-rate=500k, or a bus at 250k";

const VALVE: &str = "\"pvea-canopen\"";

/// The steps that configure 500 kbit/s by LSS.
const CONFIGURED: &str = "{ expect = \"720#00\" }, { send = \"7E5#0401 0000 0000 0000\" }, \
                          { send = \"7E5#1300 0200 0000 0000\", expect = \"7E4#1300 0000 0000 0000\" },";

#[test]
fn a_device_without_a_rate_takes_that_of_the_bus() {
    let boots = r#"{ expect = ["720#00", "701#00"], any_order = true }"#;
    passes(r#""pvea-canopen", "hat1000""#, boots);
    passes(r#""hat1000", "pvea-canopen""#, boots);
    passes(r#""pvea-canopen,bit-rate=125k", "hat1000""#, boots);
    let text = format!("bit_rate = 125000\ndevices = [{VALVE}]\nsteps = [{{ expect = {{ bit_rate = 125000 }} }}]");
    let outcome = Scenario::parse(&text).expect("a scenario").run(1);
    assert!(outcome.is_success(), "{}", outcome.failures("x.toml"));
}

#[test]
fn a_device_that_is_asked_to_run_at_another_rate_fails_although_nothing_else_does() {
    let devices = "\"pvea-canopen\",\n\"hat1000,bit-rate=500k\"";
    for steps in ["{ expect = \"720#00\" }", "{ after_ms = 1 }", "{ never = \"081\", for_ms = 2000 }"] {
        assert_eq!(failures(devices, steps), [(2, DEAF_SENSOR.to_owned())], "{steps}");
    }
}

/// There is no grace period at power-up: the bus must have the device's bit rate from the start.
#[test]
fn the_first_power_up_has_no_second() {
    let text = "bit_rate = 250000\ndevices = [\"hat1000,bit-rate=500k\"]\n\
                steps = [{ after_ms = 10, bus = { bit_rate = 500000 } }, { after_ms = 2000 }]";
    let outcome = Scenario::read(text).expect("a scenario").run(1);
    let told: Vec<_> = outcome.failures.iter().map(|failure| (failure.line, &*failure.headline)).collect();
    assert_eq!(told, [(2, DEAF_SENSOR)]);
}

/// The suggested remedy depends on the setup of the device and on the bit rates of its product.
#[test]
fn the_remedy_fits_the_device() {
    for (device, remedy) in [
        ("hat1000@5,name=boom,bit-rate=500k", "use hat1000@0x05,name=boom,bit-rate=250k, or a bus at 500k"),
        ("hat3000,blank,bit-rate=1M", "use hat3000,blank,bit-rate=250k, or a bus at 1000k"),
    ] {
        let [(2, told)] = &failures(&format!("{VALVE}, \n\"{device}\""), "{ expect = \"720#00\" }")[..] else {
            panic!("one failure: {device}");
        };
        assert!(told.ends_with(remedy), "{told}");
    }
    let of_isobus = failures(r#""hat1000", "pvea-isobus""#, "{ expect = \"701#00\" }");
    assert!(of_isobus[0].1.ends_with("disturb the bus; use a bus at 250k"), "{of_isobus:?}");
}

#[test]
fn one_that_is_not_to_be_heard_says_so() {
    for heard in ["false", "true"] {
        let devices = format!("{VALVE}, {{ device = \"hat1000,bit-rate=500k\", heard = {heard} }}");
        let told = failures(&devices, "{ expect = \"720#00\" }");
        assert_eq!(told.is_empty(), heard == "false", "{told:?}");
    }
    for (wrong, reason) in [
        ("{ device = \"hat1000\", herd = false }", "unknown key 'herd'; did you mean 'heard'?"),
        ("{ heard = false }", "accepted: "),
        ("1", "accepted: "),
    ] {
        let error = Scenario::parse(&format!("devices = [\n{wrong}]\nsteps = [{{ after_ms = 1 }}]")).expect_err(wrong);
        assert_eq!(error.line, Some(2), "{wrong}");
        assert!(error.reason.starts_with("devices[0]") && error.reason.contains(reason), "{}", error.reason);
    }
}

#[test]
fn errors_of_the_bus_are_in_the_report() {
    let text = "devices = [\"pvea-canopen\", \"hat1000,bit-rate=500k\"]\nsteps = [{ after_ms = 100 }]";
    let report = Scenario::read(text).expect("a scenario").run(1).failures("x.toml");
    let wanted = "    if this is intended, declare the device as { device = \"…\", heard = false }\n    bus errors:\n";
    assert!(report.contains(wanted) && report.contains("hat1000: error-passive ("), "{report}");
}

/// The bus and the device each have one second to follow the other's bit rate change.
#[test]
fn the_bus_and_a_device_meet_again_within_a_second() {
    let activate = format!("{CONFIGURED} {{ send = \"7E5#1500 0000 0000 0000\" }},");
    let follows =
        |ms: u32| format!("{activate} {{ after_ms = {ms}, bus = {{ bit_rate = 500000 }} }}, {{ after_ms = 2000 }}");
    passes(VALVE, &follows(0));
    passes(VALVE, &follows(999));
    assert_eq!(failures(VALVE, &follows(1001)), [(3, DEAF_VALVE.to_owned())]);
    let leads = |ms: u32| {
        format!(
            "{{ expect = \"720#00\" }}, {{ bus = {{ bit_rate = 500000 }} }},\n {{ after_ms = {ms}, bus = {{ bit_rate = 250000 }} }}, {{ after_ms = 2000 }}"
        )
    };
    passes(VALVE, &leads(999));
    assert_eq!(failures(VALVE, &leads(1001)), [(3, LEFT_VALVE.to_owned())]);
}

/// A bit rate stored by SDO takes effect at reset node.
#[test]
fn a_reset_to_a_stored_rate_is_a_change_of_it() {
    let reset = "{ expect = \"701#00\" },\n\
                 { send = \"601#2F02 2002 0400 0000\", expect = \"581#6002 2002 0000 0000\" },\n\
                 { send = \"601#2310 1004 7361 7665\", expect = \"581#6010 1004 0000 0000\" },\n\
                 { send = \"000#8100\" },";
    let follows =
        |ms: u32| format!("{reset}\n{{ after_ms = {ms}, bus = {{ bit_rate = 125000 }} }}, {{ after_ms = 2000 }}");
    const SENSOR: &str = "\"hat1000,bit-rate=250k\"";
    passes(SENSOR, &follows(999));
    let told = "hat1000 runs at 125 kbit/s and the bus at 250 kbit/s: it cannot communicate and will disturb the bus; \
                use a bus at 125k";
    assert_eq!(failures(SENSOR, &follows(1001)), [(6, told.to_owned())]);
}

#[test]
fn the_end_of_the_scenario_and_of_a_never_wait_for_nobody() {
    let left = "{ expect = \"720#00\" }, { bus = { bit_rate = 500000 } },";
    assert_eq!(failures(VALVE, left), [(3, LEFT_VALVE.to_owned())]);
    let and_back = "{ bus = { bit_rate = 250000 } }, { after_ms = 2000 }";
    for never in ["\"0B0\"", "{ nmt = \"stopped\" }"] {
        // The silence of a valve that cannot communicate proves nothing.
        let silence = format!("{left}\n{{ never = {never}, for_ms = 100 }},\n");
        for pause in ["", "{ after_ms = 100 },", "{ after_ms = 500 },"] {
            let told = failures(VALVE, &format!("{silence}{pause}{and_back}"));
            let wanted = if pause.is_empty() { vec![] } else { vec![LEFT_VALVE.to_owned()] };
            assert_eq!(told.into_iter().map(|(_, told)| told).collect::<Vec<_>>(), wanted, "{never} {pause}");
        }
    }
    // A valve without power is not reported.
    passes(VALVE, &format!("{left} {{ power = {{ on = false }} }}"));
}

/// Activate bit timing with a delay: the valve is silent until the end of the second delay, regardless of when the
/// master changes its bit rate.
#[test]
fn the_time_of_a_switch_by_lss_does_not_count() {
    let activate = format!("{CONFIGURED}\n{{ send = \"7E5#15B8 0B00 0000 0000\" }},"); // 3 s, twice
    let joins =
        |ms: u32| format!("{activate} {{ after_ms = {ms}, bus = {{ bit_rate = 500000 }} }}, {{ after_ms = 8000 }}");
    for ms in [0, 2999, 3001, 5999, 6900] {
        passes(VALVE, &joins(ms));
    }
    assert_eq!(failures(VALVE, &joins(7100)), [(4, DEAF_VALVE.to_owned())]);
    // The silence of the valve can be checked, and the bus has the right bit rate at the end.
    let silent = format!("{activate} {{ never = \"7??\", for_ms = 5900 }},");
    passes(VALVE, &format!("{silent} {{ bus = {{ bit_rate = 500000 }} }}, {{ after_ms = 2000 }}"));
    assert_eq!(failures(VALVE, &silent), [(4, DEAF_VALVE.to_owned())]);
}

#[test]
fn a_later_power_up_at_a_stored_rate_counts_as_the_first() {
    let stored =
        format!("{CONFIGURED} {{ send = \"7E5#1700 0000 0000 0000\", expect = \"7E4#1700 0000 0000 0000\" }},");
    let cycle = |between: &str| {
        format!("{stored} {{ power = {{ on = false }} }},\n{between} {{ after_ms = 100, power = {{ on = true }} }},")
    };
    let boots = "{ expect = \"720#00\" }";
    passes(VALVE, &format!("{}{boots}", cycle("{ bus = { bit_rate = 500000 } },")));
    // At the same time.
    passes(VALVE, &format!("{} {{ bus = {{ bit_rate = 500000 }} }}, {boots}", cycle("")));
    let late = format!("{} {{ after_ms = 10, bus = {{ bit_rate = 500000 }} }}, {boots}", cycle(""));
    assert_eq!(failures(VALVE, &late), [(4, DEAF_VALVE.to_owned())]);
    // Two periods, two reports.
    let twice = format!(
        "{} {{ after_ms = 10, power = {{ on = false }} }}, {{ after_ms = 10, power = {{ on = true }} }}",
        cycle("")
    );
    assert_eq!(failures(VALVE, &twice), [(4, DEAF_VALVE.to_owned()), (4, DEAF_VALVE.to_owned())]);
}
