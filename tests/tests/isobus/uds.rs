//! UDS at the addresses of the ISOBUS kinds (SPEC 1, 7).

use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::BLOCK;

fn at(kind: Kind, address: u8) -> Rig {
    Rig::claimed_as(Setup { node_id: Some(address), ..Setup::new(kind) })
}

#[test]
fn the_manuals_example() {
    let mut valve = Rig::claimed();
    valve.exchange("1BC78883: 04 2E 10 01 86", &["1BC408F1: 03 6E 10 01"]);
    // stored, not in force
    assert_eq!(valve.node_id(), Some(0x83));
    valve.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 86"]);
    valve.exchange("18EA8327: 00 EE 00", &["18EEFF83: 01 00 20 07 08 FF 02 20"]);
    valve.restart();
    assert_eq!(valve.node_id(), Some(0x86));
    valve.exchange("1BC78883: 03 22 10 01", &[]);
    valve.exchange("1BC78886: 03 22 10 01", &["1BC430F1: 04 62 10 01 86"]);
}

#[test]
fn every_address() {
    for address in 0x80..=0x8F_u8 {
        let mut valve = at(Kind::PveoIsobus, address);
        let answer = format!("{:08X}", 0x1BC0_0000 | u32::from(address) << 11 | 0xF1);
        for other in 0..=255_u8 {
            let answers = [format!("{answer}: 04 62 F0 10 A5")];
            let answers: Vec<&str> = answers.iter().map(String::as_str).collect();
            let request = format!("{:08X}: 03 22 F0 10", 0x1BC7_8800 | u32::from(other));
            valve.exchange(&request, if other == address { &answers } else { &[] });
        }
    }
}

/// Wherever the requester is, its answer goes there; identifiers that look like other services of ISOBUS are none.
#[test]
fn every_source() {
    let mut valve = Rig::claimed();
    for source in 0..=0x7FF_u32 {
        let request = format!("{:08X}: 03 22 F0 10", 0x1BC0_0083 | source << 11);
        let answer = format!("{:08X}: 04 62 F0 10 A5", 0x1BC0_0000 | 0x83 << 11 | source);
        valve.exchange(&request, &[&answer]);
    }
    // another net of the destination
    valve.silent_to(&["1BC78983: 03 22 F0 10", "1BC78F83: 03 22 F0 10"]);
}

#[test]
fn the_range_of_the_address() {
    for address in 0..=255_u8 {
        let mut valve = Rig::claimed();
        let valid = (0x80..=0x8F).contains(&address);
        let answer = if valid { "1BC408F1: 03 6E 10 01" } else { "1BC408F1: 03 7F 2E 31" };
        valve.exchange(&format!("1BC78883: 04 2E 10 01 {address:02X}"), &[answer]);
        valve.power_cycle();
        assert_eq!(valve.node_id(), Some(if valid { address } else { 0x83 }));
    }
}

#[test]
fn what_each_kind_is() {
    for (kind, part, serial) in
        [(Kind::PveaIsobus, "00 A9 B5 19", "00 00 00 01"), (Kind::PveoIsobus, "00 A9 BD 22", "00 00 00 01")]
    {
        let mut valve = at(kind, 0x83);
        for identifier in ["F1 FA", "F1 FB", "F1 FC", "F1 FD"] {
            valve
                .exchange(&format!("1BC78883: 03 22 {identifier}"), &[&format!("1BC418F1: 07 62 {identifier} {part}")]);
        }
        valve.exchange("1BC78883: 03 22 F1 8C", &[&format!("1BC418F1: 07 62 F1 8C {serial}")]);
        valve.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 83"]);
    }
}

/// In the order of the checks; a write of the node ID is answered under the identifier that is the same for all.
#[test]
fn refusals() {
    for (request, answer) in [
        ("", None),
        ("00", None),
        ("08 22 F0 10", None),
        ("01", Some("1BC418F1: 03 7F 00 13")),
        ("03 22 F0 10 00", Some("1BC418F1: 03 7F 22 13")),
        ("02 10 03", Some("1BC418F1: 03 7F 10 11")),
        ("02 22 F0", Some("1BC418F1: 03 7F 22 13")),
        ("03 22 12 34", Some("1BC418F1: 03 7F 22 31")),
        ("04 2E F0 10 A5", Some("1BC418F1: 03 7F 2E 33")),
        ("03 2E 10 01", Some("1BC408F1: 03 7F 2E 13")),
        ("05 2E 10 01 86 00", Some("1BC408F1: 03 7F 2E 13")),
        ("04 2E 10 01 7F", Some("1BC408F1: 03 7F 2E 31")),
    ] {
        Rig::claimed().exchange(&format!("1BC78883: {request}"), answer.as_slice());
    }
    Rig::claimed().exchange("1BC78883: R4", &[]);
}

/// In shutdown, hand operation and emergency stop as well.
#[test]
fn in_every_state() {
    for state in [0x30, 0x31, 0x32, 0x33, 0x3A, 0x3E] {
        for shut_down in [false, true] {
            let mut valve = Rig::claimed();
            valve.send(&format!("0CFE3327: 7D FF {state:02X} FF FF FF FF FF"));
            valve.sense(|inputs| inputs.internal_fault = shut_down);
            valve.take();
            valve.exchange("1BC78883: 03 22 F0 10", &["1BC418F1: 04 62 F0 10 A5"]);
            valve.exchange("1BC78883: 04 2E 10 01 86", &["1BC408F1: 03 6E 10 01"]);
        }
    }
}

#[test]
fn while_the_memory_is_written_and_when_it_fails() {
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(50);
    valve.exchange("1BC78883: 04 2E 10 01 86", &[]);
    valve.exchange("1BC78883: 04 2E 10 01 87", &["1BC408F1: 03 7F 2E 22"]);
    valve.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 83"]);
    valve.advance_news(50, &["1BC408F1: 03 6E 10 01"]);
    valve.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 86"]);

    valve.writes_fail = true;
    valve.send("1BC78883: 04 2E 10 01 87");
    valve.advance(50);
    let mut sent = valve.take_news();
    sent.sort();
    assert_eq!(sent, ["18FECA83: 10 FF FA 8F 8B 01 FF FF", "1BC408F1: 03 7F 2E 72"]);
    valve.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 86"]);
    // the next write that succeeds ends the fault
    valve.writes_fail = false;
    valve.send("1BC78883: 04 2E 10 01 88");
    valve.advance_cyclic(50, BLOCK);
    let mut sent = valve.take_news();
    sent.sort();
    assert_eq!(sent, ["18FECA83: 00 FF 00 00 00 00 FF FF", "1BC408F1: 03 6E 10 01"]);
}
