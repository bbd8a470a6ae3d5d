//! Frames and their explanations.

use protocol_core::device::{hat, pve};
use protocol_core::frame::standard;

use super::*;

const PVEA: Kind = Kind::Pve(pve::Kind::PveaCanopen);
const PVEO: Kind = Kind::Pve(pve::Kind::PveoCanopen);
const HAT: Kind = Kind::Hat(hat::Kind::Hat1000);
const ISOBUS: Kind = Kind::Pve(pve::Kind::PveaIsobus);

pub(super) fn explainer() -> Explainer {
    Explainer::new(vec![
        Node { name: "valve".to_owned(), kind: PVEA, node_id: Some(0x20) },
        Node { name: "rear".to_owned(), kind: PVEO, node_id: None },
        Node { name: "angle".to_owned(), kind: HAT, node_id: Some(1) },
        Node { name: "boom".to_owned(), kind: ISOBUS, node_id: Some(0x83) },
    ])
}

/// Parses a frame in the manual's notation.
pub(super) fn frame(text: &str) -> Frame {
    text.parse().unwrap_or_else(|error| panic!("{text}: {error}"))
}

pub(super) fn check(cases: &[(&str, &str)]) {
    for (text, meaning) in cases {
        assert_eq!(explainer().explain(&frame(text), None), *meaning, "{text}");
    }
}

#[test]
fn network_management() {
    check(&[
        ("000: 01 00", "master: NMT start, all nodes"),
        ("000: 02 20", "master: NMT stop, valve"),
        ("000: 80 21", "master: NMT enter pre-operational, node 0x21"),
        ("000: 81 00", "master: NMT reset application, all nodes"),
        ("000: 82 00", "master: NMT reset communication, all nodes"),
        ("000: 03 00", "unknown"),
        ("000: 01", "unknown"),
        ("720: 00", "valve: boot-up"),
        ("720: 7F", "valve: NMT state pre-operational"),
        ("720: 05", "valve: NMT state operational"),
        ("705: 04", "node 0x05: NMT state stopped"),
        ("720: 33", "unknown"),
        ("720:", "unknown"),
        ("080:", "SYNC"),
        ("080: 07", "SYNC, counter 7"),
        ("080: 07 00", "unknown"),
        // 12:34:56.789 on the first day of 2026; the upper four bits are reserved.
        ("100: 95 2C B3 F2 ED 3B", "TIME 12:34:56.789, day 15341 since 1984-01-01"),
    ]);
}

#[test]
fn process_data() {
    check(&[
        ("220: 0F 00 00 20", "master → valve: RPDO control word 0x000F (activate), set-point +50.0 %"),
        ("220: 0F 00 00 00", "master → valve: RPDO control word 0x000F (activate), set-point neutral"),
        ("220: 03 00 00 C0", "master → valve: RPDO control word 0x0003 (hold, fault reset 1 of 2), set-point -100.0 %"),
        ("220: 0B 00 FF 7F", "master → valve: RPDO control word 0x000B (hold, fault reset 2 of 2), set-point float"),
        ("220: 01 00 01 40", "master → valve: RPDO control word 0x0001 (disable), set-point 16385, out of range"),
        ("220: 00 00 00 00", "master → valve: RPDO control word 0x0000 (initialise), set-point neutral"),
        ("220: 0E 00 00 00", "master → valve: RPDO control word 0x000E (unusual), set-point neutral"),
        ("220: 0F", "master → valve: RPDO 0F"),
        ("1A0: 08 00 00 00", "valve: TPDO status word 0x0008 (INIT), position neutral"),
        ("1A0: 09 00 00 00", "valve: TPDO status word 0x0009 (DISABLED), position neutral"),
        ("1A0: 0B 00 00 00", "valve: TPDO status word 0x000B (HOLD), position neutral"),
        ("1A0: 0F 00 00 10", "valve: TPDO status word 0x000F (ACTIVE), position +25.0 %"),
        ("1A0: 03 00 FF 7F", "valve: TPDO status word 0x0003 (FAULT_HOLD), position float"),
        ("1A0: 55 00 00 00", "valve: TPDO status word 0x0055 (unknown state), position neutral"),
        ("1A0: 0F 00 01", "valve: TPDO 0F 00 01"),
        ("285: 01 02", "node 0x05: TPDO 2: 01 02"),
        ("505: 0F", "master → node 0x05: RPDO 4: 0F"),
        ("181: 00 10 00 00", "angle: TPDO position 4096 (90.00°)"),
        ("181: FF 3F 00 00", "angle: TPDO position 16383 (359.98°)"),
        ("181: 81 00 10", "angle: TPDO 81 00 10"),
    ]);
}

#[test]
fn emergencies() {
    check(&[
        ("081: 00 FF 81 01 00 00 00 00", "angle: EMCY: setup not loaded (0xFF00), register 0x81"),
        ("081: 00 FF 81 02 00 00 00 00", "angle: EMCY: controller error (0xFF00), register 0x81"),
        ("081: 20 81 11 03 00 00 00 00", "angle: EMCY: error-passive (0x8120), register 0x11"),
        ("081: 40 81 11 04 00 00 00 00", "angle: EMCY: recovered from bus-off (0x8140), register 0x11"),
        ("081: 00 00 81 00 00 00 00 00", "angle: EMCY: no error, register 0x81"),
        ("081: 12 34 05 01 00 00 00 00", "angle: EMCY: code 0x3412, field 0x0001, register 0x05"),
        ("0A0: 12 34 05 0F 00 00 00 00", "valve: EMCY: supply too low (0x3412), register 0x05, count 15"),
        ("0A0: 11 34 05 01 00 00 00 00", "valve: EMCY: supply too high (0x3411), register 0x05, count 1"),
        (
            "0A0: 05 83 21 02 00 00 00 00",
            "valve: EMCY: spool not at set-point or float not reached (0x8305), register 0x21, count 2",
        ),
        ("0A0: 00 10 01 01 00 00 00 00", "valve: EMCY: internal error (0x1000), register 0x01, count 1"),
        ("0A0: 40 81 11 01 00 00 00 00", "valve: EMCY: CAN bus error (0x8140), register 0x11, count 1"),
        ("0A0: 01 83 09 01 00 00 00 00", "valve: EMCY: temperature (0x8301), register 0x09, count 1"),
        ("0A0: 03 80 91 7F 00 00 00 00", "valve: EMCY: time guarding (0x8003), register 0x91, count 127"),
        ("0A0: 34 12 01 00 00 00 00 00", "valve: EMCY: code 0x1234, register 0x01, count 0"),
        ("0A0: 00 00 00 00 00 00 00 00", "valve: EMCY: no error"),
        ("0A0: 00 00 05 00 00 00 00 00", "valve: EMCY: no error, register 0x05"),
        ("0A0: 12 34 05", "unknown"),
    ]);
}

#[test]
fn service_data() {
    check(&[
        ("601: 40 09 65 00 00 00 00 00", "master → angle: SDO read 0x6509:0 (Offset value)"),
        ("581: 43 09 65 00 00 E0 FF FF", "angle: SDO read response 0x6509:0 (Offset value) = -8192"),
        ("581: 43 04 60 00 00 20 00 00", "angle: SDO read response 0x6004:0 (Position value) = 8192 (180.00°)"),
        (
            "601: 22 10 10 03 73 61 76 65",
            "master → angle: SDO write 0x1010:3 (Store application parameters) = \"save\"",
        ),
        ("620: 40 18 10 01 00 00 00 00", "master → valve: SDO read 0x1018:1 (Vendor ID)"),
        ("621: 40 18 10 01 00 00 00 00", "master → node 0x21: SDO read 0x1018:1"),
        ("620: 40 00 20 00 00 00 00 00", "master → valve: SDO read 0x2000:0"),
        ("5A0: 43 18 10 01 19 00 00 01", "valve: SDO read response 0x1018:1 (Vendor ID) = 0x01000019"),
        ("5A0: 4F 01 10 00 05 00 00 00", "valve: SDO read response 0x1001:0 (Error register) = 5"),
        ("5A1: 43 18 10 01 19 00 00 01", "node 0x21: SDO read response 0x1018:1 = 0x01000019"),
        ("5A0: 4F 00 33 00 81 00 00 00", "valve: SDO read response 0x3300:0 (Set-point, 8 bit) = -127"),
        ("5A0: 4B 01 63 01 00 E0 00 00", "valve: SDO read response 0x6301:1 (VPOC actual value) = -8192 (-50.0 %)"),
        ("5A0: 4B 41 60 00 0F 00 00 00", "valve: SDO read response 0x6041:0 (Device status word) = 0x000F (ACTIVE)"),
        (
            "620: 2B 40 60 00 0F 00 00 00",
            "master → valve: SDO write 0x6040:0 (Device control word) = 0x000F (activate)",
        ),
        ("620: 2F 42 60 00 02 00 00 00", "master → valve: SDO write 0x6042:0 (Device mode) = 2 (hand operation)"),
        ("620: 22 10 10 01 73 61 76 65", "master → valve: SDO write 0x1010:1 (Store all parameters) = \"save\""),
        ("620: 2B 17 10 00 E8 03 00 00", "master → valve: SDO write 0x1017:0 (Producer heartbeat time) = 1000"),
        ("5A0: 60 17 10 00 00 00 00 00", "valve: SDO write response 0x1017:0 (Producer heartbeat time)"),
        (
            "5A0: 41 0A 10 00 2F 00 00 00",
            "valve: SDO read response 0x100A:0 (Manufacturer software version), 47 bytes in segments",
        ),
        ("585: 40 08 10 00 00 00 00 00", "node 0x05: SDO read response 0x1008:0, in segments"),
        ("620: 60 00 00 00 00 00 00 00", "master → valve: SDO read, next segment, toggle 0"),
        ("5A0: 00 41 50 50 2D 5F 53 36", "valve: SDO read response, segment \"APP-_S6\", toggle 0"),
        ("5A0: 1B 30 31 00 00 00 00 00", "valve: SDO read response, last segment \"01\", toggle 1"),
        (
            "620: 21 53 60 00 0A 00 00 00",
            "master → valve: SDO write 0x6053:0 (Device description), 10 bytes in segments",
        ),
        ("620: 20 53 60 00 00 00 00 00", "master → valve: SDO write 0x6053:0 (Device description), in segments"),
        ("620: 00 00 01 02 03 04 05 06", "master → valve: SDO write, segment 00 01 02 03 04 05 06, toggle 0"),
        ("620: 0F 00 00 00 00 00 00 00", "master → valve: SDO write, last segment without data, toggle 0"),
        // A size that differs from the object's, and no size.
        ("620: 2F 40 60 00 0F 00 00 00", "master → valve: SDO write 0x6040:0 (Device control word) = 0x0F"),
        (
            "620: 22 40 60 00 0F 00 00 00",
            "master → valve: SDO write 0x6040:0 (Device control word) = 0x000F (activate)",
        ),
        ("5A0: 30 00 00 00 00 00 00 00", "valve: SDO write response, segment, toggle 1"),
        ("605: 80 08 10 00 00 00 00 08", "master → node 0x05: SDO abort 0x1008:0: general error (0x08000000)"),
        ("605: 80 08 10 00 FF FF 00 08", "master → node 0x05: SDO abort 0x1008:0: unknown abort code (0x0800FFFF)"),
        (
            "5A0: 80 17 10 00 12 00 07 06",
            "valve: SDO abort 0x1017:0 (Producer heartbeat time): length too high (0x06070012)",
        ),
        ("620: 80 00 20 00 00 00 02 06", "master → valve: SDO abort 0x2000:0: object does not exist (0x06020000)"),
        ("620: A0 18 10 01 00 00 00 00", "master → valve: SDO block read 0x1018:1 (Vendor ID), blocks of 0"),
        ("5A0: E0 18 10 01 00 00 00 00", "unknown"),
        ("620: 40 18 10 01", "unknown"),
    ]);
}

#[test]
fn layer_setting() {
    check(&[
        ("7E5: 04 01 00 00 00 00 00 00", "master: LSS switch all devices to configuration"),
        ("7E5: 04 00 00 00 00 00 00 00", "master: LSS switch all devices to waiting"),
        ("7E5: 04 07 00 00 00 00 00 00", "master: LSS switch all devices to reserved mode 7"),
        ("7E5: 40 19 00 00 01 00 00 00", "master: LSS select by vendor ID 0x01000019"),
        ("7E5: 43 00 01 2E 5B 00 00 00", "master: LSS select by serial number 0x5B2E0100"),
        ("7E4: 44 00 00 00 00 00 00 00", "LSS selected"),
        ("7E5: 11 17 00 00 00 00 00 00", "master: LSS configure node ID 0x17"),
        ("7E5: 11 FF 00 00 00 00 00 00", "master: LSS configure node ID 0xFF (unconfigured)"),
        ("7E4: 11 00 00 00 00 00 00 00", "LSS node ID: done"),
        ("7E4: 11 01 00 00 00 00 00 00", "LSS node ID: error 1 (out of range)"),
        ("7E5: 13 00 02 00 00 00 00 00", "master: LSS configure bit timing, table 0, index 2 (500 kbit/s)"),
        ("7E5: 13 00 05 00 00 00 00 00", "master: LSS configure bit timing, table 0, index 5"),
        ("7E4: 13 00 00 00 00 00 00 00", "LSS bit timing: done"),
        ("7E5: 15 E8 03 00 00 00 00 00", "master: LSS activate bit timing, switch delay 1000 ms"),
        ("7E5: 17 00 00 00 00 00 00 00", "master: LSS store"),
        ("7E4: 17 02 00 00 00 00 00 00", "LSS store: error 2 (memory access)"),
        ("7E5: 5C 00 00 00 00 00 00 00", "master: LSS inquire revision"),
        ("7E4: 5C 20 00 01 00 00 00 00", "LSS revision 0x00010020"),
        ("7E5: 5E 00 00 00 00 00 00 00", "master: LSS inquire node ID"),
        ("7E4: 5E 20 00 00 00 00 00 00", "LSS node ID 0x20"),
        ("7E4: 5E FF 00 00 00 00 00 00", "LSS node ID 0xFF (unconfigured)"),
        ("7E5: 4C 00 00 00 00 00 00 00", "master: LSS identify unconfigured devices"),
        ("7E4: 50 00 00 00 00 00 00 00", "LSS unconfigured device"),
        ("7E5: 51 00 00 00 00 80 00 00", "master: LSS fast scan, detect unconfigured devices"),
        ("7E5: 51 00 00 36 53 1F 01 02", "master: LSS fast scan, product code 0x53360000 from bit 31, then revision"),
        ("7E4: 4F 00 00 00 00 00 00 00", "LSS identified"),
        ("7E5: 99 00 00 00 00 00 00 00", "master: LSS unknown command 0x99"),
        ("7E4: 99 00 00 00 00 00 00 00", "unknown"),
        ("7E5: 04 01", "unknown"),
    ]);
}

#[test]
fn diagnostics() {
    check(&[
        ("1BC78820: 03 22 10 01", "tool 0xF1 → valve: UDS read 0x1001 (node ID)"),
        ("1BC100F1: 04 62 10 01 20", "valve → tool 0xF1: UDS read response 0x1001 (node ID) = 20"),
        (
            "1BC100F1: 07 62 F1 95 31 2E 33 32",
            "valve → tool 0xF1: UDS read response 0xF195 (software version) = \"1.32\"",
        ),
        ("1BC78805: 04 2E 10 01 06", "tool 0xF1 → node 0x05: UDS write 0x1001 (node ID) = 06"),
        ("1BC028F1: 03 6E 10 01", "node 0x05 → tool 0xF1: UDS write response 0x1001 (node ID)"),
        ("1BC100F1: 03 7F 22 31", "valve → tool 0xF1: UDS read refused, request out of range (0x31)"),
        ("1BC100F1: 03 7F 2E 33", "valve → tool 0xF1: UDS write refused, security access denied (0x33)"),
        ("1BC100F1: 03 7F 10 11", "valve → tool 0xF1: UDS service 0x10 refused, service not supported (0x11)"),
        ("1BC78820: 04 22 10 01", "tool 0xF1 → valve: UDS read 0x1001 (node ID), wrong length"),
        ("1BC78820: 02 10 03", "tool 0xF1 → valve: UDS service 0x10"),
        ("1BC78820: 00", "unknown"),
        ("1BC78820:", "unknown"),
        ("1BC78883: 04 2E 10 01 86", "tool 0xF1 → boom: UDS write 0x1001 (node ID) = 86"),
        ("1BC418F1: 04 62 10 01 83", "boom → tool 0xF1: UDS read response 0x1001 (node ID) = 83"),
        ("1BC408F1: 04 62 10 01 81", "node 0x81 → tool 0xF1: UDS read response 0x1001 (node ID) = 81"),
    ]);
}

/// The response has the same identifier for all node IDs, and other responses from node 0x81 have this identifier too.
#[test]
fn a_write_of_the_node_id_is_answered_by_the_one_that_was_asked() {
    let mut explainer = explainer();
    let written = frame("1BC408F1: 03 6E 10 01");
    let explain = |explainer: &mut Explainer, text: &str| {
        let meaning = explainer.explain(&frame(text), None);
        explainer.observe(&frame(text));
        meaning
    };
    for (asked, name) in [("83", "boom"), ("20", "valve"), ("05", "node 0x05")] {
        explain(&mut explainer, &format!("1BC788{asked}: 04 2E 10 01 86"));
        let answer = explain(&mut explainer, "1BC408F1: 03 6E 10 01");
        assert_eq!(answer, format!("{name} → tool 0xF1: UDS write response 0x1001 (node ID)"));
        explain(&mut explainer, &format!("1BC790{asked}: 04 2E 10 01 FF"));
        let refused = explain(&mut explainer, "1BC408F1: 03 7F 2E 31");
        assert_eq!(refused, format!("{name} → tool 0xF1: UDS write refused, request out of range (0x31)"));
    }
    let any = "one of the valves → tool 0xF1: UDS write response 0x1001 (node ID)";
    assert_eq!(explainer.explain(&written, None), any, "the request was before the recording");
    for asked in ["83", "20"] {
        explain(&mut explainer, &format!("1BC788{asked}: 04 2E 10 01 86"));
    }
    assert_eq!(explain(&mut explainer, "1BC408F1: 03 6E 10 01"), any);
    assert_eq!(explain(&mut explainer, "1BC408F1: 03 6E 10 01"), any);
    // On a simulated bus, the sender is known.
    let told = explainer.explain(&written, Some("rear"));
    assert_eq!(told, "rear → tool 0xF1: UDS write response 0x1001 (node ID)");
}

#[test]
fn addresses_and_requests() {
    check(&[
        (
            "18EEFF83: 01 00 20 07 08 FF 02 20",
            "boom: claims address 0x83, NAME 0x2002FF0807200001 (manufacturer 57, function 255, instance 1, identity 1)",
        ),
        (
            "18EEFF27: 02 00 00 00 00 00 00 A0",
            "0x27: claims address 0x27, NAME 0xA000000000000002 (manufacturer 0, function 0, instance 0, identity 2)",
        ),
        (
            "18EEFFFE: 01 00 20 07 08 FF 02 20",
            "no address: cannot claim an address, \
             NAME 0x2002FF0807200001 (manufacturer 57, function 255, instance 1, identity 1)",
        ),
        ("18EEFF83: 01 00", "unknown"),
        ("18EA8327: 00 EE 00", "0x27 → boom: request address claim"),
        ("18EAFF27: CA FE 00", "0x27 → all: request DM1"),
        ("18EA8427: CB FE 00 FF FF FF FF FF", "0x27 → 0x84: request DM2"),
        ("18EA8327: CC FE 00", "0x27 → boom: request DM3 (clear previously active faults)"),
        ("18EA8327: 13 FE 00", "0x27 → boom: request AVEF 3"),
        ("18EAFFFE: 00 EE 00", "no address → all: request address claim"),
        ("18EA8327: EB FE 00", "0x27 → boom: request PGN 0xFEEB"),
        ("18EA8327: CB FE", "unknown"),
        ("18E8FF83: 00 FF FF FF 27 CC FE 00", "boom → 0x27: done, DM3 (clear previously active faults)"),
        ("18E8FF83: 01 FF FF FF 27 EB FE 00", "boom → 0x27: not supported, PGN 0xFEEB"),
        ("18E8FF27: 02 FF FF FF 83 CA FE 00", "0x27 → boom: access denied, DM1"),
        ("18E8FF27: 03 FF FF FF 83 CA FE 00", "0x27 → boom: cannot respond now, DM1"),
        ("18E8FF27: 04 FF FF FF 83 CA FE 00", "unknown"),
    ]);
    let cannot = explainer().explain(&frame("18EEFFFE: 01 00 20 07 08 FF 02 20"), Some("boom"));
    assert!(cannot.starts_with("boom: cannot claim an address, NAME 0x2002FF0807200001"), "{cannot}");
}

#[test]
fn valve_commands_and_estimated_flow() {
    check(&[
        ("0CFE3327: 00 FF 30 FF FF FF FF FF", "0x27 → boom: AVC blocked"),
        ("0CFE3327: 7D FF 31 FF FF FF FF FF", "0x27 → boom: AVC extend 50.0 %"),
        ("0CFE3427: FA FF 32 FF FF FF FF FF", "0x27 → 0x84: AVC retract 100.0 %"),
        ("0CFE3327: 00 FF F3 FF FF FF FF FF", "0x27 → boom: AVC float"),
        ("0CFE3327: 00 FF 3A FF FF FF FF FF", "0x27 → boom: AVC hand operation"),
        ("0CFE3327: 00 FF 3E FF FF FF FF FF", "0x27 → boom: AVC emergency stop"),
        ("0CFE3327: FB FF 31 FF FF FF FF FF", "0x27 → boom: AVC ignored, port flow command 251 is above 250"),
        ("0CFE3327: 00 FF 34 FF FF FF FF FF", "0x27 → boom: AVC ignored, unknown state 4"),
        ("0CFE3327: 00 FF 70 FF FF FF FF FF", "0x27 → boom: AVC ignored, fail-safe mode 01"),
        ("0CFE3327: 00 FF 30", "0x27 → boom: AVC ignored, 3 bytes instead of 8"),
        ("0CFE1383: 7D 7D 30 FF FF FF FF FF", "boom: AVEF blocked, no flow"),
        ("0CFE1383: AF 7D 31 FF FF FF FF FF", "boom: AVEF extend, extend flow 50 %"),
        ("0CFE1383: 7D E1 32 FF FF FF FF FF", "boom: AVEF retract, retract flow 100 %"),
        ("0CFE1383: 7E 7F 33 FF FF FF FF FF", "boom: AVEF float, extend flow 1 %, retract flow 2 %"),
        ("0CFE1484: 00 7D 30 FF FF FF FF FF", "0x84: AVEF 00 7D 30 FF FF FF FF FF"),
    ]);
}

#[test]
fn diagnostic_messages() {
    check(&[
        ("18FECA83: 00 FF 00 00 00 00 FF FF", "boom: DM1 no active fault, lamp off"),
        ("18FECA83: 04 FF 73 02 04 01 FF FF", "boom: DM1 supply too low (SPN 627 FMI 4), count 1, amber lamp"),
        (
            "18FECA83: 10 FF EC 8F 87 7F FF FF",
            "boom: DM1 spool not at set-point (SPN 298988 FMI 7), count 127, red lamp",
        ),
        ("18FECA00: 40 FF 64 00 03 02 FF FF", "0x00: DM1 SPN 100 FMI 3, count 2, lamps 0x40"),
        ("18FECB83: 00 FF 00 00 00 00 FF FF", "boom: DM2 no previously active fault, lamp off"),
        ("18FECB83: 04 FF E9 8F 93 02 FF FF", "boom: DM2 time guarding (SPN 298985 FMI 19), count 2, amber lamp"),
        ("18FECB83: 04 FF", "unknown"),
    ]);
}

#[test]
fn messages_in_packets() {
    check(&[
        ("1CECFF83: 20 12 00 03 FF CB FE 00", "boom: BAM, DM2 follows, 18 bytes in 3 packets"),
        ("1CECFF27: 20 09 00 02 FF D8 FE 00", "0x27: BAM, commanded address follows, 9 bytes in 2 packets"),
        (
            "1CECFF27: 20 09 00 03 FF D8 FE 00",
            "0x27: BAM, commanded address follows, 9 bytes in 3 packets, inconsistent",
        ),
        ("1CEBFF83: 01 10 FF EC 8F 87 01 73", "boom → all: packet 1: 10 FF EC 8F 87 01 73"),
        (
            "1CEC8327: 10 09 00 02 FF D8 FE 00",
            "0x27 → boom: transport, request to send, commanded address, 9 bytes in 2 packets",
        ),
        (
            "1CEC2783: 11 02 01 FF FF D8 FE 00",
            "boom → 0x27: transport, clear to send, commanded address, 2 packets from 1",
        ),
        (
            "1CEC2783: 13 09 00 02 FF D8 FE 00",
            "boom → 0x27: transport, end of message, commanded address, 9 bytes in 2 packets",
        ),
        ("1CEC2783: FF 03 FF FF FF CB FE 00", "boom → 0x27: transport, abort, DM2, reason 3"),
        ("1CEC2783: 55 03 FF FF FF CB FE 00", "boom → 0x27: transport, unknown control byte 85"),
        ("1CECFF27: 20", "unknown"),
    ]);
}

#[test]
fn other_groups_by_their_number() {
    check(&[
        ("18FEF127: FF FF FF FF FF FF FF FF", "0x27 → all: PGN 0xFEF1"),
        ("18EF8327: 01", "0x27 → boom: PGN 0xEF00"),
        ("19FECA83: 00 FF 00 00 00 00 FF FF", "unknown"),
        ("1AFECA83: 00 FF 00 00 00 00 FF FF", "unknown"),
    ]);
}

#[test]
fn the_rest_is_unknown() {
    check(&[("123: FF", "unknown"), ("7FF:", "unknown"), ("580:", "unknown"), ("100:", "unknown")]);
    let remote = Frame::remote(standard(0x720).into(), 1);
    assert_eq!(explainer().explain(&remote, None), "remote frame, length 1");
}

#[test]
fn a_known_sender_is_called_by_its_name_whatever_it_sends_under() {
    let explainer = explainer();
    assert_eq!(explainer.explain(&frame("711: 00"), Some("valve")), "valve: boot-up");
    assert_eq!(explainer.explain(&frame("7E4: 44 00 00 00 00 00 00 00"), Some("rear")), "rear: LSS selected");
    assert_eq!(explainer.explain(&frame("711: 00"), Some("client 1")), "node 0x11: boot-up");
}

#[test]
fn node_ids_change() {
    let mut explainer = explainer();
    explainer.nodes[1].node_id = Some(0x11);
    assert_eq!(explainer.explain(&frame("000: 01 11"), None), "master: NMT start, rear");
}

#[test]
fn error_frames() {
    let error = |error| explain_error(error, &frame("720: 05"), "valve");
    assert_eq!(error(BusError::Acknowledgement), "error frame: no acknowledgement of 720: 05 from valve");
    assert_eq!(error(BusError::Bit), "error frame: bit error in 720: 05 from valve");
    assert_eq!(error(BusError::Stuff), "error frame: stuff error in 720: 05 from valve");
}

/// The bytes after the register are manufacturer-specific, and devices of other manufacturers use further error codes.
#[test]
fn emergencies_of_foreign_nodes() {
    check(&[
        ("085: 30 81 11 01 02 03 04 05", "node 0x05: EMCY: communication (0x8130), register 0x11, 01 02 03 04 05"),
        ("085: 20 31 04 00 00 00 00 00", "node 0x05: EMCY: voltage (0x3120), register 0x04, 00 00 00 00 00"),
        ("085: 03 80 91 01 00 00 00 00", "node 0x05: EMCY: monitoring (0x8003), register 0x91, 01 00 00 00 00"),
        ("085: 00 00 00 00 00 00 00 00", "node 0x05: EMCY: no error"),
    ]);
}

#[test]
fn who_sent_it_decides_whose_it_is() {
    for (text, from, meaning, mark) in [
        ("720: 05", "valve", "valve: NMT state operational", Mark::Plain),
        ("720: 05", "the gateway", "client, posing as valve: NMT state operational", Mark::Impersonation),
        ("705: 05", "the gateway", "node 0x05: NMT state operational", Mark::Plain),
        ("2A0: 01", "the gateway", "client, posing as valve: TPDO 2: 01", Mark::Impersonation),
        (
            "1A0: 0F 00 00 00",
            "the gateway",
            "client, posing as valve: TPDO status word 0x000F (ACTIVE), position neutral",
            Mark::Impersonation,
        ),
        (
            "0A0: 03 80 91 01 00 00 00 00",
            "valve",
            "valve: EMCY: time guarding (0x8003), register 0x91, count 1",
            Mark::Fault,
        ),
        ("0A0: 00 00 00 00 00 00 00 00", "valve", "valve: EMCY: no error", Mark::Plain),
        (
            "18FECA83: 04 FF 73 02 04 01 FF FF",
            "boom",
            "boom: DM1 supply too low (SPN 627 FMI 4), count 1, amber lamp",
            Mark::Fault,
        ),
        ("18FECA83: 00 FF 00 00 00 00 FF FF", "boom", "boom: DM1 no active fault, lamp off", Mark::Plain),
        (
            "18EA8383: 00 EE 00",
            "the gateway",
            "client, posing as boom → boom: request address claim",
            Mark::Impersonation,
        ),
        ("18EA8327: 00 EE 00", "the gateway", "0x27 → boom: request address claim", Mark::Plain),
        (
            "220: 0F 00 00 00",
            "valve",
            "valve → valve: RPDO control word 0x000F (activate), set-point neutral",
            Mark::Plain,
        ),
        ("123: FF", "the gateway", "unknown", Mark::Unknown),
    ] {
        assert_eq!(explainer().explain_and_mark(&frame(text), Some(from)), (meaning.to_owned(), mark), "{text}");
    }
    let asked = Frame::remote(standard(0x720).into(), 1);
    assert_eq!(explainer().explain_and_mark(&asked, Some("the gateway")).1, Mark::Plain);
}

/// Explains a frame after other frames.
fn after(before: &[&str], text: &str) -> String {
    let mut explainer = explainer();
    before.iter().for_each(|text| explainer.observe(&frame(text)));
    explainer.explain(&frame(text), None)
}

/// The text of PDOs by the default mapping would be wrong.
#[test]
fn a_pdo_with_another_mapping_is_bytes() {
    const TPDO: &str = "1A0: 00 40 0F 00";
    const RPDO: &str = "220: 00 40 0F 00";
    const BYTES: &str = "valve: TPDO 00 40 0F 00";
    let (default, rpdo) = (after(&[], TPDO), after(&[], RPDO));
    assert!(default.contains("status word") && rpdo.contains("control word"));
    // 0x6301, then 0x6041.
    let swapped = ["620: 23 00 1A 01 10 01 01 63", "5A0: 60 00 1A 01 00 00 00 00"];
    assert_eq!(after(&swapped, TPDO), BYTES);
    assert_eq!(after(&swapped, RPDO), rpdo, "another mapping");
    assert_eq!(after(&swapped, "1A1: 09 00 00 00"), after(&[], "1A1: 09 00 00 00"), "another node");
    assert_eq!(
        after(&["620: 23 00 16 01 10 01 00 63", "5A0: 60 00 16 01 00 00 00 00"], RPDO),
        "master → valve: RPDO 00 40 0F 00"
    );
    assert_eq!(after(&["5A0: 43 00 1A 01 10 01 01 63"], TPDO), BYTES, "a read shows it, too");
    assert_eq!(after(&["5A0: 4F 00 1A 00 03 00 00 00"], TPDO), BYTES, "the number of entries");
    let sensor = ["601: 23 00 1A 01 20 00 02 10", "581: 60 00 1A 01 00 00 00 00"];
    assert_eq!(after(&sensor, "181: 00 10 00 00"), "angle: TPDO 00 10 00 00");

    // The default, as tools write it, and a request that is refused or has no answer.
    let written = [
        "620: 2F 00 1A 00 00 00 00 00",
        "5A0: 60 00 1A 00 00 00 00 00",
        "620: 23 00 1A 01 10 00 41 60",
        "5A0: 60 00 1A 01 00 00 00 00",
        "620: 2F 00 1A 00 02 AA AA AA",
        "5A0: 60 00 1A 00 00 00 00 00",
    ];
    assert_eq!(after(&written, TPDO), default);
    assert_eq!(after(&[swapped[0], "5A0: 80 00 1A 01 41 00 04 06"], TPDO), default);
    assert_eq!(after(&swapped[..1], TPDO), default);
    let read = ["581: 4F 00 1A 00 01 00 00 00", "581: 43 00 1A 01 20 00 04 60"];
    assert_eq!(after(&read, "181: 00 10 00 00"), "angle: TPDO position 4096 (90.00°)");

    // A boot-up restores what was stored.
    let (save, load, boot) = ("5A0: 60 10 10 01 00 00 00 00", "5A0: 60 11 10 01 00 00 00 00", "720: 00");
    assert_eq!(after(&[&swapped[..], &[boot]].concat(), TPDO), default);
    assert_eq!(after(&[&swapped[..], &[save, boot]].concat(), TPDO), BYTES);
    assert_eq!(after(&[&swapped[..], &[save, boot, load]].concat(), TPDO), BYTES, "until the next start");
    assert_eq!(after(&[&swapped[..], &[save, load, save, boot]].concat(), TPDO), default, "the load outlives the save");
}

#[test]
fn requests_and_answers_count_each_time_and_cyclic_frames_do_not() {
    for cyclic in
        ["080:", "100: 00", "1A0: 00", "220: 00", "720: 05", "123: 01", "0CFE3327: 00", "0CFE1383: 00", "18FECA83: 00"]
    {
        assert!(is_cyclic(&frame(cyclic)), "{cyclic}");
    }
    for once in [
        "000: 01 00",
        "0A0: 00",
        "620: 40",
        "5A0: 43",
        "7E4: 44",
        "7E5: 04",
        "18EEFF83: 00",
        "18EA8327: 00",
        "1BC78820: 00",
    ] {
        assert!(!is_cyclic(&frame(once)), "{once}");
    }
}
