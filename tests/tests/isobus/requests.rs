//! Requests for parameter groups: who is answered with what, who is refused, who hears nothing (SPEC 5).

use protocol_core::controller::BusErrorMode;
use tests::Rig;
use tests::isobus::{AVEF_BLOCKED, CLAIM, DM1_CLEAR, DM2_NONE};

/// The groups that it sends, and what comes of a request.
const SUPPORTED: [(&str, &str); 4] =
    [("00 EE 00", CLAIM), ("CA FE 00", DM1_CLEAR), ("CB FE 00", DM2_NONE), ("13 FE 00", AVEF_BLOCKED)];

/// Addressed to the valve and to all, of any source and priority; answers go to all.
#[test]
fn what_is_supported() {
    let mut valve = Rig::claimed();
    for (group, answer) in SUPPORTED {
        for source in ["00", "27", "F9", "FD", "FE", "FF"] {
            valve.exchange(&format!("18EA83{source}: {group}"), &[answer]);
            valve.exchange(&format!("18EAFF{source}: {group}"), &[answer]);
        }
        for priority in ["00", "04", "0C", "1C"] {
            valve.exchange(&format!("{priority}EA8327: {group}"), &[answer]);
        }
        // padded to eight bytes, as some tools do
        valve.exchange(&format!("18EA8327: {group} FF FF FF FF FF"), &[answer]);
    }
}

/// A negative acknowledgement repeats the group and names the requester; a request to all is met by silence.
#[test]
fn what_is_not_supported() {
    let mut valve = Rig::claimed();
    for group in [
        // another valve's flow, commands, what the valve only receives
        "10 FE 00", "12 FE 00", "14 FE 00", "33 FE 00", "D8 FE 00", "00 EA 00", "00 E8 00", "00 EB 00", "00 EC 00",
        // others of the standards
        "CD FE 00", "DA FE 00", "EB FE 00", "00 FF 00", "FF FF 00", "00 00 00",
        // the same in other pages, and what is no group at all
        "00 EE 01", "CA FE 01", "CB FE 02", "13 FE 03", "01 EE 00", "FF EE 00", "CA FE FF", "FF FF FF",
    ] {
        for source in ["00", "27", "F9", "FD"] {
            let refusal = format!("18E8FF83: 01 FF FF FF {source} {group}");
            valve.exchange(&format!("18EA83{source}: {group}"), &[&refusal]);
            valve.exchange(&format!("18EAFF{source}: {group}"), &[]);
        }
    }
}

#[test]
fn what_is_no_request_to_it() {
    let mut valve = Rig::claimed();
    for frame in [
        // another's
        "18EA8227: CA FE 00",
        "18EA0027: CA FE 00",
        "18EA9327: 00 EE 00",
        "18EAFE27: 00 EE 00",
        // too short
        "18EA8327: CA FE",
        "18EA8327: CA",
        "18EA8327:",
        "18EAFF27: 00 EE",
        "18EA8327: R3",
        "18EA8327: R8",
        "18EAFF27: R3",
        // another group
        "19EA8327: CA FE 00",
        "1AEA8327: CA FE 00",
        "18E98327: CA FE 00",
        // an acknowledgement, of whomever
        "18E8FF27: 00 FF FF FF 83 CC FE 00",
        "18E8FF27: 01 FF FF FF 83 CC FE 00",
        // 11 bits are another protocol
        "000: 81 83",
        "603: 40 00 10 00 00 00 00 00",
        "7E5: 04 01 00 00 00 00 00 00",
        "080:",
    ] {
        valve.exchange(frame, &[]);
    }
    assert_eq!(valve.node_id(), Some(0x83));
}

/// All at once: every one is answered, the most urgent first.
#[test]
fn many_requests_on_a_busy_bus() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    for (group, _) in SUPPORTED {
        valve.send(&format!("18EA8327: {group}"));
    }
    valve.send("18EA8327: 00 FF 00");
    valve.hold_bus(false);
    valve.expect_all(&[AVEF_BLOCKED, "18E8FF83: 01 FF FF FF 27 00 FF 00", CLAIM, DM1_CLEAR, DM2_NONE]);
}

/// Nothing is answered while the bus cannot be used, nor afterwards.
#[test]
fn requests_in_bus_off() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    for (group, _) in SUPPORTED {
        valve.exchange(&format!("18EA8327: {group}"), &[]);
    }
    valve.exchange("18EA8327: 00 FF 00", &[]);
    valve.sense_sends(|inputs| inputs.bus = BusErrorMode::ErrorActive, &[DM1_CLEAR]);
}
