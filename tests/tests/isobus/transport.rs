//! Destination-specific transport: the valve receives broadcasts only, and says so (J1939-21; SPEC 5).

use tests::Rig;
use tests::isobus::{CLAIM, LOWER_NAME};

const RTS: &str = "1CEC8327: 10 09 00 02 FF D8 FE 00";
const ABORT: &str = "1CEC2783: FF 02 FF FF FF D8 FE 00";

#[test]
fn a_request_to_send_is_aborted() {
    for source in ["00", "27", "80", "F9", "FD"] {
        for (group, size) in [("D8 FE 00", "09 00 02 FF"), ("CA FE 00", "12 00 03 01"), ("00 EF 00", "FF 06 FF FF")] {
            let mut valve = Rig::claimed();
            let rts = format!("1CEC83{source}: 10 {size} {group}");
            valve.exchange(&rts, &[&format!("1CEC{source}83: FF 02 FF FF FF {group}")]);
            valve.advance(10);
            valve.exchange(&rts, &[&format!("1CEC{source}83: FF 02 FF FF FF {group}")]);
        }
    }
}

/// Of any priority; the answer has that of the group.
#[test]
fn of_any_priority() {
    for priority in ["00", "0C", "18"] {
        Rig::claimed().exchange(&RTS.replacen("1C", priority, 1), &[ABORT]);
    }
}

#[test]
fn what_is_no_request_to_send() {
    for frame in [
        // to another, to all
        "1CEC8427: 10 09 00 02 FF D8 FE 00",
        "1CECFF27: 10 09 00 02 FF D8 FE 00",
        // clear to send, end of message, abort, BAM, reserved
        "1CEC8327: 11 02 01 FF FF D8 FE 00",
        "1CEC8327: 13 09 00 02 FF D8 FE 00",
        "1CEC8327: FF 01 FF FF FF D8 FE 00",
        "1CEC8327: 20 09 00 02 FF D8 FE 00",
        "1CEC8327: 00 09 00 02 FF D8 FE 00",
        // another length, other pages
        "1CEC8327: 10 09 00 02 FF D8 FE",
        "1CEC8327: 10",
        "1CEC8327:",
        "1CEC8327: R8",
        "1DEC8327: 10 09 00 02 FF D8 FE 00",
        "1EEC8327: 10 09 00 02 FF D8 FE 00",
        // packets
        "1CEB8327: 01 01 00 20 07 08 FF 02",
        // nobody can be told
        "1CEC83FE: 10 09 00 02 FF D8 FE 00",
        "1CEC83FF: 10 09 00 02 FF D8 FE 00",
    ] {
        Rig::claimed().exchange(frame, &[]);
    }
}

/// Neither in the claim wait nor without an address.
#[test]
fn not_while_it_may_not_send() {
    let mut valve = Rig::claimed();
    valve.power_cycle();
    valve.expect(CLAIM);
    valve.advance(249);
    valve.exchange(RTS, &[]);
    valve.advance(1);
    valve.send(LOWER_NAME);
    valve.advance(200);
    valve.take();
    valve.exchange(RTS, &[]);
}

/// A broadcast of the same sender goes on beside it.
#[test]
fn a_broadcast_goes_on() {
    let mut valve = Rig::claimed();
    valve.silent_to(&["1CECFF27: 20 09 00 02 FF D8 FE 00", "1CEBFF27: 01 01 00 20 07 08 FF 02"]);
    valve.exchange(RTS, &[ABORT]);
    valve.exchange("1CEBFF27: 02 20 81 FF FF FF FF FF", &["18EEFF81: 01 00 20 07 08 FF 02 20"]);
}
