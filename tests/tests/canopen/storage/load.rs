//! "load": what it sets, and the start that executes it (SPEC 4.5).

use super::*;

/// The next start uses, and stores, the defaults: first they are stored, then the flag is cleared.
#[test]
fn is_executed_by_the_next_start() {
    for restart in ["000: 81 00", ""] {
        let mut valve = loading();
        assert!(has_own(&mut valve), "not before");
        valve.writes.clear();
        if restart.is_empty() {
            valve.power_cycle();
        } else {
            valve.send(restart);
        }
        assert_eq!(valve.take(), BOOT);
        assert!(!has_own(&mut valve));
        assert_eq!(valve.writes, [RecordKey::Parameters, RecordKey::RestoreFlag]);
        // once only
        save_own(&mut valve);
        valve.start_anew();
        assert!(has_own(&mut valve));
    }
}

/// A save in between does not take the flag away (R).
#[test]
fn a_save_does_not_take_the_flag_away() {
    let mut valve = Rig::booted();
    valve.exchange(LOAD, &[LOADED]);
    save_own(&mut valve);
    valve.start_anew();
    assert!(!has_own(&mut valve));
}

#[test]
fn a_reset_of_the_communication_does_not_execute_it() {
    let mut valve = loading();
    valve.exchange("000: 82 00", &BOOT);
    assert!(has_own(&mut valve));
    valve.exchange("000: 81 00", &BOOT);
    assert!(!has_own(&mut valve));
}

/// Cut between the two writes, or before the first: the next start does it again.
#[test]
fn a_power_cut_during_its_execution() {
    for ms in [0, 25, 75, 100] {
        let mut valve = loading();
        valve.write_time = Duration::from_millis(50);
        valve.start_anew();
        assert!(!has_own(&mut valve), "cut after {ms} ms");
        valve.advance(ms);
        valve.start_anew();
        assert!(!has_own(&mut valve), "cut after {ms} ms");
        valve.advance(100);
        valve.write_time = Duration::from_ticks(0);
        save_own(&mut valve);
        valve.start_anew();
        assert!(has_own(&mut valve), "cut after {ms} ms: executed in the end");
    }
}

/// The memory fails while the defaults are stored: they are used, the error is told, the flag stays.
#[test]
fn its_execution_fails() {
    let mut valve = loading();
    valve.writes_fail = true;
    valve.power_cycle_sends(&[BOOT[0], BOOT[1], INTERNAL_ERROR]);
    assert!(!has_own(&mut valve));
    valve.writes_fail = false;
    valve.power_cycle_sends(&BOOT);
    assert!(!has_own(&mut valve));
}

/// A write of it that fails is tried again after 10 s, and not before, whatever the valve does meanwhile; and the defaults
/// are stored, whatever a client has set by then.
#[test]
fn its_execution_is_tried_again_after_10_s() {
    let mut valve = loading();
    valve.failing_writes.insert(0);
    valve.power_cycle_sends(&[BOOT[0], BOOT[1], INTERNAL_ERROR]);
    valve.writes.clear();
    // Heartbeats, which keep the timers busy.
    valve.write(0x1017, 0, 2, 100).unwrap();
    valve.advance(9_999);
    assert_eq!(valve.writes, [RecordKey::FaultLog]);
    valve.advance(1);
    assert_eq!(valve.writes, [RecordKey::FaultLog, RecordKey::Parameters, RecordKey::RestoreFlag]);
    valve.start_anew();
    assert!(!has_own(&mut valve));
    assert_eq!(valve.read(0x1017, 0), 0, "a default");
}

/// Identity and numbers are factory data: never touched by it; nor are node ID, bit rate and counters.
#[test]
fn what_it_does_not_touch() {
    let mut valve = configuring();
    valve.internal_fault_comes_and_goes();
    valve.advance(1000);
    valve.take();
    valve.exchange("1BC78820: 04 2E 10 01 21", &["1BC408F1: 03 6E 10 01"]);
    let before = valve.records.clone();
    valve.exchange(LOAD, &[LOADED]);
    valve.power_cycle_sends(&["721: 00", "0A1: 00 00 00 00 00 00 00 00"]);
    for key in [RecordKey::Factory, RecordKey::LocalLayer, RecordKey::FaultLog] {
        assert_eq!(valve.records[&key], before[&key], "{key:?}");
    }
    assert_eq!((valve.read(0x1018, 4), valve.read(0x2024, 0)), (0x5B2E_0100, 1));
}
