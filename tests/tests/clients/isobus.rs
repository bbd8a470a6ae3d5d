//! Unmodified can-j1939 as a tractor's controller with an address of its own, and cantools, beside a valve on ISOBUS.

use super::recordings::serve_and_replay;
use super::serve;
use super::simulator::{FREE, WOUND};

/// The valve of the manual's examples.
const VALVE: [&str; 2] = ["--device", "pvea-isobus@0x83"];

calls! {
    a_tractor_claims_an_address_beside_the_valve: serve(FREE, "isobus_join.py", &VALVE);
    the_valve_is_driven_by_a_dbc: serve_and_replay(WOUND, "drive.log", "isobus_drive.py", &[], &VALVE);
    every_message_is_decoded_by_a_dbc: serve(FREE, "dbc.py", &VALVE);
    faults_are_told_and_cleared: serve(WOUND, "isobus_diagnostics.py", &VALVE);
}

#[test]
fn the_lower_name_has_the_address() {
    for phase in ["higher", "arbitrary", "lower"] {
        serve_and_replay(WOUND, "contend.log", "isobus_contend.py", &[phase], &VALVE);
    }
}
