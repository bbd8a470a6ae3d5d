//! The fault log: when the occurrence counters are written, and how they are cleared (SPEC 2, 4.5, 6).

use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::{Rig, lss};

use super::{CLEAR, COUNTERS_CLEARED, SAVE};

fn fault(valve: &mut Rig) {
    valve.internal_fault_comes_and_goes();
    valve.take();
}

fn log_writes(valve: &Rig) -> usize {
    valve.writes.iter().filter(|key| **key == RecordKey::FaultLog).count()
}

/// Within 1 s of the first change, then at most once in 10 s.
#[test]
fn its_rhythm() {
    let mut valve = Rig::booted();
    let mut written_at = Vec::new();
    for ms in 0..60_000_u64 {
        if ms % 300 == 0 && (1000..50_000).contains(&ms) {
            fault(&mut valve);
        }
        let before = log_writes(&valve);
        valve.advance(1);
        if log_writes(&valve) > before {
            written_at.push(ms + 1);
        }
    }
    assert!((1200..=2200).contains(&written_at[0]), "within 1 s of the first change: {written_at:?}");
    assert!(written_at.windows(2).all(|pair| pair[1] - pair[0] >= 10_000), "{written_at:?}");
    assert!(written_at.len() >= 5, "but not seldomer than that: {written_at:?}");
    let count = valve.read(0x2024, 0);
    valve.start_anew();
    assert_eq!((valve.read(0x2024, 0), count), (count, 127));
}

#[test]
fn nothing_is_written_without_a_change() {
    let mut valve = Rig::booted();
    valve.writes.clear();
    valve.advance(3_600_000);
    assert_eq!(valve.writes, []);
}

#[test]
fn before_a_restart_on_command() {
    let by_nmt: fn(&mut Rig) = |valve| valve.send("000: 81 00");
    let by_lss: fn(&mut Rig) = |valve| {
        valve.send(lss::TO_CONFIGURATION);
        valve.send("7E5: 11 21 00 00 00 00 00 00");
        valve.send(lss::TO_WAITING);
    };
    let by_communication: fn(&mut Rig) = |valve| {
        valve.send("000: 82 00");
        valve.power_cycle();
    };
    let by_flush: fn(&mut Rig) = |valve| {
        valve.flush();
        valve.power_cycle();
    };
    for restart in [by_nmt, by_lss, by_communication, by_flush] {
        let mut valve = Rig::booted();
        fault(&mut valve);
        restart(&mut valve);
        valve.take();
        assert_eq!(valve.read(0x2024, 0), 1);
        valve.start_anew();
        assert_eq!(valve.read(0x2024, 0), 1);
    }
}

/// A cut before it was written loses what was counted since: no more.
#[test]
fn a_power_cut_before_it_is_written() {
    let mut valve = Rig::booted();
    fault(&mut valve);
    valve.advance(1000);
    fault(&mut valve);
    valve.start_anew();
    assert_eq!(valve.read(0x2024, 0), 1);
}

#[test]
fn clearing_clears_all_of_them() {
    let mut valve = Rig::booted();
    fault(&mut valve);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(250);
    valve.take();
    valve.exchange(CLEAR, &[COUNTERS_CLEARED]);
    for index in [0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024, 0x2040] {
        assert_eq!(valve.read(index, 0), 0, "{index:04X}");
    }
    assert_eq!((valve.read(0x1001, 0), valve.read(0x1003, 0)), (0x09, 2), "faults and history stay");
    valve.start_anew();
    assert_eq!(valve.read(0x2024, 0), 0);
    fault(&mut valve);
    assert_eq!(valve.read(0x2024, 0), 1);
}

/// The log that the valve writes for itself clears nothing, and answers no client.
#[test]
fn clearing_waits_for_its_own_write() {
    for fails in [false, true] {
        let mut valve = Rig::booted();
        fault(&mut valve);
        valve.write_time = Duration::from_millis(30);
        valve.flush();
        if fails {
            valve.failing_writes.insert(0);
        }
        valve.exchange(CLEAR, &[]);
        valve.advance(30);
        assert!(!valve.take().contains(&COUNTERS_CLEARED.to_owned()), "the first write fails: {fails}");
        valve.advance(30);
        assert!(valve.take().contains(&COUNTERS_CLEARED.to_owned()), "the first write fails: {fails}");
    }
}

/// When the memory fails the counters are what they were.
#[test]
fn clearing_fails() {
    let mut valve = Rig::booted();
    fault(&mut valve);
    valve.advance(1000);
    valve.writes_fail = true;
    valve.exchange(CLEAR, &["0A0: 00 10 01 02 00 00 00 00", "5A0: 80 11 10 05 00 00 06 06"]);
    // This fault cannot be logged either, and is told once for all that.
    valve.silent_for(30_000);
    assert_eq!(valve.read(0x2024, 0), 2);
    valve.start_anew();
    assert_eq!(valve.read(0x2024, 0), 1);
}

/// A fault while the counters are being cleared is not lost.
#[test]
fn a_fault_during_the_clearing() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(1250);
    valve.take();
    valve.write_time = Duration::from_millis(50);
    valve.exchange(CLEAR, &[]);
    valve.advance(25);
    fault(&mut valve);
    valve.advance_sends(25, &[COUNTERS_CLEARED]);
    assert_eq!((valve.read(0x200F, 0), valve.read(0x2024, 0)), (0, 1));
    valve.advance(20_000);
    valve.start_anew();
    assert_eq!((valve.read(0x200F, 0), valve.read(0x2024, 0)), (0, 1));
}

/// The first change after a clearing is a first one: it is stored within 1 s, and the next within 10 s more.
#[test]
fn the_first_count_after_a_clearing() {
    for (before, at, write_time) in [(false, 0, 0), (true, 0, 0), (true, 300, 0), (true, 2000, 0), (true, 600, 50)] {
        let mut valve = Rig::booted();
        if before {
            fault(&mut valve);
        }
        valve.advance(at);
        valve.write_time = Duration::from_millis(write_time);
        valve.exchange(CLEAR, if write_time == 0 { &[COUNTERS_CLEARED] } else { &[] });
        valve.advance(write_time / 2);
        // During the clearing, or after it.
        fault(&mut valve);
        valve.advance(1000);
        let writes = log_writes(&valve);
        fault(&mut valve);
        valve.advance(8000);
        assert_eq!(log_writes(&valve), writes, "once in 10 s");
        valve.start_anew();
        assert_eq!(valve.read(0x2024, 0), 1, "a count before: {before}, cleared after {at} ms");
    }
}

/// A clearing that fails leaves the memory its 10 s.
#[test]
fn a_clearing_that_fails_is_not_followed_by_a_write_at_once() {
    let mut valve = Rig::booted();
    fault(&mut valve);
    valve.advance(2000);
    valve.failing_writes = [0].into();
    valve.send(CLEAR);
    valve.take();
    let writes = log_writes(&valve);
    valve.advance(9999);
    assert_eq!(log_writes(&valve), writes);
    valve.advance(1);
    assert_eq!(log_writes(&valve), writes + 1);
    valve.start_anew();
    assert_eq!(valve.read(0x2024, 0), 2);
}

/// The counts that it would have cleared come back, and are written before the restart.
#[test]
fn a_clearing_that_fails_while_a_restart_waits() {
    let mut valve = Rig::booted();
    valve.write_time = Duration::from_millis(50);
    valve.send(SAVE);
    fault(&mut valve);
    valve.send(CLEAR);
    valve.failing_writes = [1].into();
    valve.send("000: 81 00");
    valve.advance(1000);
    valve.take();
    assert_eq!(valve.read(0x2024, 0), 2, "the injected fault, and that of the memory");
}
