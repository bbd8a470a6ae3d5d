//! Unmodified can-j1939 as a tractor's controller with an address of its own, and cantools, beside a valve on ISOBUS.

use super::simulator::Simulator;
use super::{UNHURRIED, serve};

/// The valve of the manual's examples.
const VALVE: [&str; 2] = ["--device", "pvea-isobus@0x83"];

#[test]
fn a_tractor_claims_an_address_beside_the_valve() {
    serve("isobus_join.py", &VALVE);
}

#[test]
fn the_valve_is_driven_by_a_dbc() {
    serve("isobus_drive.py", &[VALVE, UNHURRIED].concat());
}

#[test]
fn every_message_is_decoded_by_a_dbc() {
    serve("dbc.py", &VALVE);
}

#[test]
fn faults_are_told_and_cleared() {
    serve("isobus_diagnostics.py", &[VALVE, UNHURRIED].concat());
}

#[test]
fn the_lower_name_has_the_address() {
    // Only one of them keeps the valve moving.
    let unhurried = [VALVE, UNHURRIED].concat();
    for (phase, options) in [("higher", &VALVE[..]), ("arbitrary", &unhurried), ("lower", &VALVE)] {
        let simulator = Simulator::start(options);
        simulator.serve("isobus_contend.py", &[phase]);
        simulator.terminate();
    }
}
