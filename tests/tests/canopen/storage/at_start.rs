//! What a start finds in the memory (SPEC 6).

use super::*;

/// Everything stored, then one record spoilt in every way that a memory can.
fn full() -> Rig {
    let mut valve = configuring();
    save_own(&mut valve);
    valve.exchange("7E5: 13 00 02 00 00 00 00 00", &["7E4: 13 00 00 00 00 00 00 00"]);
    valve.exchange(lss::STORE, &["7E4: 17 00 00 00 00 00 00 00"]);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(250);
    valve.sense(|inputs| inputs.temperature_c = 25);
    valve.advance(1000);
    valve.take();
    valve.exchange(LOAD, &[LOADED]);
    valve
}

fn spoilt(record: &[u8]) -> Vec<Vec<u8>> {
    let mut flipped = record.to_vec();
    *flipped.last_mut().unwrap() ^= 0x10;
    let mut version = record.to_vec();
    version[0] ^= 0x40;
    vec![flipped, version, record[..record.len() - 1].to_vec(), vec![], vec![0xFF; 127], vec![0; 300]]
}

/// A record that fails is taken as absent, and raises the internal error.
#[test]
fn a_corrupt_record() {
    for key in full_records().into_keys() {
        let mut valve = full_records();
        for bytes in spoilt(&valve[&key].clone()) {
            valve.insert(key, bytes.clone());
            let mut rig = Rig::booted();
            rig.records = valve.clone();
            // what asks for the defaults at start would hide the parameters
            if key != RecordKey::RestoreFlag {
                rig.records.remove(&RecordKey::RestoreFlag);
            }
            rig.power_cycle();
            let what = format!("{key:?} {bytes:02X?}");
            let sent = rig.take();
            let intact_log = key != RecordKey::FaultLog;
            assert_eq!(sent, [BOOT[0], BOOT[1], INTERNAL_ERROR], "{what}");
            assert_eq!((rig.status(), rig.read(0x1001, 0)), (0x03, 1), "{what}");
            assert_eq!(has_own(&mut rig), key != RecordKey::Parameters, "{what}");
            assert_eq!(rig.read(0x200F, 0), u32::from(intact_log), "{what}");
            let rate = if key == RecordKey::LocalLayer { 250_000 } else { 500_000 };
            assert_eq!(rig.device().bit_rate().bits_per_second(), rate, "{what}");
            assert_eq!(rig.read(0x1018, 4), 0x5B2E_0100, "{what}");
        }
    }
}

fn full_records() -> BTreeMap<RecordKey, Vec<u8>> {
    full().records
}

/// The error of a record ends with its next successful write: the fault log is written by itself.
#[test]
fn a_corrupt_record_is_well_with_its_next_write() {
    let mends: [(RecordKey, &str, &str); 3] = [
        (RecordKey::LocalLayer, lss::STORE, "7E4: 17 00 00 00 00 00 00 00"),
        (RecordKey::Parameters, SAVE, SAVED),
        (RecordKey::RestoreFlag, LOAD, LOADED),
    ];
    for (key, request, answer) in mends {
        let mut valve = Rig::booted();
        valve.records.insert(key, vec![0; 8]);
        valve.power_cycle();
        assert_eq!(valve.take(), [BOOT[0], BOOT[1], INTERNAL_ERROR], "{key:?}");
        valve.advance(20_000);
        valve.exchange("7E5: 04 01 00 00 00 00 00 00", &[]);
        valve.send(request);
        let mut expected = [answer, CLEARED];
        expected.sort_unstable();
        assert_eq!(sorted(&mut valve), expected, "{key:?}");
    }
    let mut valve = Rig::booted();
    valve.records.insert(RecordKey::FaultLog, vec![0; 8]);
    valve.power_cycle_sends(&[BOOT[0], BOOT[1], INTERNAL_ERROR]);
    valve.advance_sends(1000, &[CLEARED]);
}

/// A corrupt record at a reset application is found and counted again.
#[test]
fn a_corrupt_record_is_found_by_every_start() {
    let mut valve = Rig::booted();
    valve.records.insert(RecordKey::Parameters, vec![0; 8]);
    valve.start_anew();
    valve.exchange("000: 81 00", &[BOOT[0], BOOT[1], "0A0: 00 10 01 02 00 00 00 00"]);
    valve.exchange("000: 82 00", &[BOOT[0], BOOT[1], "0A0: 00 10 01 02 00 00 00 00"]);
}

/// A blank valve whose node ID was damaged is not blank: it had one.
#[test]
fn a_damaged_node_id_is_the_default_one() {
    let mut valve = blank();
    valve.records.insert(RecordKey::LocalLayer, vec![1, 2, 3]);
    valve.power_cycle_sends(&[BOOT[0], BOOT[1], INTERNAL_ERROR]);
}
