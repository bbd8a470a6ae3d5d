//! UDS lite of all kinds of valve: every identifier, every refusal in its order, and who is answered under what (SPEC 7).

use std::ops::RangeInclusive;

use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;
use tests::uds::{TESTER, WRITTEN, answer, message, request};

/// A kind of valve, with what it answers.
struct Valve {
    kind: Kind,
    address: u8,
    addresses: RangeInclusive<u8>,
    part: &'static str,
    serial: &'static str,
    /// What puts it into each of its states.
    states: &'static [&'static str],
    /// What tells an internal error of a new valve, and its end.
    error: [&'static str; 2],
}

const CANOPEN: Valve = Valve {
    kind: Kind::PveaCanopen,
    address: 0x20,
    addresses: 0x01..=0x7F,
    part: "00 AA 20 7D",
    serial: "5B 2E 01 00",
    states: &["000: 80 00", "000: 01 00", "000: 02 00"],
    error: ["0A0: 00 10 01 01 00 00 00 00", "0A0: 00 00 00 00 00 00 00 00"],
};

const ISOBUS: Valve = Valve {
    kind: Kind::PveaIsobus,
    address: 0x83,
    addresses: 0x80..=0x8F,
    part: "00 A9 B5 19",
    serial: "00 00 00 01",
    states: &[
        "0CFE3327: 7D FF 30 FF FF FF FF FF",
        "0CFE3327: 7D FF 31 FF FF FF FF FF",
        "0CFE3327: 7D FF 32 FF FF FF FF FF",
        "0CFE3327: 7D FF 33 FF FF FF FF FF",
        "0CFE3327: 7D FF 3A FF FF FF FF FF",
        "0CFE3327: 7D FF 3E FF FF FF FF FF",
    ],
    error: ["18FECA83: 10 FF FA 8F 8B 01 FF FF", "18FECA83: 00 FF 00 00 00 00 FF FF"],
};

const VALVES: [Valve; 4] = [
    CANOPEN,
    Valve { kind: Kind::PveoCanopen, part: "00 AA 20 83", ..CANOPEN },
    ISOBUS,
    Valve { kind: Kind::PveoIsobus, part: "00 A9 BD 22", ..ISOBUS },
];

impl Valve {
    fn at(&self, address: u8) -> Rig {
        let setup = Setup { node_id: Some(address), ..Setup::new(self.kind) };
        if self.addresses.contains(&0x80) { Rig::claimed_as(setup) } else { Rig::booted_as(setup) }
    }

    fn fresh(&self) -> Rig {
        self.at(self.address)
    }

    /// A new valve in each state, with and without an internal error.
    fn in_every_state(&self, test: impl Fn(&mut Rig)) {
        for state in self.states {
            for internal_fault in [false, true] {
                let mut rig = self.fresh();
                rig.send(state);
                rig.sense(|inputs| inputs.internal_fault = internal_fault);
                rig.take();
                test(&mut rig);
            }
        }
    }

    /// Sends a request; the valve must answer this under its own identifier, or nothing.
    #[track_caller]
    fn ask(&self, rig: &mut Rig, bytes: &str, expected: Option<&str>) {
        let expected = expected.map(|bytes| answer(self.address, bytes));
        rig.exchange(&request(self.address, bytes), expected.as_deref().as_slice());
    }

    /// The stored address.
    #[track_caller]
    fn expect_stored(&self, rig: &mut Rig, address: u8) {
        self.ask(rig, "03 22 10 01", Some(&format!("04 62 10 01 {address:02X}")));
    }
}

#[test]
fn every_identifier_in_every_state() {
    for valve in VALVES {
        let address = format!("{:02X}", valve.address);
        let part_numbers = ["F1 FA", "F1 FB", "F1 FC", "F1 FD"].map(|identifier| (identifier, valve.part));
        let others = [("10 01", address.as_str()), ("F0 10", "A5"), ("F1 8C", valve.serial)];
        valve.in_every_state(|rig| {
            for (identifier, data) in part_numbers.iter().chain(&others) {
                let len = 3 + data.split(' ').count();
                valve.ask(rig, &format!("03 22 {identifier}"), Some(&format!("{len:02X} 62 {identifier} {data}")));
            }
        });
    }
}

/// The identifiers whose contents the text leaves open: how many bytes they have, and in which form.
#[test]
fn lengths_and_forms() {
    for valve in VALVES {
        let mut rig = valve.fresh();
        for (identifier, len) in [("F1 92", 4), ("F1 93", 4), ("F1 94", 4), ("F1 95", 4), ("F1 8B", 3)] {
            rig.send(&request(valve.address, &format!("03 22 {identifier}")));
            let frame = rig.take_next().unwrap();
            let head = answer(valve.address, &format!("{:02X} 62 {identifier} ", len + 3));
            assert!(frame.to_string().starts_with(&head) && frame.data().len() == len + 4, "{frame}");
            let data = &frame.data()[4..];
            match identifier {
                "F1 92" => assert!(frame.to_string().ends_with(valve.part), "the part number: {frame}"),
                "F1 93" | "F1 95" => {
                    assert!(data.is_ascii() && data[0] != b' ', "four characters, left adjusted: {frame}");
                }
                "F1 8B" => assert!(data.iter().all(|byte| byte >> 4 < 10 && byte & 0xF < 10), "BCD: {frame}"),
                _ => {}
            }
        }
    }
}

/// Requests and the code they are refused with, in the order of the checks; empty: no answer at all.
const REFUSALS: [(&str, &str); 44] = [
    // no answer
    ("", ""),
    ("00", ""),
    ("00 22 F0 10", ""),
    ("08 22 F0 10", ""),
    ("10 22 F0 10", ""),
    ("FF", ""),
    // answers
    ("03 62 F0 10", ""),
    ("03 7F 22 11", ""),
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
    for valve in VALVES {
        valve.in_every_state(|rig| {
            for (bytes, code) in REFUSALS {
                let refusal = format!("03 7F {code}");
                valve.ask(rig, bytes, (!code.is_empty()).then_some(&refusal));
            }
        });
    }
}

/// Writes of 0x1001 of a wrong length.
const MALFORMED: [&str; 5] = ["03 2E 10 01", "05 2E 10 01 @ 00", "05 2E 10 01 @", "03 2E 10 01 @", "04 2E 10 01 @ 00"];

/// What is stored reads back; in force it is after a restart.
#[test]
fn every_write_of_the_address() {
    for valve in VALVES {
        let own = valve.address;
        for address in 0..=255_u8 {
            let valid = valve.addresses.contains(&address);
            let mut rig = valve.fresh();
            let bytes = format!("04 2E 10 01 {address:02X}");
            rig.exchange(&request(own, &bytes), &[if valid { WRITTEN } else { "1BC408F1: 03 7F 2E 31" }]);
            valve.expect_stored(&mut rig, if valid { address } else { own });
            assert_eq!(rig.node_id(), Some(own));
            rig.power_cycle();
            assert_eq!(rig.node_id(), Some(if valid { address } else { own }));
        }
        valve.in_every_state(|rig| {
            let other = own + 1;
            for bytes in MALFORMED {
                let bytes = bytes.replace('@', &format!("{other:02X}"));
                rig.exchange(&request(own, &bytes), &["1BC408F1: 03 7F 2E 13"]);
            }
            valve.expect_stored(rig, own);
            rig.exchange(&request(own, &format!("04 2E 10 01 {other:02X}")), &[WRITTEN]);
            valve.expect_stored(rig, other);
        });
    }
}

/// The manuals' complete examples.
#[test]
fn the_manuals_examples() {
    let mut rig = CANOPEN.fresh();
    rig.exchange("1BC78820: 04 2E 10 01 21", &["1BC408F1: 03 6E 10 01"]);
    rig.exchange("000: 81 00", &["721: 00", "0A1: 00 00 00 00 00 00 00 00"]);
    rig.exchange("1BC78820: 03 22 10 01", &[]);
    rig.exchange("1BC78821: 03 22 10 01", &["1BC108F1: 04 62 10 01 21"]);

    let mut rig = ISOBUS.fresh();
    rig.exchange("1BC78883: 04 2E 10 01 86", &["1BC408F1: 03 6E 10 01"]);
    rig.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 86"]);
    rig.exchange("18EA8327: 00 EE 00", &["18EEFF83: 01 00 20 07 08 FF 02 20"]);
    rig.restart();
    rig.exchange("1BC78883: 03 22 10 01", &[]);
    rig.exchange("1BC78886: 03 22 10 01", &["1BC430F1: 04 62 10 01 86"]);
}

/// Code 0x22 while an address is being written, after all other checks; 0x72 when the memory fails, which is an internal
/// error until the next write succeeds.
#[test]
fn while_the_memory_is_written() {
    for valve in VALVES {
        let own = valve.address;
        let write = |address: u8| request(own, &format!("04 2E 10 01 {address:02X}"));
        let mut rig = valve.fresh();
        rig.write_time = Duration::from_millis(50);
        rig.exchange(&write(own + 1), &[]);
        rig.exchange(&write(0), &["1BC408F1: 03 7F 2E 31"]);
        valve.ask(&mut rig, "04 2E F0 10 00", Some("03 7F 2E 33"));
        rig.exchange(&write(own + 2), &["1BC408F1: 03 7F 2E 22"]);
        valve.expect_stored(&mut rig, own);
        rig.advance_sends(50, &[WRITTEN]);
        valve.expect_stored(&mut rig, own + 1);

        let sorted = |rig: &mut Rig| {
            rig.advance(50);
            let mut sent = rig.take();
            sent.retain(|frame| !frame.starts_with("0CFE1"));
            sent.sort();
            sent
        };
        rig.writes_fail = true;
        rig.exchange(&write(own + 2), &[]);
        assert_eq!(sorted(&mut rig), [valve.error[0], "1BC408F1: 03 7F 2E 72"]);
        valve.expect_stored(&mut rig, own + 1);
        rig.writes_fail = false;
        rig.exchange(&write(own + 3), &[]);
        assert_eq!(sorted(&mut rig), [valve.error[1], WRITTEN]);
    }
}

/// Requests of any source are answered there, nets of sources included; for another destination there is silence.
#[test]
fn every_source_and_destination() {
    for valve in VALVES {
        let own = u32::from(valve.address);
        for other in 0..=0x7FF_u32 {
            let mut rig = valve.fresh();
            rig.exchange(&message(other, own, "03 22 F0 10"), &[&message(own, other, "04 62 F0 10 A5")]);
            rig.send(&message(TESTER, other, "03 22 F0 10"));
            let answers = rig.take().iter().filter(|frame| frame.starts_with("1BC")).count();
            assert_eq!(answers, usize::from(other == own), "to {other:03X}");
        }
    }
}

/// Another priority, data page or type of service; and a remote frame.
#[test]
fn other_identifiers_are_none() {
    for valve in VALVES {
        let requested = TESTER << 11 | u32::from(valve.address);
        for prefix in ["17C", "1FC", "19C", "1AC", "1B4", "1B8", "1B0"] {
            let mut rig = valve.fresh();
            let prefix = u32::from_str_radix(prefix, 16).unwrap() << 20;
            rig.send(&format!("{:08X}: 03 22 F0 10", prefix | requested));
            let sent = rig.take();
            assert!(!sent.iter().any(|frame| frame.ends_with("04 62 F0 10 A5")), "{prefix:08X}: {sent:?}");
        }
        valve.fresh().exchange(&request(valve.address, "R4"), &[]);
    }
}

/// Only the answer to a write of the address is under the same identifier for all.
#[test]
fn every_address() {
    for valve in VALVES {
        for address in valve.addresses.clone() {
            let mut rig = valve.at(address);
            rig.exchange(&request(address, "03 22 F0 10"), &[&answer(address, "04 62 F0 10 A5")]);
            rig.exchange(&request(address, "04 2E 10 01 00"), &["1BC408F1: 03 7F 2E 31"]);
            let other = *valve.addresses.end();
            rig.exchange(&request(address, &format!("04 2E 10 01 {other:02X}")), &[WRITTEN]);
        }
    }
}

#[test]
fn without_an_address_it_is_silent() {
    let mut rig = Rig::power_on(Setup { node_id: None, ..Setup::new(Kind::PveaCanopen) });
    for destination in 0..=255 {
        rig.silent_to(&[&request(destination, "03 22 F0 10"), &request(destination, "04 2E 10 01 21")]);
    }
    rig.power_cycle();
    assert_eq!(rig.node_id(), None);
}
