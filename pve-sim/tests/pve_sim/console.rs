//! The console of a running simulator: typed lines and their answers.

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;

use rustix::process::Signal;

use crate::simulator::{Simulator, pve_sim};

const ANY_PORT: [&str; 2] = ["--bus", "socketcand://127.0.0.1:0/pve0"];

#[test]
fn a_valve_is_broken_by_hand() {
    let arguments = [&ANY_PORT[..], &["--no-http", "--speed", "100"]].concat();
    let mut simulator = Simulator::spawn(pve_sim(&arguments).stdin(Stdio::piped()));
    let mut stdin = simulator.process.stdin.take().expect("a pipe");
    let mut stderr = BufReader::new(simulator.process.stderr.take().expect("a pipe"));
    // a script with Windows line ends
    stdin.write_all(b"supply_mv 8000\r\nspool bent\nstatus\n").expect("it reads");
    let mut answers = String::new();
    while !answers.contains("supply_mv 8000, ") {
        assert_ne!(stderr.read_line(&mut answers).expect("text"), 0, "{answers}");
    }
    assert!(answers.contains("\nok\n"), "{answers}");
    assert!(answers.contains("pve-sim: 'spool bent' is not a valid command; accepted: supply_mv N"), "{answers}");
    // The end of stdin does not end the run: the monitor reports after its two seconds.
    drop(stdin);
    while !simulator.line().contains("EMCY: supply too low") {}
    simulator.process.stderr = Some(stderr.into_inner());
    simulator.end(Signal::TERM);
}

#[test]
fn the_start_names_the_panel_and_the_words() {
    let simulator = Simulator::serve(&["--http", "127.0.0.1:0"]);
    let panel = format!("\nPanel: http://{}/\n", simulator.http());
    let (_, said) = simulator.end(Signal::TERM);
    assert!(said.contains(&panel), "{said}");
    assert!(said.contains("\nType help for the console commands\n"), "{said}");
}

/// Before the ready line, so that a reader of that line finds the warning.
#[test]
fn another_bit_rate_than_that_of_the_bus_is_told_at_the_start() {
    let device = ["--device", "pvea-canopen,bit-rate=250k"];
    let mut simulator = Simulator::start(&[&ANY_PORT[..], &device, &["--bit-rate", "500k"]].concat());
    let mut stderr = BufReader::new(simulator.process.stderr.take().expect("a pipe")).lines();
    let first = stderr.next().expect("a warning").expect("text");
    assert_eq!(
        first,
        "pve-sim: pvea-canopen runs at 250 kbit/s and the bus at 500 kbit/s: it cannot communicate and will disturb the \
         bus; use pvea-canopen,bit-rate=500k, or a bus at 250k"
    );
}

/// The first device's memory determines the rate of the bus, and a device with a new memory takes it.
#[test]
fn a_stored_bit_rate_is_that_of_the_bus() {
    let folder = tempfile::tempdir().expect("a folder");
    let state = folder.path().to_str().expect("text");
    let run = |devices: &[&str]| {
        let options = [&ANY_PORT[..], &["--state", state, "--speed", "100"], devices].concat();
        let mut simulator = Simulator::start(&options);
        while !simulator.line().contains("701#00") {}
        let (_, told) = simulator.end(Signal::TERM);
        told
    };
    let told = run(&["--device", "hat1000,bit-rate=125k"]);
    assert!(!told.contains("cannot communicate"), "{told}");
    // A bit rate on the command line fills a new memory only.
    let told = run(&["--device", "hat1000,bit-rate=1M", "--device", "pvea-canopen"]);
    assert!(!told.contains("cannot communicate"), "{told}");
    let told = run(&["--device", "hat1000", "--device", "pvea-canopen,bit-rate=500k"]);
    assert!(!told.contains("cannot communicate"), "the valve has 125k stored: {told}");
    let told = run(&["--device", "hat1000", "--device", "hat3000@2,bit-rate=500k"]);
    assert!(told.contains("use hat3000@0x02,bit-rate=125k, or a bus at 500k"), "{told}");
    // With 500k in its memory, no rate on the command line is a remedy.
    let told = run(&["--device", "hat1000", "--device", "hat3000@2,bit-rate=500k"]);
    assert!(told.contains("will disturb the bus; use a bus at 500k"), "{told}");
    let told = run(&["--device", "hat1000", "--device", "hat3000@2,bit-rate=125k"]);
    assert!(told.contains("will disturb the bus; use a bus at 500k"), "its memory decides: {told}");
}
