//! Unmodified clients, over python-can's socketcand interface, against the `pve-sim` process that users run:
//! python-canopen here, can-j1939 in `isobus`, others in `strangers`; over other buses in `socketcan`, `slcan` and
//! `udp_multicast`; a browser in `panel`.
//!
//! `./test` makes the virtual environment `target/venv` with the clients; the scripts are in `tests/clients/`, one
//! subject each.

/// Tests of one call each.
macro_rules! calls {
    ($($(#[$meta:meta])* $name:ident: $call:expr;)*) => {
        $(
            $(#[$meta])*
            #[test]
            fn $name() {
                $call;
            }
        )*
    };
}

mod command_line;
mod control;
mod dissectors;
mod eight_errors;
mod isobus;
mod panel;
mod programs;
mod readme;
mod recordings;
mod simulator;
mod slcan;
mod socketcan;
mod strangers;
mod tshark;
mod udp_multicast;

use std::ffi::OsStr;
use std::fs;
use std::process::Command;

use programs::output;
use recordings::serve_and_replay;
use simulator::{FREE, PVE_SIM, Simulator, Start, WOUND, python, root};

/// The valve as it is without an option.
const VALVE: [&str; 2] = ["--device", "pvea-canopen@0x20"];

/// Runs a script against a simulator of its own, and sees that end well.
fn serve(start: Start, script: &str, options: &[&str]) {
    let simulator = start(options);
    simulator.serve(script, &[]);
    simulator.terminate();
}

calls! {
    boots_goes_active_and_moves_the_spool: serve_and_replay(WOUND, "boot.log", "boot.py", &["11149437"], &VALVE);
    falls_into_fault_hold_without_set_points_and_comes_back: serve(WOUND, "fault.py", &[]);
    every_object_is_read_and_written: serve(FREE, "objects.py", &[]);
    pdos_are_remapped_in_both_orders: serve_and_replay(FREE, "mapping.pcapng", "mapping.py", &[], &VALVE);
    pdos_follow_sync: serve_and_replay(FREE, "sync.asc", "sync.py", &[], &VALVE);
    emergencies_are_logged_and_consumed: serve(WOUND, "emcy.py", &[]);
    every_nmt_command: serve(FREE, "nmt.py", &[]);
    heartbeats: serve(FREE, "heartbeat.py", &[]);
    takes_another_node_id_by_lss: serve(FREE, "lss.py", &[]);
    many_clients_at_once: serve(FREE, "crowd.py", &[]);
    a_logger_only_listens: serve(FREE, "logger.py", &[]);
    an_angle_sensor_and_its_master: serve_and_replay(FREE, "hat.log", "hat.py", &[], &["--device", "hat1000"]);
}

/// At a node ID that is no kind's default.
#[test]
fn the_eds_says_what_the_device_does() {
    for kind in ["pvea-canopen", "pveo-canopen", "hat1000", "hat3000"] {
        let simulator = Simulator::start(&["--device", &format!("{kind}@0x35,serial=77")]);
        simulator.serve("eds.py", &[kind, "0x35", "77"]);
        simulator.terminate();
    }
}

#[test]
fn what_was_stored_outlives_the_process() {
    let state = tempfile::tempdir().expect("a directory for the state");
    for phase in ["store", "found", "restored"] {
        let simulator = Simulator::start(&[OsStr::new("--state"), state.path().as_os_str()]);
        simulator.serve("store.py", &[phase]);
        simulator.terminate();
    }
}

#[test]
fn takes_another_bit_rate_by_lss() {
    let state = tempfile::tempdir().expect("a directory for the state");
    let state = state.path().to_str().expect("text");
    // Without an option the bus has the rate of the valve, as if the master had found it out.
    for (phase, rate) in
        [("activate", None), ("forgotten", None), ("deaf", Some("250k")), ("found", Some("500k")), ("found", None)]
    {
        let rate = rate.map_or_else(Vec::new, |rate| vec!["--bit-rate", rate]);
        let simulator = Simulator::start(&[&["--error-frames", "--state", state], &rate[..]].concat());
        simulator.serve("bit_timing.py", &[phase]);
        simulator.terminate();
    }
}

#[test]
fn a_blank_valve_is_found_by_fast_scan() {
    let devices = ["--device", "pvea-canopen,blank", "--device", "pvea-isobus@0x83"];
    serve_and_replay(FREE, "scan.log", "scan.py", &[], &devices);
}

#[test]
fn several_valves_on_one_bus() {
    let devices = [
        "--device",
        "pvea-canopen@0x05,serial=0x101",
        "--device",
        "pvea-canopen@0x20,serial=0x102,name=boom",
        "--device",
        "pveo-canopen@0x7F,serial=0x103",
        "--device",
        "pvea-canopen,blank,serial=0x104",
    ];
    serve(WOUND, "several.py", &devices);
}

#[test]
fn clients_that_die_disturb_nobody() {
    let simulator = Simulator::start_with_few_descriptors();
    simulator.serve("dying.py", &[]);
    simulator.terminate();
}

#[test]
fn several_angle_sensors_and_a_blank_valve_by_lss() {
    let devices = ["hat1000,bit-rate=250k", "hat1000@2,bit-rate=250k", "pvea-canopen,blank"];
    let blank = "hat1000,bit-rate=250k,serial=7,blank";
    let options: Vec<&str> = devices.into_iter().chain([blank]).flat_map(|device| ["--device", device]).collect();
    serve(FREE, "hat_lss.py", &options);
}

/// The example of the documentation: closed loop through a valve and a sensor, beside a valve on ISOBUS.
#[test]
fn a_boom_is_moved_to_an_angle_and_held_there() {
    let devices = ["pvea-canopen", "hat1000,bit-rate=250k", "pvea-isobus"].map(|device| ["--device", device]);
    let link = ["--link", "pvea-canopen=hat1000"];
    let simulator = Simulator::start_wound(&[devices.as_flattened(), &link].concat());
    for degrees in ["45", "12.5"] {
        let steps = simulator.serve("../../examples/boom.py", &[degrees]);
        let (_, last) = steps.lines().last().and_then(|line| line.split_once(' ')).expect("an angle");
        let (last, wanted): (f64, f64) = (last.parse().expect("an angle"), degrees.parse().expect("a number"));
        assert!((last - wanted).abs() < 0.5, "at {last}, not {wanted}");
    }
    simulator.terminate();
}

/// The examples that read a description, twice in a row: the first visit leaves a fault.
#[test]
fn valves_are_driven_by_the_names_of_their_descriptions() {
    for (description, kind, example, last) in [
        ("eds", "pvea-canopen", "canopen_names.py", "EMCY 8003: Monitoring\n"),
        ("dbc", "pvea-isobus", "isobus.py", "DM1: time guarding (SPN 298985), received network data in error\n"),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join(format!("pvea.{description}"));
        fs::write(&file, output(Command::new(&*PVE_SIM).args([description, kind])).stdout).expect("room");
        let simulator = Simulator::start_wound(&["--device", kind]);
        for _ in 1..=2 {
            let printed = simulator.serve(&format!("../../examples/{example}"), &[file.to_str().expect("text")]);
            assert!(printed.ends_with(last), "{printed}");
        }
        simulator.terminate();
    }
}

/// Runs an example that must fail with exit code 1. Returns what it wrote on stderr.
fn refusal_of(example: &str, arguments: &[&str]) -> String {
    let run = output(Command::new(python()).arg(root().join(example)).args(arguments));
    let told = String::from_utf8(run.stderr).expect("text");
    assert_eq!(run.status.code(), Some(1), "{example}: {told}");
    assert!(!told.contains("Traceback"), "{example}: {told}");
    told
}

#[test]
fn an_example_without_its_arguments_tells_them() {
    for example in ["boom.py", "canopen_names.py", "isobus.py", "step_response.py"] {
        let told = refusal_of(&format!("examples/{example}"), &[]);
        assert!(told.contains(&format!(": {example} ")), "{told}");
    }
    assert!(refusal_of("python/examples/master.py", &[]).contains("`python3 master.py careful "));
}

#[test]
fn the_faults_say_in_one_line_that_no_simulator_is_there() {
    let told = refusal_of("examples/faults.py", &["http://127.0.0.1:1"]);
    assert!(told.starts_with("http://127.0.0.1:1/api/v1: ") && told.lines().count() == 1, "{told}");
}

#[test]
fn a_log_without_a_boom_is_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("empty.log");
    fs::write(&log, "(0.000268) pve0 720#00\n").expect("room");
    let log = log.to_str().expect("text");
    assert_eq!(
        refusal_of("examples/step_response.py", &[log, "60"]),
        format!("{log}: no frame 181 after an NMT start\n")
    );
}
