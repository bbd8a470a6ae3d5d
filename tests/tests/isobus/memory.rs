//! What the ISOBUS valve keeps over a loss of power, when it is written, and what a start makes of what is damaged
//! (SPEC 2, 5, 6).

use protocol_core::device::pve::{Kind, Setup};
use protocol_core::memory::{RecordKey, seal};
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{
    AVEF_BLOCKED, BLOCK, CLAIM, DM1_CLEAR, DM2_NONE, DM2_REQUEST, DM3_DONE, DM3_REQUEST, EXTEND, INTERNAL,
};

/// An internal error comes and goes, and its shutdown is ended.
fn undergo_internal_error(valve: &mut Rig) {
    valve.internal_fault_comes_and_goes();
    valve.recover();
    valve.take();
}

/// Lets so much time pass under neutral commands, so that everything is stored.
fn settle(valve: &mut Rig) {
    valve.advance_cyclic(20_000, BLOCK);
    valve.take();
}

/// A valve whose internal error is previously active, and stored.
fn after_an_internal_error() -> Rig {
    let mut valve = Rig::claimed();
    undergo_internal_error(&mut valve);
    settle(&mut valve);
    valve
}

#[track_caller]
fn expect_dm2(valve: &mut Rig, dm2: &str) {
    valve.take();
    valve.exchange(DM2_REQUEST, &[dm2]);
}

fn fault_log_writes(valve: &Rig) -> usize {
    valve.writes.iter().filter(|key| **key == RecordKey::FaultLog).count()
}

#[test]
fn a_new_memory_is_filled_once() {
    let mut valve = Rig::claimed();
    assert_eq!(valve.writes, [RecordKey::Factory, RecordKey::LocalLayer]);
    settle(&mut valve);
    valve.restart();
    valve.advance(20_000);
    assert_eq!(valve.writes.len(), 2);
    valve.expect_news(&[]);
}

/// What was written at first decides, whatever the valve is said to be later.
#[test]
fn the_memory_decides_over_the_setup() {
    let mut valve = Rig::claimed_as(Setup { serial: Some(7), node_id: Some(0x8C), ..Setup::new(Kind::PveaIsobus) });
    let records = std::mem::take(&mut valve.records);
    let mut other = Rig::claimed_as(Setup { serial: Some(9), ..Setup::new(Kind::PveaIsobus) });
    other.records = records;
    other.power_cycle();
    other.expect("18EEFF8C: 07 00 20 07 08 FF 02 20");
}

#[test]
fn counters_and_list_survive_a_loss_of_power() {
    let mut valve = Rig::claimed();
    undergo_internal_error(&mut valve);
    undergo_internal_error(&mut valve);
    settle(&mut valve);
    for _ in 0..3 {
        valve.restart();
        expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 02 FF FF");
    }
    valve.sense_news(|inputs| inputs.internal_fault = true, &["18FECA83: 10 FF FA 8F 8B 03 FF FF"]);
    // the watchdog takes nothing away either, and counts for itself
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.recover();
    settle(&mut valve);
    valve.watchdog_reset();
    valve.expect(CLAIM);
    valve.advance_news(250, &["18FECA83: 10 FF FA 8F 8B 04 FF FF", DM1_CLEAR]);
}

/// It has been reported, and so it is gone; the shutdown is there to be ended.
#[test]
fn a_watchdog_reset() {
    let mut valve = Rig::claimed();
    valve.watchdog_reset();
    valve.expect(CLAIM);
    valve.silent_until(250, &[AVEF_BLOCKED, INTERNAL, DM1_CLEAR]);
    valve.send(EXTEND);
    assert_eq!(valve.flow()[2], 0x30);
    valve.recover();
    valve.send(EXTEND);
    assert_eq!(valve.flow()[2], 0x31);
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 01 FF FF");
}

/// The first change within a second, then at most every ten seconds, whatever happens.
#[test]
fn when_the_fault_log_is_written() {
    let mut valve = Rig::claimed();
    let mut times = Vec::new();
    for ms in 0..60_000_u64 {
        if ms % 700 == 0 {
            valve.sense(|inputs| inputs.internal_fault = ms % 1400 == 0);
        }
        if ms % 100 == 0 {
            valve.send(BLOCK);
        }
        let before = fault_log_writes(&valve);
        valve.advance(1);
        if fault_log_writes(&valve) > before {
            times.push(ms);
        }
    }
    assert!(times[0] <= 1000, "{times:?}");
    assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= 9_999), "{times:?}");
    assert!(times.len() >= 5, "{times:?}");
}

/// The list of previously active faults follows from the counters: a recovery is nothing to be written.
#[test]
fn a_recovery_is_not_written() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.internal_fault = true);
    settle(&mut valve);
    let writes = fault_log_writes(&valve);
    valve.sense(|inputs| inputs.internal_fault = false);
    settle(&mut valve);
    assert_eq!(fault_log_writes(&valve), writes);
    valve.restart();
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 01 FF FF");
}

/// At 127 a new activation changes nothing in the memory; the fault leaves the list while it is active.
#[test]
fn a_counter_that_stands() {
    let mut valve = Rig::claimed();
    for _ in 0..130 {
        undergo_internal_error(&mut valve);
    }
    settle(&mut valve);
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 7F FF FF");
    valve.sense(|inputs| inputs.internal_fault = true);
    expect_dm2(&mut valve, DM2_NONE);
    settle(&mut valve);
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.restart();
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 7F FF FF");
}

/// Power fails while a fault is active, or its shutdown lasts: it was counted, and is previously active unless it is
/// found again.
#[test]
fn a_loss_of_power_in_a_shutdown() {
    for gone in [false, true] {
        let mut valve = Rig::claimed();
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance(300);
        valve.sense(|inputs| inputs.temperature_c = if gone { 25 } else { 130 });
        valve.advance(1000);
        valve.restart();
        expect_dm2(&mut valve, if gone { "18FECB83: 04 FF F1 8F 90 01 FF FF" } else { DM2_NONE });
        if !gone {
            // found again after its delay, which began with the power
            valve.power_cycle();
            valve.advance_sends(249, &[CLAIM]);
            valve.advance_news(1, &["18FECA83: 04 FF F1 8F 90 02 FF FF"]);
        }
    }
}

/// The list that earlier versions stored is not looked at: the counters tell it.
#[test]
fn a_fault_log_of_an_earlier_version() {
    for list in [0x00, 0x04, 0xFF] {
        let mut valve = Rig::claimed();
        let log = seal(1, &[0, 0, 5, 0, 0, 0, 0, 0, list]).unwrap();
        valve.records.insert(RecordKey::FaultLog, log.to_vec());
        valve.restart();
        expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 05 FF FF");
    }
}

/// Acknowledged when the memory holds it, not before.
#[test]
fn dm3_in_the_memory() {
    let mut valve = after_an_internal_error();
    valve.write_time = Duration::from_millis(50);
    valve.exchange(DM3_REQUEST, &[]);
    valve.advance_news(49, &[]);
    // the power fails: nothing has happened
    valve.restart();
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 01 FF FF");

    valve.exchange(DM3_REQUEST, &[]);
    valve.advance_news(50, &[DM3_DONE]);
    valve.restart();
    expect_dm2(&mut valve, DM2_NONE);
    valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
}

/// Two who ask are both told.
#[test]
fn dm3_of_two_askers() {
    let mut valve = after_an_internal_error();
    valve.write_time = Duration::from_millis(50);
    valve.silent_to(&[DM3_REQUEST, "18EA83F9: CC FE 00", "18EAFF28: CC FE 00"]);
    valve.advance_cyclic_news(200, BLOCK, &[DM3_DONE, "18E8FF83: 00 FF FF FF F9 CC FE 00"]);
    expect_dm2(&mut valve, DM2_NONE);
}

/// A fault that occurs while DM3 is written keeps its counter.
#[test]
fn dm3_and_a_fault_meanwhile() {
    let mut valve = after_an_internal_error();
    valve.write_time = Duration::from_millis(50);
    valve.exchange(DM3_REQUEST, &[]);
    valve.advance(10);
    valve.sense_news(|inputs| inputs.internal_fault = true, &["18FECA83: 10 FF FA 8F 8B 02 FF FF"]);
    valve.advance_news(40, &[DM3_DONE]);
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.recover();
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 02 FF FF");
    settle(&mut valve);
    valve.restart();
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 02 FF FF");
}

/// Acknowledged as not done to one who asks, silent to all; nothing cleared, an internal error until a write of the log
/// succeeds.
#[test]
fn dm3_with_a_memory_that_fails() {
    for (request, refused) in [
        (DM3_REQUEST, &["18E8FF83: 01 FF FF FF 27 CC FE 00", INTERNAL][..]),
        ("18EA83F9: CC FE 00", &["18E8FF83: 01 FF FF FF F9 CC FE 00", INTERNAL]),
        ("18EAFF27: CC FE 00", &[INTERNAL]),
    ] {
        let mut valve = Rig::claimed();
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance_cyclic(300, BLOCK);
        valve.sense(|inputs| inputs.temperature_c = 25);
        settle(&mut valve);
        valve.write_time = Duration::from_millis(50);
        valve.writes_fail = true;
        valve.send(request);
        valve.advance_news(49, &[]);
        valve.advance_news(1, refused);
        expect_dm2(&mut valve, "18FECB83: 04 FF F1 8F 90 01 FF FF");
        valve.writes_fail = false;
        valve.send(DM3_REQUEST);
        valve.advance(50);
        let mut sent = valve.take_news();
        sent.sort();
        assert_eq!(sent, [DM3_DONE, DM1_CLEAR], "{request}");
        expect_dm2(&mut valve, DM2_NONE);
    }
}

/// An empty list needs no memory: acknowledged at once, whether that is slow or fails.
#[test]
fn dm3_of_an_empty_list_needs_no_memory() {
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(50);
    valve.exchange(DM3_REQUEST, &[DM3_DONE]);
    valve.writes_fail = true;
    valve.exchange(DM3_REQUEST, &[DM3_DONE]);
    valve.advance_news(1000, &[]);
}

/// It is tried again, ten seconds apart, and the error ends with the first success.
#[test]
fn a_fault_log_that_cannot_be_written() {
    let mut valve = Rig::claimed();
    valve.writes_fail = true;
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance_cyclic_news(300, BLOCK, &["18FECA83: 04 FF F1 8F 90 01 FF FF"]);
    valve.advance_cyclic(900, BLOCK);
    assert_eq!(valve.take_news().first().map(String::as_str), Some(INTERNAL));
    valve.sense(|inputs| inputs.temperature_c = 25);
    valve.writes_fail = false;
    valve.advance_cyclic(11_000, BLOCK);
    assert_eq!(valve.take_news().last().map(String::as_str), Some(DM1_CLEAR));
    assert_eq!(fault_log_writes(&valve), 1);
}

/// Defaults in the place of what is corrupt, and an internal error that each start finds and counts.
#[test]
fn corrupt_records() {
    for key in [RecordKey::Factory, RecordKey::LocalLayer, RecordKey::FaultLog] {
        let mut valve = Rig::claimed_as(Setup::new(Kind::PveaIsobus));
        valve.exchange("1BC78880: 04 2E 10 01 85", &["1BC408F1: 03 6E 10 01"]);
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance_cyclic(300, "0CFE3027: 00 FF 30 FF FF FF FF FF");
        valve.sense(|inputs| inputs.temperature_c = 25);
        valve.advance_cyclic(20_000, "0CFE3027: 00 FF 30 FF FF FF FF FF");
        for position in 0..valve.records[&key].len() {
            let intact = valve.records.clone();
            valve.records.get_mut(&key).unwrap()[position] ^= 0x10;
            valve.power_cycle();
            let address = if key == RecordKey::LocalLayer { 0x80 } else { 0x85 };
            valve.expect(&format!("18EEFF{address:02X}: 01 00 20 07 08 FF 02 20"));
            valve.advance_news(250, &[&format!("18FECA{address:02X}: 10 FF FA 8F 8B 01 FF FF")]);
            let dm2 = if key == RecordKey::FaultLog { "00 FF 00 00 00 00" } else { "04 FF F1 8F 90 01" };
            valve.send(&format!("18EA{address:02X}27: CB FE 00"));
            valve.expect_news(&[&format!("18FECB{address:02X}: {dm2} FF FF")]);
            assert!(!valve.outputs().solenoids);
            valve.records = intact;
        }
    }
}

/// A record that is whole and means nothing.
#[test]
fn records_that_make_no_sense() {
    for (key, payload) in [
        (RecordKey::LocalLayer, &[0x7F, 3][..]),
        (RecordKey::LocalLayer, &[0x90, 3]),
        (RecordKey::LocalLayer, &[0x85]),
        (RecordKey::LocalLayer, &[]),
        // 500 kbit/s is not for ISOBUS
        (RecordKey::LocalLayer, &[0x85, 2]),
        (RecordKey::FaultLog, &[0; 8]),
        (RecordKey::FaultLog, &[0; 10]),
        (RecordKey::Factory, &[0; 4]),
    ] {
        let mut valve = Rig::claimed_as(Setup::new(Kind::PveaIsobus));
        valve.records.insert(key, seal(1, payload).unwrap().to_vec());
        valve.power_cycle();
        valve.expect("18EEFF80: 01 00 20 07 08 FF 02 20");
        valve.advance_news(250, &["18FECA80: 10 FF FA 8F 8B 01 FF FF"]);
    }
}

/// A corrupt address is well with its next write, by whatever service.
#[test]
fn a_corrupt_record_ends_with_its_next_write() {
    let mut valve = Rig::claimed();
    valve.records.insert(RecordKey::LocalLayer, vec![0; 6]);
    valve.power_cycle();
    valve.advance(250);
    valve.take();
    valve.send("1BC78883: 04 2E 10 01 83");
    let mut sent = valve.take_news();
    sent.sort();
    assert_eq!(sent, [DM1_CLEAR, "1BC408F1: 03 6E 10 01"]);
    valve.restart();
    valve.advance_news(1000, &[]);
}

/// Until the next start, whatever is written.
#[test]
fn a_damaged_memory() {
    let mut valve = Rig::claimed();
    valve.memory_damaged = true;
    valve.power_cycle();
    valve.expect(CLAIM);
    valve.advance_news(250, &[INTERNAL]);
    valve.memory_damaged = false;
    valve.exchange("1BC78883: 04 2E 10 01 83", &["1BC408F1: 03 6E 10 01"]);
    valve.no_news_until(1_000, &[INTERNAL]);
    valve.restart();
    valve.advance_news(1000, &[]);
}

/// Asked for by the platform, at once.
#[test]
fn flush() {
    let mut valve = Rig::claimed();
    undergo_internal_error(&mut valve);
    valve.flush();
    valve.restart();
    expect_dm2(&mut valve, "18FECB83: 10 FF FA 8F 8B 01 FF FF");
}
