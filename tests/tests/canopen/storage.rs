//! The memory: what is stored when, who is told, and what a start makes of it (SPEC 4.5, 6).

mod at_start;
mod load;

use std::collections::BTreeMap;

use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::{Rig, lss};

use super::{BOOT, CLEAR, CLEARED, COUNTERS_CLEARED, INTERNAL_ERROR, LOAD, LOADED, SAVE, SAVED, blank};

/// What asks for a write: the request, its answer, the answer when the memory fails, and the record.
const REQUESTS: [(&str, &str, &str, RecordKey); 5] = [
    (SAVE, SAVED, "5A0: 80 10 10 01 00 00 06 06", RecordKey::Parameters),
    (LOAD, LOADED, "5A0: 80 11 10 01 00 00 06 06", RecordKey::RestoreFlag),
    (CLEAR, COUNTERS_CLEARED, "5A0: 80 11 10 05 00 00 06 06", RecordKey::FaultLog),
    (lss::STORE, lss::STORED, "7E4: 17 02 00 00 00 00 00 00", RecordKey::LocalLayer),
    ("1BC78820: 04 2E 10 01 21", "1BC408F1: 03 6E 10 01", "1BC408F1: 03 7F 2E 72", RecordKey::LocalLayer),
];

/// Parameters of one's own: an object, its size, what is written.
const OWN: [(u16, u8, u8, u32); 5] = [
    (0x1005, 0, 4, 0x83),
    (0x1017, 0, 2, 5000),
    (0x1028, 1, 4, 0xA5),
    (0x1800, 2, 1, 9),
    (0x6053, 0, 4, u32::from_le_bytes(*b"mine")),
];
const DEFAULTS: [u32; 4] = [0x80, 0, 0x8000_0000, 0xFF];

fn configuring() -> Rig {
    let mut valve = Rig::booted();
    valve.exchange(lss::TO_CONFIGURATION, &[]);
    valve
}

fn slow(ms: u64) -> Rig {
    let mut valve = configuring();
    valve.write_time = Duration::from_millis(ms);
    valve
}

fn write_own(valve: &mut Rig) {
    for (index, sub, size, value) in OWN {
        valve.write(index, sub, size, value).unwrap();
        valve.take();
    }
}

#[track_caller]
fn save_own(valve: &mut Rig) {
    write_own(valve);
    valve.exchange(SAVE, &[SAVED]);
}

/// A valve with parameters of its own, saved.
fn saved() -> Rig {
    let mut valve = Rig::booted();
    save_own(&mut valve);
    valve
}

/// The same, to whose next start the defaults come back.
fn loading() -> Rig {
    let mut valve = saved();
    valve.exchange(LOAD, &[LOADED]);
    valve
}

#[track_caller]
fn has_own(valve: &mut Rig) -> bool {
    let values: Vec<u32> = OWN[..4].iter().map(|(index, sub, ..)| valve.read(*index, *sub)).collect();
    let own: Vec<u32> = OWN[..4].iter().map(|(.., value)| *value).collect();
    assert!(values == own || values == DEFAULTS, "neither one nor the other: {values:X?}");
    let text = valve.sdo(0x40, 0x6053, 0, 0);
    assert_eq!(&text.bytes()[4..] == b"mine", values == own, "{text}");
    values == own
}

/// The frames of an instant without their order, which is that of arbitration.
fn sorted(valve: &mut Rig) -> Vec<String> {
    let mut sent = valve.take();
    sent.sort();
    sent
}

/// 0x06060000, LSS error 2, UDS 0x72; and the internal error until a write of that record succeeds.
#[test]
fn each_failed_write_is_told() {
    for (request, answer, failed, _) in REQUESTS {
        let mut valve = slow(50);
        valve.writes_fail = true;
        valve.exchange(request, &[]);
        valve.advance(50);
        let mut expected = [failed, INTERNAL_ERROR];
        expected.sort_unstable();
        assert_eq!(sorted(&mut valve), expected, "{request}");
        assert_eq!((valve.status(), valve.read(0x1001, 0)), (0x03, 1));

        // a write of another record does not help
        let other = if request == SAVE { LOAD } else { SAVE };
        valve.writes_fail = false;
        valve.exchange(other, &[]);
        valve.advance(50);
        assert_eq!(valve.take(), [if request == SAVE { LOADED } else { SAVED }], "{request}");
        assert_eq!(valve.read(0x1001, 0), 1, "{request}");

        valve.exchange(request, &[]);
        valve.advance(50);
        let mut expected = [answer, CLEARED];
        expected.sort_unstable();
        assert_eq!(sorted(&mut valve), expected, "{request}");
        assert_eq!(valve.read(0x1001, 0), 0);
    }
}

/// A reset command waits for the write: nothing is lost. LSS and UDS still have their answer, an SDO client has not.
#[test]
fn a_reset_during_a_write_waits() {
    for (request, answer, _, key) in REQUESTS {
        for reset in ["000: 81 00", "000: 82 00"] {
            let mut valve = slow(50);
            valve.writes.clear();
            valve.silent_to(&[request, reset]);
            // it takes no part in the bus meanwhile
            valve.silent_to(&["620: 40 00 10 00 00 00 00 00", "000: 82 00"]);
            valve.silent_for(49);
            valve.advance(1);
            let moved = request.contains("2E 10 01 21");
            let boot = if moved { ["721: 00", "0A1: 00 00 00 00 00 00 00 00"] } else { BOOT };
            let answers: Vec<String> = valve.take();
            if request.starts_with("620") {
                assert_eq!(answers, boot, "{request}, {reset}");
            } else {
                assert_eq!(answers, [&[answer][..], &boot].concat(), "{request}, {reset}");
            }
            assert_eq!(valve.writes[0], key);
        }
    }
}

#[test]
fn saved_parameters_come_back_at_every_start() {
    for restart in ["000: 81 00", "000: 82 00", ""] {
        let mut valve = saved();
        valve.write(0x1005, 0, 4, 0x90).unwrap();
        if restart.is_empty() {
            valve.power_cycle();
        } else {
            valve.send(restart);
        }
        assert_eq!(valve.take(), BOOT);
        assert!(has_own(&mut valve), "{restart}");
    }
}

/// One record: every object of the list, and none but those.
#[test]
fn what_is_saved() {
    let mut valve = Rig::booted();
    valve.write_all(&[(0x1400, 1, 4, 0x8000_0220), (0x1800, 1, 4, 0x8000_01A0)]);
    for sub in 1..=8 {
        valve.write_all(&[(0x1600, sub, 4, 0x6300_0110), (0x1A00, sub, 4, 0x6301_0110)]);
    }
    valve.write_all(&[(0x1600, 0, 1, 4), (0x1A00, 0, 1, 3), (0x1400, 1, 4, 0x333), (0x1800, 1, 4, 0xC000_0334)]);
    for (index, sub, size, value) in [(0x6042, 0, 1, 2), (0x6040, 0, 2, 1), (0x6300, 1, 2, 99)] {
        valve.write(index, sub, size, value).unwrap();
    }
    valve.exchange(SAVE, &[SAVED]);
    valve.start_anew();
    let stored = [(0x1400, 1, 0x333), (0x1400, 2, 0xFF), (0x1600, 0, 4), (0x1800, 1, 0xC000_0334), (0x1A00, 0, 3)];
    for (index, sub, value) in stored.into_iter().chain([(0x6042, 0, 1), (0x6040, 0, 0), (0x6300, 1, 0)]) {
        assert_eq!(valve.read(index, sub), value, "{index:04X}:{sub}");
    }
    for sub in 1..=8 {
        assert_eq!((valve.read(0x1600, sub), valve.read(0x1A00, sub)), (0x6300_0110, 0x6301_0110));
    }
}

/// Another request in the middle starts anew: it is answered, the save is not, and is stored all the same.
#[test]
fn a_read_in_the_middle_of_a_save() {
    let mut valve = slow(50);
    write_own(&mut valve);
    valve.exchange(SAVE, &[]);
    assert_eq!(valve.read(0x1000, 0), 0x198);
    valve.silent_for(100);
    valve.start_anew();
    assert!(has_own(&mut valve));
}

/// NMT stop ends the transfer silently; what was begun is stored all the same.
#[test]
fn a_stop_during_a_save() {
    let mut valve = slow(50);
    write_own(&mut valve);
    valve.silent_to(&[SAVE, "000: 02 00"]);
    valve.advance(100);
    valve.exchange("000: 80 00", &[]);
    valve.start_anew();
    assert!(has_own(&mut valve));
}
