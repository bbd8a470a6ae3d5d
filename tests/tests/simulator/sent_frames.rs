//! Frames that have left the controller count as sent, whatever else waits there.

use hal_sim::scenario::Scenario;

/// Runs a scenario of one or more devices.
#[track_caller]
fn passes(devices: &str, steps: &str) {
    let rate = if devices.contains("isobus") { 250_000 } else { 125_000 };
    let text = format!("bit_rate = {rate}\ndevices = [{devices}]\nsteps = [\n{steps}\n]\n");
    let outcome = Scenario::parse(&text).unwrap_or_else(|error| panic!("{error:?}\n{text}")).run(1);
    assert!(outcome.is_success(), "{}", outcome.failures(devices));
}

/// A valve on CANopen whose SDO answer waits behind the traffic of a full bus.
fn beside_a_waiting_answer(setup: &str, then: &str) {
    const FULL: &str =
        "{ send = \"300#0000000000000000\", every_ms = 1 }, { send = \"301#0000000000000000\", every_ms = 1 }";
    let steps = format!(
        "{{ expect = \"720#00\" }}, {{ after_ms = 20 }},\n{setup}\n\
         {{ send = \"620#4001 1000 0000 0000\" }}, {FULL},\n{then}\n\
         {{ stop = \"300\" }}, {{ stop = \"301\" }}, {{ expect = \"5A0#4F01 1000 ..\", since_ms = 0 }}"
    );
    passes("\"pvea-canopen@0x20\"", &steps);
}

const START: &str = "{ send = \"000#0120\" },";
/// A fault that changes the mapped status word.
const FAULT: &str =
    "{ plant = { internal_fault = true }, never = \"1A0\", for_ms = 100 }, { expect = \"0A0#0010 ..\" },";

#[test]
fn a_tpdo_that_is_out_is_not_renewed() {
    let synchronous = format!("{{ send = \"620#2F00 1802 0100 0000\", expect = \"5A0#60..\" }}, {START}");
    beside_a_waiting_answer(
        &synchronous,
        &format!("{{ send = \"080#\", expect = \"1A0#..\" }}, {{ after_ms = 55 }}, {FAULT}"),
    );
    let event_driven = format!("{{ send = \"220#0000 0000\", expect = \"1A0#..\" }}, {{ after_ms = 55 }}, {FAULT}");
    beside_a_waiting_answer(START, &event_driven);
}

#[test]
fn an_emcy_that_is_out_is_not_repeated_after_bus_off() {
    let fault = "{ plant = { internal_fault = true }, expect = \"0A0#0010 ..\" }, { after_ms = 500 },";
    let bus_off = "{ plant = { bus_off = true } }, { after_ms = 50, stop = \"300\" }, { stop = \"301\" },\n\
                   { plant = { bus_off = false }, never = \"0A0#0010 ..\", for_ms = 200 }, { expect = \"0A0#4081 ..\" }";
    let full = "{ send = \"300#0000000000000000\", every_ms = 1 }, { send = \"301#0000000000000000\", every_ms = 1 },";
    let steps = format!(
        "{{ expect = \"720#00\" }}, {{ after_ms = 20 }}, {{ send = \"620#4001 1000 0000 0000\" }}, {full}\n{fault}\n{bus_off}"
    );
    passes("\"pvea-canopen@0x20\"", &steps);
    // The heartbeat that is destroyed until bus-off waits beside the EMCY.
    passes(
        "\"pvea-canopen@0x20\"",
        "{ expect = \"720#00\" }, { after_ms = 10, send = \"620#2B17 1000 6400 0000\", expect = \"5A0#60..\" }, { expect = \"720#7F\" },\n\
         { after_ms = 50, disturb = { frames = 33, id = \"720\" } }, { after_ms = 54, plant = { internal_fault = true } },\n\
         { expect = \"0A0#0010 ..\" }, { never = \"0A0#0010 ..\", for_ms = 100 }, { expect = \"0A0#4081 ..\", since_ms = 0 }",
    );
}

#[test]
fn an_emcy_that_is_out_keeps_its_entry_in_the_history() {
    passes(
        "\"hat1000@1\"",
        "{ expect = \"701#00\" }, { send = \"601#2B17 1000 6400 0000\", expect = \"581#60..\" },\n\
         { after_ms = 50, disturb = { frames = 33, id = \"701\" } }, { expect = \"081#2081 11..\" }, { expect = \"081#4081 11..\" },\n\
         { after_ms = 300, send = \"601#4003 1000 0000 0000\", expect = \"581#4F03 1000 0300 0000\" }",
    );
}

#[test]
fn a_tpdo_more_urgent_than_the_emcy_follows_it() {
    let setup = "{ send = \"620#2300 1801 9000 0080\", expect = \"5A0#60..\" },\n\
                 { send = \"620#2300 1801 9000 0000\", expect = \"5A0#60..\" }, { send = \"000#0120\" },";
    let then = "{ send = \"220#0000 0000\", expect = \"090#..\" },\n\
                { plant = { internal_fault = true }, expect = \"0A0#0010 ..\" },\n\
                { after_ms = 20, send = \"220#0000 0000\", expect = \"090#..\", within_ms = 50 },";
    beside_a_waiting_answer(setup, then);
}

/// An answer that the application delays does not delay the knowledge of the other frames.
#[test]
fn a_slow_answer_keeps_no_other_frame_unsent() {
    passes(
        "\"pvea-canopen@0x20,answer-ms=80\"",
        "{ expect = \"720#00\" }, { after_ms = 50, send = \"620#2F00 1802 0100 0000\", expect = \"5A0#60..\" },\n\
         { send = \"000#0120\" }, { send = \"620#4001 1000 0000 0000\" }, { send = \"080#\", expect = \"1A0#..\" },\n\
         { after_ms = 20, plant = { internal_fault = true }, never = \"1A0\", for_ms = 50 }, { expect = \"5A0#4F..\", since_ms = 0 }",
    );
}

/// An application with a slow cycle learns at the start of the cycle which of its frames were sent.
#[test]
fn a_slow_cycle_adds_no_frame() {
    let device = "\"pvea-canopen@0x20,cycle-ms=10\"";
    passes(
        device,
        "{ expect = \"720#00\" }, { after_ms = 100, send = \"620#2B17 1000 6400 0000\", expect = \"720#7F\" },\n\
         { expect = \"720#7F\", within_ms = 110 }, { send = \"000#0120\", never = \"720\", for_ms = 80 }, { expect = \"720#05\" }",
    );
    passes(
        device,
        "{ expect = \"720#00\" }, { after_ms = 100, send = \"000#0120\" }, { after_ms = 50, send = \"220#0F00 0000\", expect = \"1A0#..\" },\n\
         { send = \"620#2B40 6000 0000 0000\", never = \"1A0\", for_ms = 80 }, { expect = \"5A0#60..\", since_ms = 0 }",
    );
    passes(
        device,
        "{ expect = \"720#00\" }, { send = \"7E5#0401 0000 0000 0000\" },\n\
         { send = \"7E5#1500 0000 0000 0000\", never = \"720\", for_ms = 50 }",
    );
}

/// A bus-off that begins and ends between two cycles of the application still is a bus-off.
#[test]
fn a_slow_cycle_hides_no_bus_off() {
    passes(
        "\"pvea-canopen@0x20,cycle-ms=40\"",
        "{ expect = \"720#00\" }, { after_ms = 50, send = \"000#0120\" },\n\
         { after_ms = 50, send = \"220#0F00 0010\", every_ms = 100, expect = { dsm = \"active\" } },\n\
         { after_ms = 50, disturb = { frames = 32, id = \"1A0\" } }, { expect = \"0A0#4081 ..\" }, { expect = { dsm = \"fault-hold\" } }",
    );
    passes(
        "\"pvea-isobus@0x83,cycle-ms=40\"",
        "{ expect = \"18EEFF83#..\" }, { after_ms = 300, send = \"0CFE3327#00FF 30FF FFFF FFFF\" },\n\
         { after_ms = 50, send = \"0CFE3327#7DFF 31FF FFFF FFFF\", every_ms = 50, expect = { command = \"extend\" } },\n\
         { after_ms = 60, disturb = { frames = 32, id = \"0CFE1383\" } }, { expect = { command = \"blocked\" } }",
    );
}

/// A claim that bus-off interrupts is owed until it is sent.
#[test]
fn an_address_is_defended_or_given_up_after_bus_off() {
    let device = "\"pvea-isobus@0x83\"";
    passes(
        device,
        "{ after_ms = 500, send = \"18EEFF83#0200 2007 08FF 0220\" }, { disturb = { frames = 32 } },\n\
         { expect = \"18EEFF83#0100 2007 08FF 0220\" }",
    );
    passes(
        device,
        "{ after_ms = 500, send = \"18EEFF83#0000 2007 08FF 0220\" }, { plant = { bus_off = true } },\n\
         { after_ms = 200, plant = { bus_off = false } }, { expect = \"18EEFFFE#0100 2007 08FF 0220\" }",
    );
}

/// A DM2 in several packets keeps its own times, with any delay of the answers and any cycle up to 100 ms.
#[test]
fn a_slow_application_sends_a_dm2_in_several_packets_whole() {
    for slow in ["answer-ms=20..80", "answer-ms=100", "answer-ms=1000", "cycle-ms=45", "cycle-ms=60", "cycle-ms=100"] {
        let steps = "{ expect = \"18EEFF83#..\" }, { after_ms = 300, send = \"0CFE3327#00FF 30FF FFFF FFFF\", every_ms = 100 },\n\
                     { plant = { internal_fault = true } }, { after_ms = 200, plant = { internal_fault = false } },\n\
                     { plant = { temperature_c = 130 } }, { after_ms = 300, plant = { temperature_c = 25 } },\n\
                     { after_ms = 2000, send = \"18EA8327#CBFE 00\", expect = [\"1CECFF83#20..\", \"1CEBFF83#01..\", \"1CEBFF83#02..\"] },\n\
                     { never = \"1CECFF83\", for_ms = 1000 }";
        passes(&format!("\"pvea-isobus@0x83,{slow}\""), steps);
    }
}

/// The last of several orders for the address wins, also if the memory is busy.
#[test]
fn the_last_order_for_the_address_wins() {
    let commanded = |address: &str| {
        format!(
            "{{ send = \"1CECFF27#2009 0002 FFD8 FE00\" }}, {{ send = \"1CEBFF27#0101 0020 0708 FF02\" }},\n\
             {{ send = \"1CEBFF27#0220 {address}FF FFFF FFFF\" }},"
        )
    };
    let steps = format!(
        "{{ after_ms = 300, plant = {{ internal_fault = true }} }}, {{ after_ms = 20, plant = {{ internal_fault = false }} }},\n\
         {{ after_ms = 100, send = \"0CFE3327#00FF 30FF FFFF FFFF\" }}, {{ after_ms = 100, send = \"0CFE3327#00FF 30FF FFFF FFFF\" }},\n\
         {{ after_ms = 5000, send = \"18EA8327#CCFE 00\" }}, {}\n{{ send = \"1BC78883#042E 1001 86\" }}, {}\n\
         {{ after_ms = 500, expect = {{ node_id = 0x87 }}, within_ms = 0 }}",
        commanded("85"),
        commanded("87")
    );
    passes("\"pvea-isobus@0x83\"", &steps);
}

/// Two valves do not answer each other's answers.
#[test]
fn a_uds_answer_is_no_request() {
    passes(
        "\"pvea-isobus@0x82\", \"pvea-isobus@0x83,serial=9\"",
        "{ after_ms = 500, send = \"1BC41882#0322 F010\", expect = \"1BC41083#..\" }, { never = \"1BC41882\", for_ms = 50 }",
    );
}
