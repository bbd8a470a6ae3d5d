//! Unmodified can-j1939 as a tractor's controller with an address of its own, and cantools, beside a valve on ISOBUS.

use super::simulator::Simulator;
use super::{serve, serve_wound};

/// The valve of the manual's examples.
const VALVE: [&str; 2] = ["--device", "pvea-isobus@0x83"];

#[test]
fn a_tractor_claims_an_address_beside_the_valve() {
    serve("isobus_join.py", &VALVE);
}

#[test]
fn the_valve_is_driven_by_a_dbc() {
    serve_wound("isobus_drive.py", &VALVE);
}

#[test]
fn every_message_is_decoded_by_a_dbc() {
    serve("dbc.py", &VALVE);
}

#[test]
fn faults_are_told_and_cleared() {
    serve_wound("isobus_diagnostics.py", &VALVE);
}

#[test]
fn the_lower_name_has_the_address() {
    for phase in ["higher", "arbitrary", "lower"] {
        let simulator = Simulator::start_wound(&VALVE);
        simulator.serve("isobus_contend.py", &[phase]);
        simulator.terminate();
    }
}
