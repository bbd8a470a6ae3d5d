//! Clients that are not valves' masters: a service tool by udsoncan and can-isotp, and a crowd that behaves badly.

use std::fs;
use std::time::Duration;

use hal_sim::bus::FrameBits;
use protocol_core::frame::Frame;

use super::simulator::Simulator;

/// At 250 kbit/s, in microseconds.
const BIT: u64 = 4;

#[test]
fn a_service_tool_reads_and_writes_by_uds() {
    for (device, [node, serial, new]) in [
        ("pvea-canopen@0x20", ["0x20", "0x5B2E0100", "0x21"]),
        ("pveo-isobus@0x83,serial=0x12345", ["0x83", "0x12345", "0x8F"]),
    ] {
        let simulator = Simulator::start(&["--device", device]);
        simulator.serve("uds.py", &[node, serial, new]);
        simulator.terminate();
    }
}

/// A line of a log: when in microseconds, and the frame.
fn logged(line: &str) -> (u64, Frame) {
    let words: Vec<&str> = line.split(' ').collect();
    let [at, _, frame] = words[..] else { panic!("{line}") };
    let at = at.replace(['(', ')', '.'], "").parse().expect("a time");
    let (id, data) = frame.split_once('#').expect("a frame");
    let data: Vec<&str> = (0..data.len()).step_by(2).map(|at| &data[at..at + 2]).collect();
    (at, format!("{id}: {}", data.join(" ")).parse().expect("a frame"))
}

#[test]
fn every_valve_of_a_full_bus_answers_in_time() {
    const ROUNDS: usize = 3;
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join("frames.log");
    let devices = (1..=127).flat_map(|id| ["--device".to_owned(), format!("pvea-canopen@{id}")]);
    let options = ["--log".to_owned(), log.to_str().expect("text").to_owned()];
    let simulator = Simulator::start(&devices.chain(options).collect::<Vec<_>>());
    simulator.serve("poll.py", &[&ROUNDS.to_string()]);
    simulator.terminate();
    let log = fs::read_to_string(log).expect("the log");
    let frames: Vec<(u64, Frame)> = log.lines().map(logged).collect();
    let first = frames.iter().position(|(_, frame)| frame.to_string().starts_with("601:")).expect("a request");
    let polled = &frames[first..];
    assert_eq!(polled.len(), 2 * 127 * ROUNDS, "a request and an answer each");
    for pair in polled.chunks(2) {
        let (asked, answered) = (pair[0].0, pair[1].0);
        let frame = u64::from(FrameBits::of(&pair[1].1).on_wire()) * BIT;
        assert!(answered - asked <= frame + 200, "{} after {} µs", pair[1].1, answered - asked);
    }
}

/// Twenty minutes by hand: `ROUGH_SECONDS=1200 cargo test -p tests --features clients rough`.
#[test]
fn rough_clients_spoil_nothing() {
    let simulator = Simulator::start(&["--device", "pvea-canopen"]);
    let seconds = std::env::var("ROUGH_SECONDS").map_or(10, |seconds| seconds.parse().expect("a number"));
    let told = simulator.serve_for(
        Duration::from_secs(seconds),
        "rough.py",
        &[&seconds.to_string(), &simulator.id().to_string()],
    );
    print!("{told}");
    simulator.terminate();
}
