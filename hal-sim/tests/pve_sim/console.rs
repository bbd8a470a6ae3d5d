//! What a person types into the terminal of a running simulator, and what that answers.

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
    // a script with lines as Windows writes them
    stdin.write_all(b"supply_mv 8000\r\nspool bent\nstatus\n").expect("it reads");
    let mut answers = String::new();
    while !answers.contains("supply_mv 8000, ") {
        assert_ne!(stderr.read_line(&mut answers).expect("text"), 0, "{answers}");
    }
    assert!(answers.contains("\nok\n"), "{answers}");
    assert!(answers.contains("pve-sim: 'spool bent' is not understood; accepted: supply_mv N"), "{answers}");
    // The end of stdin is not the end: the monitor reports after its two seconds.
    drop(stdin);
    while !simulator.line().contains("EMCY: supply too low") {}
    simulator.process.stderr = Some(stderr.into_inner());
    simulator.end(Signal::TERM);
}

#[test]
fn the_start_names_the_panel_and_the_words() {
    let mut simulator = Simulator::serve(&["--http", "127.0.0.1:0"]);
    let panel = format!("Panel: http://{}/", simulator.http());
    let mut stderr = BufReader::new(simulator.process.stderr.take().expect("a pipe")).lines();
    let mut next = || stderr.next().expect("a line").expect("text");
    while next() != panel {}
    assert_eq!(next(), "Type help for the words that change what a device senses, and status");
}

#[test]
fn another_bit_rate_than_that_of_a_device_is_told_at_the_start() {
    let mut simulator = Simulator::start(&[&ANY_PORT[..], &["--bit-rate", "500k"]].concat());
    let mut stderr = BufReader::new(simulator.process.stderr.take().expect("a pipe")).lines();
    let told = stderr.find_map(|line| line.ok().filter(|line| line.contains("pvea-canopen is"))).expect("a warning");
    assert_eq!(
        told,
        "pve-sim: pvea-canopen is set to 250000 bit/s, the bus runs at 500000 bit/s: it is not heard, and disturbs"
    );
}
