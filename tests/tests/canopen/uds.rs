//! UDS lite: every identifier, every refusal in its order, and who is answered under what (SPEC 7).

use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;

use super::{SAVE, SAVED};

/// From tool 0xF1 to node 0x20, and back.
const REQUEST: &str = "1BC78820";
const ANSWER: &str = "1BC100F1";
/// Under which every write of the node ID is answered.
const NODE_ID_ANSWER: &str = "1BC408F1";

#[track_caller]
fn ask(valve: &mut Rig, request: &str, id: &str, answer: &str) {
    let answer = format!("{id}: {answer}");
    let answers = if answer.ends_with(": ") { vec![] } else { vec![answer.as_str()] };
    valve.exchange(&format!("{REQUEST}: {request}"), &answers);
}

/// Identifier, what it reads on a PVEA, on a PVEO: part numbers 11149437 and 11149443.
const IDENTIFIERS: [(&str, &str, &str); 7] = [
    ("10 01", "20", "20"),
    ("F0 10", "A5", "A5"),
    ("F1 FA", "00 AA 20 7D", "00 AA 20 83"),
    ("F1 FB", "00 AA 20 7D", "00 AA 20 83"),
    ("F1 FC", "00 AA 20 7D", "00 AA 20 83"),
    ("F1 FD", "00 AA 20 7D", "00 AA 20 83"),
    ("F1 8C", "5B 2E 01 00", "5B 2E 01 00"),
];

/// Those whose contents the text leaves open: how many bytes they have.
const LENGTHS: [(&str, usize); 5] = [("F1 92", 4), ("F1 93", 4), ("F1 94", 4), ("F1 95", 4), ("F1 8B", 3)];

#[test]
fn every_identifier_in_every_nmt_state() {
    for (kind, column) in [(Kind::PveaCanopen, 0), (Kind::PveoCanopen, 1)] {
        let mut valve = Rig::booted_as(Setup::new(kind));
        for order in ["000: 80 00", "000: 01 00", "000: 02 00"] {
            valve.exchange(order, &[]);
            for (identifier, pvea, pveo) in IDENTIFIERS {
                let expected = [pvea, pveo][column];
                let len = 3 + expected.split(' ').count();
                let answer = format!("{len:02X} 62 {identifier} {expected}");
                ask(&mut valve, &format!("03 22 {identifier}"), ANSWER, &answer);
            }
        }
    }
}

#[test]
fn lengths_and_forms() {
    let mut valve = Rig::booted();
    for (identifier, len) in LENGTHS {
        valve.send(&format!("{REQUEST}: 03 22 {identifier}"));
        let answer = valve.take_next().unwrap();
        let data = answer.data();
        assert_eq!((data.len(), usize::from(data[0])), (len + 4, len + 3), "{answer}");
        assert!(answer.to_string().starts_with(&format!("{ANSWER}: {:02X} 62 {identifier} ", len + 3)), "{answer}");
        let data = &data[4..];
        match identifier {
            "F1 92" => assert_eq!(data, 11_149_437_u32.to_be_bytes(), "the part number"),
            "F1 93" | "F1 95" => {
                assert!(data.is_ascii() && data[0] != b' ', "four characters, left adjusted: {answer}");
            }
            "F1 8B" => assert!(data.iter().all(|byte| byte >> 4 < 10 && byte & 0xF < 10), "BCD: {answer}"),
            _ => {}
        }
    }
}

/// Requests and the code they are refused with, in the order of the checks; empty: no answer at all.
const REFUSALS: [(&str, &str); 43] = [
    // no answer
    ("", ""),
    ("00", ""),
    ("00 22 F0 10", ""),
    ("08 22 F0 10", ""),
    ("10 22 F0 10", ""),
    ("FF", ""),
    // byte 0 against the DLC, before the service
    ("01", "00 13"),
    ("02 22", "22 13"),
    ("03 22 F0", "22 13"),
    ("03 22 F0 10 00", "22 13"),
    ("02 22 F0 10", "22 13"),
    ("07 22 F0 10", "22 13"),
    ("04 3E 00", "3E 13"),
    ("05 2E F0 10 00", "2E 13"),
    // the service, before the length
    ("01 3E", "3E 11"),
    ("02 10 03", "10 11"),
    ("03 27 F0 10", "27 11"),
    ("03 62 F0 10", "62 11"),
    ("07 19 00 00 00 00 00 00", "19 11"),
    // the length, before the identifier
    ("01 22", "22 13"),
    ("02 22 F0", "22 13"),
    ("04 22 F0 10 00", "22 13"),
    ("05 22 F0 10 F1 92", "22 13"),
    ("04 22 12 34 00", "22 13"),
    ("01 2E", "2E 13"),
    ("02 2E F0", "2E 13"),
    ("02 2E 10", "2E 13"),
    // the identifier
    ("03 22 12 34", "22 31"),
    ("03 22 01 10", "22 31"),
    ("03 22 00 00", "22 31"),
    ("03 22 F1 90", "22 31"),
    ("03 22 F1 FE", "22 31"),
    ("03 2E 12 34", "2E 31"),
    ("04 2E 01 10 21", "2E 31"),
    ("07 2E 12 34 00 00 00 00", "2E 31"),
    // factory data, any number of bytes
    ("03 2E F0 10", "2E 33"),
    ("04 2E F0 10 A5", "2E 33"),
    ("07 2E F1 8C 00 00 00 01", "2E 33"),
    ("07 2E F1 92 00 00 00 01", "2E 33"),
    ("06 2E F1 8B 18 07 01", "2E 33"),
    ("05 2E F1 FA 00 00", "2E 33"),
    ("07 2E F1 95 31 32 33 34", "2E 33"),
    ("05 2E F1 FD 00 00", "2E 33"),
];

#[test]
fn every_refusal() {
    for (request, code) in REFUSALS {
        for order in ["000: 80 00", "000: 01 00", "000: 02 00"] {
            let mut valve = Rig::booted();
            valve.send(order);
            let answer = if code.is_empty() { String::new() } else { format!("03 7F {code}") };
            ask(&mut valve, request, ANSWER, &answer);
        }
    }
}

/// Writes of 0x1001 and their answers, all under the identifier that is the same for all nodes.
const NODE_ID_WRITES: [(&str, &str); 12] = [
    ("04 2E 10 01 21", "03 6E 10 01"),
    ("04 2E 10 01 01", "03 6E 10 01"),
    ("04 2E 10 01 7F", "03 6E 10 01"),
    ("04 2E 10 01 20", "03 6E 10 01"),
    ("04 2E 10 01 00", "03 7F 2E 31"),
    ("04 2E 10 01 80", "03 7F 2E 31"),
    ("04 2E 10 01 FF", "03 7F 2E 31"),
    ("03 2E 10 01", "03 7F 2E 13"),
    ("05 2E 10 01 21 00", "03 7F 2E 13"),
    ("05 2E 10 01 21", "03 7F 2E 13"),
    ("03 2E 10 01 21", "03 7F 2E 13"),
    ("04 2E 10 01 21 00", "03 7F 2E 13"),
];

#[test]
fn every_write_of_the_node_id() {
    for (request, answer) in NODE_ID_WRITES {
        for order in ["000: 80 00", "000: 01 00", "000: 02 00"] {
            let mut valve = Rig::booted();
            valve.send(order);
            ask(&mut valve, request, NODE_ID_ANSWER, answer);
            // what is stored reads back; in force it is after a restart
            let stored = if answer.starts_with("03 6E") { &request[12..] } else { "20" };
            ask(&mut valve, "03 22 10 01", ANSWER, &format!("04 62 10 01 {stored}"));
            assert_eq!(valve.node_id(), Some(0x20));
            valve.power_cycle();
            assert_eq!(valve.node_id().map(|id| format!("{id:02X}")).as_deref(), Some(stored));
        }
    }
}

/// The manual's complete example.
#[test]
fn the_manuals_example() {
    let mut valve = Rig::booted();
    valve.exchange("1BC78820: 04 2E 10 01 21", &["1BC408F1: 03 6E 10 01"]);
    valve.exchange("000: 81 00", &["721: 00", "0A1: 00 00 00 00 00 00 00 00"]);
    valve.exchange("1BC78820: 03 22 10 01", &[]);
    valve.exchange("1BC78821: 03 22 10 01", &["1BC108F1: 04 62 10 01 21"]);
}

/// Codes 0x22 while the memory is being written, after all other checks; 0x72 when it fails.
#[test]
fn while_the_memory_is_written() {
    let mut valve = Rig::booted();
    valve.write_time = Duration::from_millis(50);
    valve.exchange(SAVE, &[]);
    // it waits for the memory, and is under way
    ask(&mut valve, "04 2E 10 01 21", NODE_ID_ANSWER, "");
    ask(&mut valve, "04 2E 10 01 80", NODE_ID_ANSWER, "03 7F 2E 31");
    ask(&mut valve, "04 2E F0 10 00", ANSWER, "03 7F 2E 33");
    ask(&mut valve, "03 22 10 01", ANSWER, "04 62 10 01 20");
    valve.advance_sends(50, &[SAVED]);
    // not stored yet
    ask(&mut valve, "03 22 10 01", ANSWER, "04 62 10 01 20");
    ask(&mut valve, "04 2E 10 01 22", NODE_ID_ANSWER, "03 7F 2E 22");
    valve.advance_sends(50, &["1BC408F1: 03 6E 10 01"]);
    ask(&mut valve, "03 22 10 01", ANSWER, "04 62 10 01 21");

    valve.writes_fail = true;
    ask(&mut valve, "04 2E 10 01 22", NODE_ID_ANSWER, "");
    valve.advance(50);
    let mut sent = valve.take();
    sent.sort();
    assert_eq!(sent, ["0A0: 00 10 01 01 00 00 00 00", "1BC408F1: 03 7F 2E 72"]);
    ask(&mut valve, "03 22 10 01", ANSWER, "04 62 10 01 21");
}

/// Requests of any source are answered there, nets of sources included; for another destination there is silence.
#[test]
fn sources_and_destinations() {
    for (source, destination, answered) in [
        (0x0F1, 0x020, true),
        (0x000, 0x020, true),
        (0x0FF, 0x020, true),
        (0x7FF, 0x020, true),
        (0x1F1, 0x020, true),
        (0x0F1, 0x021, false),
        (0x0F1, 0x000, false),
        (0x0F1, 0x0FF, false),
        (0x0F1, 0x120, false),
        (0x0F1, 0x720, false),
        (0x0F1, 0x0A0, false),
    ] {
        let mut valve = Rig::booted();
        let request = format!("{:08X}: 03 22 F0 10", 0x1BC0_0000_u32 | source << 11 | destination);
        let answer = format!("{:08X}: 04 62 F0 10 A5", 0x1BC0_0000_u32 | destination << 11 | source);
        let answers = [answer.as_str()];
        valve.exchange(&request, if answered { &answers } else { &[] });
    }
}

#[test]
fn other_identifiers_are_none() {
    let mut valve = Rig::booted();
    // the priority, both data pages, the type of service; and a remote frame
    for id in ["1BC78820", "17C78820", "1FC78820", "19C78820", "1AC78820", "1B478820", "1B878820", "1B078820"] {
        let answers = [format!("{ANSWER}: 04 62 F0 10 A5")];
        let answers: Vec<&str> = answers.iter().map(String::as_str).collect();
        valve.exchange(&format!("{id}: 03 22 F0 10"), if id == REQUEST { &answers } else { &[] });
    }
    valve.exchange("1BC78820: R4", &[]);
}

/// The identifiers of every node: only the answer to a write of the node ID is the same for all.
#[test]
fn every_node() {
    for node in 1..=127_u8 {
        let mut valve = Rig::booted_as(Setup { node_id: Some(node), ..Setup::new(Kind::PveaCanopen) });
        let request = format!("{:08X}", 0x1BC7_8800 | u32::from(node));
        let answer = format!("{:08X}: 04 62 F0 10 A5", 0x1BC0_00F1 | u32::from(node) << 11);
        valve.exchange(&format!("{request}: 03 22 F0 10"), &[&answer]);
        valve.exchange(&format!("{request}: 04 2E 10 01 80"), &["1BC408F1: 03 7F 2E 31"]);
        valve.exchange(&format!("{request}: 04 2E 10 01 33"), &["1BC408F1: 03 6E 10 01"]);
    }
}

#[test]
fn without_an_address_it_is_silent() {
    let mut valve = Rig::power_on(Setup { node_id: None, ..Setup::new(Kind::PveaCanopen) });
    for destination in 0..=255 {
        valve.exchange(&format!("{:08X}: 03 22 F0 10", 0x1BC7_8800 | destination), &[]);
        valve.exchange(&format!("{:08X}: 04 2E 10 01 21", 0x1BC7_8800 | destination), &[]);
    }
    valve.power_cycle();
    assert_eq!(valve.node_id(), None);
}
