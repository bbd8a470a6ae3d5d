//! Acknowledged means kept: what a client was told is stored survives a power cut at that instant (SPEC 4.5, 6).

use protocol_core::actuator::Led;
use protocol_core::controller::BitRate;
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::{Rig, lss};

use super::{BOOT, CLEAR, LOAD, LOADED, SAVE, SAVED, blank};

const NOT_SAVED: &str = "5A0: 80 10 10 01 00 00 06 06";
const NOT_LOADED: &str = "5A0: 80 11 10 01 00 00 06 06";
const CONFIGURE: &str = lss::TO_CONFIGURATION;
const LSS_STORED: &str = lss::STORED;
const RATE_500K: &str = "7E5: 13 00 02 00 00 00 00 00";
const RATE_TAKEN: &str = "7E4: 13 00 00 00 00 00 00 00";
const UDS_WRITE: &str = "1BC78820: 04 2E 10 01 30";
const UDS_WRITTEN: &str = "1BC408F1: 03 6E 10 01";

/// The value of 0x1028:1 that tells a client's own parameters from the defaults.
const OWN: u32 = 0xA5;

/// The most milliseconds that an answer may take.
const PATIENCE_MS: u64 = 2000;

/// Sends a request and lets time pass until its answer, at whose instant it returns.
#[track_caller]
fn ask(valve: &mut Rig, request: &str, answer: &str) {
    valve.send(request);
    for _ in 0..PATIENCE_MS {
        if valve.take().iter().any(|frame| frame == answer) {
            return;
        }
        valve.advance(1);
    }
    panic!("{request} is not answered by {answer}");
}

/// Writes a parameter, and takes the answer.
fn change(valve: &mut Rig) {
    ask(valve, "620: 23 28 10 01 A5 00 00 00", "5A0: 60 28 10 01 00 00 00 00");
}

#[track_caller]
fn boots(valve: &mut Rig) {
    valve.power_cycle();
    valve.advance(1);
    let sent = valve.take();
    assert!(sent.starts_with(&BOOT.map(str::to_owned)), "{sent:?}");
}

fn has_own(valve: &mut Rig) -> bool {
    valve.read(0x1028, 1) == OWN
}

/// A valve at the start that executes "load". Its writes take 50 ms each; those of these numbers fail.
fn executing_load(failing: &[usize]) -> Rig {
    let mut valve = Rig::booted();
    valve.exchange(LOAD, &[LOADED]);
    valve.write_time = Duration::from_millis(50);
    valve.failing_writes = failing.iter().copied().collect();
    boots(&mut valve);
    valve
}

/// The "load" that was acknowledged outlives a "save" whose write of the flag fails, and the "save" after that.
#[test]
fn load_then_a_save_that_fails_while_load_is_executed() {
    let mut valve = executing_load(&[0]);
    ask(&mut valve, LOAD, LOADED);
    change(&mut valve);
    valve.failing_writes = [1].into();
    ask(&mut valve, SAVE, NOT_SAVED);
    ask(&mut valve, SAVE, SAVED);
    boots(&mut valve);
    assert!(!has_own(&mut valve));
}

/// A "load" that was refused is not asked for by the "save" after it.
#[test]
fn a_load_that_fails_while_load_is_executed_and_a_save() {
    let mut valve = executing_load(&[0, 1]);
    ask(&mut valve, LOAD, NOT_LOADED);
    change(&mut valve);
    ask(&mut valve, SAVE, SAVED);
    boots(&mut valve);
    assert!(has_own(&mut valve));
}

/// The defaults, or the flag, could not be stored.
#[test]
fn a_save_after_an_executed_load_that_failed() {
    for failing in [0, 1] {
        let mut valve = executing_load(&[failing]);
        valve.advance(1000);
        change(&mut valve);
        ask(&mut valve, SAVE, SAVED);
        boots(&mut valve);
        assert!(has_own(&mut valve), "write {failing} failed");
    }
}

/// What could not be stored at the start is tried again; the internal error ends with it.
#[test]
fn an_executed_load_that_failed_is_tried_again() {
    for failing in [0, 1] {
        let mut valve = executing_load(&[failing]);
        valve.advance(60_000);
        valve.take();
        assert_eq!(valve.read(0x1001, 0), 0, "write {failing} failed");
        valve.writes.clear();
        boots(&mut valve);
        valve.advance(1000);
        assert_eq!(valve.writes, [], "write {failing} failed: there is nothing left to execute");
    }
}

/// A blank valve whose ID was never stored has no defaults to store when "load" is executed.
#[test]
fn load_of_a_blank_valve() {
    let mut valve = blank();
    let assign = |valve: &mut Rig, id: u8| {
        valve.send(CONFIGURE);
        valve.exchange(&format!("7E5: 11 {id:02X} 00 00 00 00 00 00"), &["7E4: 11 00 00 00 00 00 00 00"]);
        valve.send(lss::TO_WAITING);
        let booted = [format!("7{id:02X}: 00"), format!("{:03X}: 00 00 00 00 00 00 00 00", 0x80 + u16::from(id))];
        assert_eq!(valve.take(), booted);
    };
    assign(&mut valve, 0x21);
    valve.exchange("621: 23 11 10 01 6C 6F 61 64", &["5A1: 60 11 10 01 00 00 00 00"]);
    valve.power_cycle();
    valve.silent_for(1000);
    assert_eq!(valve.outputs().led, Led::YELLOW, "no node ID");
    assign(&mut valve, 0x22);
    valve.silent_for(1000);
    assert_eq!((valve.read(0x1001, 0), valve.read(0x1400, 1)), (0, 0x222));
}

#[test]
fn a_reset_after_many_repetitions() {
    for (request, key) in [(SAVE, RecordKey::Parameters), (LOAD, RecordKey::RestoreFlag), (CLEAR, RecordKey::FaultLog)]
    {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(300);
        for _ in 0..16 {
            valve.send(request);
            valve.advance(1);
        }
        valve.send("000: 81 20");
        valve.take();
        valve.advance(600);
        assert_eq!(valve.take(), BOOT, "{request}");
        assert!(valve.writes.contains(&key));
    }
}

/// LSS store writes what LSS configured, nothing else: an ID written by UDS stays.
#[test]
fn lss_store_leaves_what_uds_wrote() {
    let mut valve = Rig::booted();
    valve.exchange(CONFIGURE, &[]);
    valve.exchange("7E5: 11 21 00 00 00 00 00 00", &["7E4: 11 00 00 00 00 00 00 00"]);
    valve.exchange(lss::TO_WAITING, &["721: 00", "0A1: 00 00 00 00 00 00 00 00"]);
    valve.exchange(CONFIGURE, &[]);
    valve.exchange(RATE_500K, &[RATE_TAKEN]);
    valve.write_time = Duration::from_millis(50);
    valve.send_all(&["1BC78821: 04 2E 10 01 30", lss::STORE]);
    valve.advance_sends(100, &[UDS_WRITTEN, LSS_STORED]);
    valve.power_cycle();
    assert_eq!((valve.node_id(), valve.device().bit_rate()), (Some(0x30), BitRate::Kbit500));
}

/// A store after an activation of the present rate, which nobody configured, leaves the stored rate.
#[test]
fn lss_store_leaves_a_rate_that_nobody_configured() {
    let mut valve = Rig::booted();
    valve.exchange(CONFIGURE, &[]);
    valve.exchange(RATE_500K, &[RATE_TAKEN]);
    valve.exchange(lss::STORE, &[LSS_STORED]);
    // What is pending is dropped.
    valve.silent_to(&["000: 01 00", "000: 80 00", CONFIGURE, "7E5: 15 0A 00 00 00 00 00 00"]);
    valve.advance(20);
    valve.exchange(lss::STORE, &[LSS_STORED]);
    valve.power_cycle();
    assert_eq!(valve.device().bit_rate(), BitRate::Kbit500);
}

/// The device's own writes refuse no UDS write: its answer waits.
#[test]
fn a_uds_write_waits_for_the_device() {
    for (what, write_ms) in [("the first start", 50), ("the fault log", 500)] {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(write_ms);
        if what == "the first start" {
            valve.records.clear();
            valve.power_cycle();
        } else {
            valve.internal_fault_comes_and_goes();
            valve.advance(600);
        }
        ask(&mut valve, UDS_WRITE, UDS_WRITTEN);
        valve.power_cycle();
        assert_eq!(valve.node_id(), Some(0x30), "{what}");
    }
}

/// Reset communication reloads the parameters. Those from before an executed "load" are no longer the valve's, although
/// the memory holds them still.
#[test]
fn a_reset_of_the_communication_while_the_defaults_are_unstored() {
    let mut valve = Rig::booted();
    change(&mut valve);
    ask(&mut valve, SAVE, SAVED);
    ask(&mut valve, LOAD, LOADED);
    valve.writes_fail = true;
    boots(&mut valve);
    valve.advance(1000);
    assert!(!has_own(&mut valve));
    valve.send("000: 82 20");
    valve.advance(1000);
    valve.take();
    assert!(!has_own(&mut valve));
}

/// Another "load" that is acknowledged meanwhile stores no defaults either: it sets a flag that is set.
#[test]
fn a_reset_of_the_communication_after_another_load_while_the_defaults_are_unstored() {
    for later in [0, 1_000, 60_000] {
        let mut valve = Rig::booted();
        change(&mut valve);
        ask(&mut valve, SAVE, SAVED);
        ask(&mut valve, LOAD, LOADED);
        valve.failing_writes = [0].into();
        boots(&mut valve);
        valve.advance(1000);
        ask(&mut valve, LOAD, LOADED);
        valve.advance(later);
        valve.send("000: 82 20");
        valve.advance(1000);
        valve.take();
        assert!(!has_own(&mut valve), "{later} ms after the answer");
        boots(&mut valve);
        assert!(!has_own(&mut valve), "{later} ms after the answer, and a start later");
        valve.advance(60_000);
        valve.writes.clear();
        boots(&mut valve);
        valve.advance(1000);
        assert_eq!(valve.writes, [], "nothing is left to execute");
    }
}
