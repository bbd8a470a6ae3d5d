//! Previously active faults and their counts through key-off, restarts and failing memories (SPEC 2, 5, 6).

use protocol_core::actuator::SpoolFault;
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, CLAIM, DM1_CLEAR, DM2_NONE, DM2_REQUEST, DM3_DONE, DM3_REQUEST, INTERNAL};

const DM2_INTERNAL: &str = "18FECB83: 10 FF FA 8F 8B 01 FF FF";
#[track_caller]
fn restarts(valve: &mut Rig) {
    valve.power_cycle();
    valve.expect(CLAIM);
    valve.advance(250);
    valve.take();
}

/// A valve that an internal error has shut down; the error is gone, the shutdown lasts, all is stored.
fn shut_down() -> Rig {
    let mut valve = Rig::claimed();
    valve.internal_fault_comes_and_goes();
    valve.advance(20_000);
    valve.take();
    valve
}

/// What DM3 says is cleared, is: the next occurrence is the first.
#[test]
fn dm3_after_key_off_in_a_shutdown() {
    for again in [false, true] {
        let mut valve = shut_down();
        restarts(&mut valve);
        valve.exchange(DM3_REQUEST, &[DM3_DONE]);
        if again {
            restarts(&mut valve);
        }
        valve.exchange(DM2_REQUEST, &[DM2_NONE]);
        valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
    }
}

/// Faults of the spool, which share a position and not a counter.
#[test]
fn key_off_with_a_stuck_spool() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    let extend = "0CFE3327: FA FF 31 FF FF FF FF FF";
    valve.advance_cyclic(1000, extend);
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::None);
    valve.advance_cyclic(20_000, BLOCK);
    valve.send(extend);
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    valve.advance_cyclic(1000, extend);
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::None);
    valve.advance_cyclic(20_000, extend);
    assert_eq!(valve.take_under("18FECA83").last().map(String::as_str), Some(DM1_CLEAR));
    restarts(&mut valve);
    valve.exchange(DM2_REQUEST, &["18FECB83: 10 FF EC 8F 87 02 FF FF"]);
}

/// A fault between the store of a commanded address and the restart is written before it.
#[test]
fn a_count_that_falls_while_a_restart_waits() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    valve.send("18EA8327: 00 FF 00");
    valve.command_address(0x84, 0x27);
    valve.internal_fault_comes_and_goes();
    valve.advance(10);
    valve.hold_bus(false);
    valve.advance(250);
    assert!(valve.take().contains(&"18EEFF84: 01 00 20 07 08 FF 02 20".to_owned()));
    valve.exchange("18EA8427: CB FE 00", &["18FECB84: 10 FF FA 8F 8B 01 FF FF"]);
}

/// The same while it waits for the memory.
#[test]
fn a_count_that_falls_while_the_memory_writes() {
    for at in [10, 50, 60, 99, 110] {
        let mut valve = Rig::claimed();
        valve.sense(|inputs| inputs.temperature_c = 130);
        valve.advance(250);
        valve.sense(|inputs| inputs.temperature_c = 25);
        valve.write_time = Duration::from_millis(50);
        valve.command_address(0x84, 0x27);
        valve.advance(at);
        valve.internal_fault_comes_and_goes();
        valve.advance(1000);
        let sent = valve.take();
        assert!(sent.contains(&"18EEFF84: 01 00 20 07 08 FF 02 20".to_owned()), "{at} ms: {sent:?}");
        valve.sense(|inputs| inputs.internal_fault = true);
        assert_eq!(valve.take_news(), ["18FECA84: 10 FF FA 8F 8B 02 FF FF"], "{at} ms");
    }
}

/// The first change after a DM3 is a first one: it is stored within 1 s.
#[test]
fn the_first_count_after_dm3() {
    let mut valve = shut_down();
    valve.recover_and_settle();
    valve.exchange(DM3_REQUEST, &[DM3_DONE]);
    valve.internal_fault_comes_and_goes();
    valve.advance_cyclic(1000, BLOCK);
    restarts(&mut valve);
    valve.exchange(DM2_REQUEST, &[DM2_INTERNAL]);
}
