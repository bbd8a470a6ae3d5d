//! Unmodified clients that take `pve-sim` for an adapter on a serial line: python-can's `slcan` with pyserial, over TCP
//! and on a pseudo-terminal, under python-canopen and can-j1939; `slcand` with the kernel's slcan.

use std::fs;

use super::simulator::Simulator;
use super::socketcan::on_a_kernel;

/// An adapter over TCP.
const OVER_TCP: [&str; 2] = ["--bus", "slcan://127.0.0.1:0"];

/// What `can.Bus` wants to reach that.
fn over_tcp(simulator: &Simulator) -> String {
    bus(&format!("socket://{}", simulator.bus("slcan://")))
}

fn bus(channel: &str) -> String {
    format!(r#"{{"interface": "slcan", "channel": "{channel}", "bitrate": 250000, "sleep_after_open": 0}}"#)
}

#[test]
fn python_canopen_drives_the_valve_over_tcp() {
    let simulator = Simulator::start_wound(&OVER_TCP);
    simulator.serve_over(&over_tcp(&simulator), "boot.py", &["11149437"]);
    simulator.terminate();
}

#[test]
fn python_canopen_drives_the_valve_on_a_terminal_again_and_again() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("pve0");
    let url = format!("slcan+pty:{}", path.display());
    let simulator = Simulator::start_wound(&["--bus", &url]);
    for _ in 0..2 {
        simulator.serve_over(&bus(simulator.bus("slcan+pty:")), "boot.py", &["11149437"]);
    }
    simulator.terminate();
    assert!(fs::symlink_metadata(&path).is_err(), "the link is gone");
}

#[test]
fn can_j1939_is_the_tractor() {
    let simulator = Simulator::start_wound(&[OVER_TCP, ["--device", "pvea-isobus@0x83"]].concat());
    simulator.serve_over(&over_tcp(&simulator), "isobus_drive.py", &[]);
    simulator.terminate();
}

#[test]
fn python_can_asks_the_adapter() {
    let simulator = Simulator::start(&[OVER_TCP, ["--device", "pvea-canopen,blank"]].concat());
    simulator.serve_over(&over_tcp(&simulator), "slcan.py", &[]);
    let said = simulator.finish();
    let told = "a client set 500000 bit/s, but the bus runs at 250000 bit/s: the channel stays closed";
    assert!(said.contains(told), "{said}");
}

#[test]
fn slcand_makes_an_interface_of_it() {
    on_a_kernel("slcand.py", "interface");
}
