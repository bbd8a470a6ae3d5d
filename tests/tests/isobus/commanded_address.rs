//! Commanded address: the BAM that gives the valve an address, and all that spoils it (SPEC 5).

use protocol_core::actuator::Led;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, CANNOT_CLAIM, CLAIM, DM1_CLEAR, EXTEND, INTERNAL, LOWER_NAME};

/// The manual's example: address 0x81 for the valve of this NAME.
const ANNOUNCE: &str = "1CECFF27: 20 09 00 02 FF D8 FE 00";
const FIRST: &str = "1CEBFF27: 01 01 00 20 07 08 FF 02";
const SECOND: &str = "1CEBFF27: 02 20 81 FF FF FF FF FF";

/// The valve must have taken no notice: nothing sent, the old address.
#[track_caller]
fn expect_no_notice(valve: &mut Rig, why: &str) {
    assert_eq!(valve.take_news(), [""; 0], "{why}");
    assert_eq!(valve.node_id(), Some(0x83), "{why}");
    valve.power_cycle();
    assert_eq!(valve.node_id(), Some(0x83), "{why}");
}

#[test]
fn the_manuals_example() {
    let mut valve = Rig::claimed();
    valve.exchange(ANNOUNCE, &[]);
    valve.advance(60);
    valve.exchange(FIRST, &[]);
    valve.advance(39);
    valve.exchange(SECOND, &["18EEFF81: 01 00 20 07 08 FF 02 20"]);
    // from here on it is a start like any other
    valve.silent_until(250, &["0CFE1181: 7D 7D 30 FF FF FF FF FF"]);
    valve.exchange("18EA8327: 00 EE 00", &[]);
    valve.exchange("18EA8127: 00 EE 00", &["18EEFF81: 01 00 20 07 08 FF 02 20"]);
    valve.send(EXTEND);
    assert_eq!(valve.flow()[2], 0x30, "the old number");
    valve.send("0CFE3127: FA FF 31 FF FF FF FF FF");
    assert_eq!(valve.flow()[2], 0x31);
    valve.exchange("1BC78883: 03 22 10 01", &[]);
    valve.exchange("1BC78881: 03 22 10 01", &["1BC408F1: 04 62 10 01 81"]);
    valve.power_cycle();
    valve.expect("18EEFF81: 01 00 20 07 08 FF 02 20");
}

#[test]
fn every_address() {
    for kind in [Kind::PveaIsobus, Kind::PveoIsobus] {
        for address in 0..=255_u8 {
            let mut valve = Rig::claimed_as(Setup { node_id: Some(0x83), ..Setup::new(kind) });
            valve.command_address(address, 0x27);
            if (0x80..=0x8F).contains(&address) {
                valve.expect_all(&[&format!("18EEFF{address:02X}: 01 00 20 07 08 FF 02 20")]);
            } else {
                expect_no_notice(&mut valve, &format!("{address:02X}"));
            }
        }
    }
}

/// The present address too is stored, and restarts the valve.
#[test]
fn its_own_address() {
    let mut valve = Rig::extending(400);
    valve.take();
    let writes = valve.writes.len();
    valve.command_address(0x83, 0x27);
    valve.expect(CLAIM);
    assert_eq!(valve.writes.len(), writes + 1);
    valve.advance(250);
    valve.expect("0CFE1383: 7D 7D 30 FF FF FF FF FF");
}

#[test]
fn another_name_is_not_meant() {
    for (first, second) in [
        ("1CEBFF27: 01 02 00 20 07 08 FF 02", SECOND),
        ("1CEBFF27: 01 01 00 20 07 08 FF 03", SECOND),
        ("1CEBFF27: 01 00 00 00 00 00 00 00", SECOND),
        (FIRST, "1CEBFF27: 02 21 81 FF FF FF FF FF"),
        (FIRST, "1CEBFF27: 02 A0 81 FF FF FF FF FF"),
    ] {
        let mut valve = Rig::claimed();
        valve.send_all(&[ANNOUNCE, first, second]);
        expect_no_notice(&mut valve, second);
    }
}

/// Bytes that do not count: the reserved one, what fills the last packet, the priority.
#[test]
fn what_does_not_count() {
    for frames in [
        ["1CECFF27: 20 09 00 02 00 D8 FE 00", FIRST, "1CEBFF27: 02 20 81 00 00 00 00 00"],
        ["00ECFF27: 20 09 00 02 FF D8 FE 00", "18EBFF27: 01 01 00 20 07 08 FF 02", "04EBFF27: 02 20 81 12 34 56 78 9A"],
    ] {
        let mut valve = Rig::claimed();
        valve.send_all(&frames);
        valve.expect("18EEFF81: 01 00 20 07 08 FF 02 20");
    }
}

/// Trains that are none, each with what is wrong with it.
const SPOILT: [(&str, &[&str]); 26] = [
    ("no announcement", &[FIRST, SECOND]),
    ("no packet", &[ANNOUNCE]),
    ("the first missing", &[ANNOUNCE, SECOND]),
    ("the last missing", &[ANNOUNCE, FIRST]),
    ("the other way round", &[ANNOUNCE, SECOND, FIRST]),
    ("the other way round, and again", &[ANNOUNCE, SECOND, FIRST, SECOND]),
    ("twice the first", &[ANNOUNCE, FIRST, FIRST, SECOND]),
    ("from 0", &[ANNOUNCE, "1CEBFF27: 00 01 00 20 07 08 FF 02", SECOND]),
    ("from 0, three", &[ANNOUNCE, "1CEBFF27: 00 01 00 20 07 08 FF 02", FIRST, SECOND]),
    ("a gap in the numbers", &[ANNOUNCE, FIRST, "1CEBFF27: 03 20 81 FF FF FF FF FF"]),
    ("a gap, then the right one", &[ANNOUNCE, FIRST, "1CEBFF27: 03 20 81 FF FF FF FF FF", SECOND]),
    ("8 bytes", &["1CECFF27: 20 08 00 02 FF D8 FE 00", FIRST, SECOND]),
    ("10 bytes", &["1CECFF27: 20 0A 00 02 FF D8 FE 00", FIRST, SECOND]),
    ("0x109 bytes", &["1CECFF27: 20 09 01 02 FF D8 FE 00", FIRST, SECOND]),
    ("1 packet", &["1CECFF27: 20 09 00 01 FF D8 FE 00", FIRST, SECOND]),
    ("3 packets", &["1CECFF27: 20 09 00 03 FF D8 FE 00", FIRST, SECOND]),
    ("another group", &["1CECFF27: 20 09 00 02 FF D9 FE 00", FIRST, SECOND]),
    ("another page", &["1CECFF27: 20 09 00 02 FF D8 FE 01", FIRST, SECOND]),
    ("RTS", &["1CECFF27: 10 09 00 02 FF D8 FE 00", FIRST, SECOND]),
    (
        "addressed",
        &[
            "1CEC8327: 20 09 00 02 FF D8 FE 00",
            "1CEB8327: 01 01 00 20 07 08 FF 02",
            "1CEB8327: 02 20 81 FF FF FF FF FF",
        ],
    ),
    ("packets addressed", &[ANNOUNCE, "1CEB8327: 01 01 00 20 07 08 FF 02", "1CEB8327: 02 20 81 FF FF FF FF FF"]),
    ("short announcement", &["1CECFF27: 20 09 00 02 FF D8 FE", FIRST, SECOND]),
    ("short packet", &[ANNOUNCE, "1CEBFF27: 01 01 00 20 07 08 FF", SECOND]),
    ("short last packet", &[ANNOUNCE, FIRST, "1CEBFF27: 02 20 81"]),
    ("replaced by another message", &[ANNOUNCE, FIRST, "1CECFF27: 20 09 00 02 FF CB FE 00", SECOND]),
    ("two senders", &[ANNOUNCE, "1CEBFF28: 01 01 00 20 07 08 FF 02", "1CEBFF28: 02 20 81 FF FF FF FF FF"]),
];

/// Silently: and the next sound one is taken.
#[test]
fn spoilt_trains() {
    for (why, frames) in SPOILT {
        let mut valve = Rig::claimed();
        valve.send_all(frames);
        expect_no_notice(&mut valve, why);

        let mut valve = Rig::claimed();
        valve.send_all(frames);
        valve.send_all(&[ANNOUNCE, FIRST, SECOND]);
        assert_eq!(valve.take_news(), ["18EEFF81: 01 00 20 07 08 FF 02 20"], "{why}");
    }
}

/// 750 ms from frame to frame are borne, more are not.
#[test]
fn gaps() {
    for (gaps, arrives) in [
        ([0, 0], true),
        ([750_000, 750_000], true),
        ([750_001, 10], false),
        ([10, 750_001], false),
        ([2_000_000, 10], false),
    ] {
        let mut valve = Rig::claimed();
        valve.send(ANNOUNCE);
        for (gap, packet) in gaps.into_iter().zip([FIRST, SECOND]) {
            valve.advance_by(Duration::from_micros(gap));
            valve.send(packet);
        }
        assert_eq!(valve.node_id(), Some(if arrives { 0x81 } else { 0x83 }), "{gaps:?}");
        if !arrives {
            expect_no_notice(&mut valve, "late");
        }
    }
}

#[test]
fn a_new_announcement_replaces_the_old() {
    let mut valve = Rig::claimed();
    valve.send_all(&[ANNOUNCE, FIRST, ANNOUNCE, SECOND]);
    assert_eq!(valve.node_id(), Some(0x83));
    valve.send_all(&[ANNOUNCE, FIRST, ANNOUNCE, FIRST, SECOND]);
    assert_eq!(valve.node_id(), Some(0x81));
}

/// Sixteen senders, their packets mixed: 15 mean others, one means the valve, wherever it stands in the row.
#[test]
fn sixteen_senders_at_once() {
    for meant in 0..16_u8 {
        let mut valve = Rig::claimed();
        for source in 0..16_u8 {
            valve.send(&format!("1CECFF{source:02X}: 20 09 00 02 FF D8 FE 00"));
        }
        for source in (0..16_u8).rev() {
            let identity = if source == meant { 1 } else { 2 + source };
            valve.send(&format!("1CEBFF{source:02X}: 01 {identity:02X} 00 20 07 08 FF 02"));
        }
        for source in 0..16_u8 {
            valve.expect_news(&[]);
            valve.send(&format!("1CEBFF{source:02X}: 02 20 {:02X} FF FF FF FF FF", 0x80 | source));
            if source == meant {
                break;
            }
        }
        assert_eq!(valve.node_id(), Some(0x80 | meant));
    }
}

/// Senders that fell silent do not keep the valve from hearing others, nor do messages that it does not want.
#[test]
fn senders_that_fell_silent() {
    let mut valve = Rig::claimed();
    for source in 0..=253_u8 {
        valve.send(&format!("1CECFF{source:02X}: 20 12 00 03 FF CB FE 00"));
    }
    for source in 0..16_u8 {
        valve.send(&format!("1CECFF{source:02X}: 20 09 00 02 FF D8 FE 00"));
    }
    valve.advance(751);
    valve.command_address(0x84, 0xF9);
    assert_eq!(valve.node_id(), Some(0x84));
}

/// Within the wait, and by a valve that has lost its address, before and after its cannot-claim.
#[test]
fn whenever_it_comes() {
    for before in [&[][..], &[LOWER_NAME]] {
        for waited in [0, 100, 249, 250, 1000] {
            let mut valve = Rig::power_on(Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) });
            valve.expect(CLAIM);
            valve.send_all(before);
            valve.advance(waited);
            let sent = valve.take_news();
            assert!(sent.iter().all(|frame| frame == CANNOT_CLAIM), "{sent:?}");
            valve.command_address(0x85, 0x27);
            valve.expect("18EEFF85: 01 00 20 07 08 FF 02 20");
            valve.advance_sends(250, &["0CFE1585: 7D 7D 30 FF FF FF FF FF"]);
        }
    }
}

/// The lost address too can be commanded: then it is fought for once more.
#[test]
fn the_lost_address_again() {
    let mut valve = Rig::claimed();
    valve.send(LOWER_NAME);
    valve.advance_news(200, &[CANNOT_CLAIM]);
    valve.command_address(0x83, 0x27);
    valve.expect(CLAIM);
    valve.exchange(LOWER_NAME, &[]);
    assert_eq!(valve.node_id(), None);
}

/// It works on until the memory holds the address, and restarts then.
#[test]
fn a_slow_memory() {
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(150);
    valve.command_address(0x81, 0x27);
    valve.send(EXTEND);
    valve.advance(149);
    valve.expect("0CFE1383: A5 7D 31 FF FF FF FF FF");
    valve.exchange("18EA8327: CA FE 00", &[DM1_CLEAR]);
    valve.expect_nothing();
    valve.advance_sends(1, &["18EEFF81: 01 00 20 07 08 FF 02 20"]);

    // the power fails before: the old address
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(150);
    valve.command_address(0x81, 0x27);
    valve.advance(149);
    valve.power_cycle();
    assert_eq!(valve.node_id(), Some(0x83));
}

/// Until the bus lets it restart, the valve is off: it moves nothing, obeys nobody, and misses no command.
#[test]
fn a_restart_that_waits_for_the_bus() {
    let mut valve = Rig::claimed();
    valve.advance_cyclic(300, EXTEND);
    assert!(valve.outputs().solenoids);
    valve.take();
    valve.hold_bus(true);
    valve.advance(100);
    valve.command_address(0x81, 0x27);
    assert!(!valve.outputs().solenoids);
    valve.send(EXTEND);
    assert!(!valve.outputs().solenoids, "it takes no command");
    valve.advance(1000);
    valve.hold_bus(false);
    let sent = valve.take();
    assert_eq!(sent.last().map(String::as_str), Some("18EEFF81: 01 00 20 07 08 FF 02 20"));
    assert!(!sent.iter().any(|frame| frame.starts_with("18FECA")), "no fault 8: {sent:?}");
}

/// Of two that follow each other both are stored; the last one is in force.
#[test]
fn two_in_a_row() {
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(50);
    valve.command_address(0x81, 0x27);
    valve.command_address(0x82, 0x28);
    valve.advance(1000);
    assert_eq!(valve.node_id(), Some(0x82));
}

/// An internal error, and all goes on under the old address.
#[test]
fn the_memory_fails() {
    let mut valve = Rig::claimed();
    valve.send(EXTEND);
    valve.writes_fail = true;
    valve.command_address(0x81, 0x27);
    valve.expect_news(&[INTERNAL]);
    assert_eq!(valve.node_id(), Some(0x83));
    assert_eq!(valve.flow()[2], 0x30, "shut down");
    valve.advance_cyclic_news(500, BLOCK, &[]);
    // gone with the next write of that record that succeeds, which restarts the valve; it is counted
    valve.writes_fail = false;
    valve.command_address(0x81, 0x27);
    valve.expect(DM1_CLEAR);
    valve.take_claim();
    assert_eq!(valve.node_id(), Some(0x81));
    valve.exchange("18EA8127: CA FE 00", &["18FECA81: 00 FF 00 00 00 00 FF FF"]);
    valve.sense_news(|inputs| inputs.internal_fault = true, &["18FECA81: 10 FF FA 8F 8B 02 FF FF"]);
}

/// A cause that lasts over the restart is found again by it, and counted again.
#[test]
fn causes_last_over_the_restart() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.take();
    valve.command_address(0x81, 0x27);
    valve.take_claim();
    valve.expect_news(&["18FECA81: 10 FF FA 8F 8B 02 FF FF"]);

    // bus-off that comes while the address is stored: the claim waits for its end
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(50);
    valve.command_address(0x81, 0x27);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    valve.silent_for(500);
    assert_eq!((valve.node_id(), valve.outputs().led), (Some(0x81), Led::RED));
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    valve.take_claim();
}

/// What was counted before a restart on command is not lost by it.
#[test]
fn counters_survive_the_restart() {
    let mut valve = Rig::claimed();
    for _ in 0..3 {
        valve.internal_fault_comes_and_goes();
    }
    valve.recover();
    valve.take();
    valve.command_address(0x81, 0x27);
    valve.take_claim();
    valve.exchange("18EA8127: CB FE 00", &["18FECB81: 10 FF FA 8F 8B 03 FF FF"]);
}
