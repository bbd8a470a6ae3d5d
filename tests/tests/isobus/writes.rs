//! Writes that wait for each other: no request is refused for another's sake, however often it is repeated (SPEC 5–7).

use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, DM3_DONE, DM3_REQUEST};

const UDS_WRITE: &str = "1BC78883: 04 2E 10 01 85";
const UDS_WRITTEN: &str = "1BC408F1: 03 6E 10 01";

#[test]
fn uds_waits_for_other_writes() {
    type Case = (u64, fn() -> Rig, fn(&mut Rig));
    let cases: [Case; 3] = [
        (300, Rig::claimed, |valve| {
            valve.records.clear();
            valve.power_cycle();
            valve.advance(251);
        }),
        (500, Rig::claimed, |valve| {
            valve.internal_fault_comes_and_goes();
            valve.advance(600);
        }),
        (50, Rig::with_two_previously_active, |valve| valve.send(DM3_REQUEST)),
    ];
    for (write_ms, valve, begin) in cases {
        let mut valve = valve();
        valve.write_time = Duration::from_millis(write_ms);
        begin(&mut valve);
        valve.take();
        valve.send(UDS_WRITE);
        valve.advance_cyclic(2000, BLOCK);
        let sent = valve.take();
        assert!(sent.contains(&UDS_WRITTEN.to_owned()), "{write_ms} ms: {sent:?}");
        valve.power_cycle();
        assert_eq!(valve.node_id(), Some(0x85));
    }
}

/// Another client's write of the same identifier refuses.
#[test]
fn uds_does_not_wait_for_another_client() {
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(50);
    valve.exchange(UDS_WRITE, &[]);
    valve.exchange("1BC79083: 04 2E 10 01 86", &["1BC408F1: 03 7F 2E 22"]);
    valve.advance(50);
    valve.expect(UDS_WRITTEN);
}

/// A client that repeats DM3 while it is carried out: one more write at the most, and each has its answer, as far as there
/// is room.
#[test]
fn a_dm3_repeated_many_times() {
    for (times, all) in [(3, true), (30, false)] {
        let mut valve = Rig::with_two_previously_active();
        valve.advance_cyclic(20_000, BLOCK);
        valve.take();
        valve.writes.clear();
        valve.write_time = Duration::from_millis(300);
        for _ in 0..times {
            valve.send(DM3_REQUEST);
            valve.advance(1);
        }
        valve.advance_cyclic(5000, BLOCK);
        let acknowledged = valve.take_news().iter().filter(|frame| *frame == DM3_DONE).count();
        let dropped = usize::try_from(valve.device().frames_dropped()).unwrap();
        assert_eq!((acknowledged + dropped, dropped == 0), (times, all));
        assert!(valve.writes.len() <= 2, "{:?}", valve.writes);
    }
}

/// Two tools that ask for more than the write under way clears share the next one, and each has its answer.
#[test]
fn dm3_of_several_tools() {
    let mut valve = Rig::with_two_previously_active();
    valve.write_time = Duration::from_secs(2);
    valve.send(DM3_REQUEST);
    // Time guarding becomes the third one.
    valve.advance(300);
    valve.recover();
    for tool in [0x28, 0x29_u8] {
        valve.send(&format!("18EA83{tool:02X}: CC FE 00"));
    }
    assert_eq!(valve.take_under("18E8FF83"), [""; 0]);
    valve.advance_cyclic(1500, BLOCK);
    assert_eq!(valve.take_under("18E8FF83"), [DM3_DONE]);
    valve.advance_cyclic(5000, BLOCK);
    let done = |tool: u8| format!("18E8FF83: 00 FF FF FF {tool:02X} CC FE 00");
    assert_eq!(valve.take_under("18E8FF83"), [done(0x28), done(0x29)]);
    valve.exchange("18EA8327: CB FE 00", &["18FECB83: 00 FF 00 00 00 00 FF FF"]);
}

/// The first write fails, the one that the second tool has asked for does not: nobody is told that it failed.
#[test]
fn dm3_that_fails_and_is_carried_out_for_another_tool() {
    let mut valve = Rig::with_two_previously_active();
    valve.write_time = Duration::from_millis(50);
    valve.failing_writes.insert(0);
    valve.send_all(&[DM3_REQUEST, "18EA8328: CC FE 00"]);
    valve.advance(50);
    assert_eq!(valve.take_under("18E8FF83"), [""; 0]);
    valve.advance(50);
    assert_eq!(valve.take_under("18E8FF83"), [DM3_DONE, "18E8FF83: 00 FF FF FF 28 CC FE 00"]);

    // The last one has nobody behind it.
    let mut valve = Rig::with_two_previously_active();
    valve.write_time = Duration::from_millis(50);
    valve.failing_writes.extend([0, 1]);
    valve.send_all(&[DM3_REQUEST, "18EA8328: CC FE 00"]);
    valve.advance(100);
    let failed = |tool: u8| format!("18E8FF83: 01 FF FF FF {tool:02X} CC FE 00");
    assert_eq!(valve.take_under("18E8FF83"), [failed(0x27), failed(0x28)]);
}

/// A commanded address that is repeated while it is stored restarts the valve without delay, under it.
#[test]
fn a_commanded_address_repeated_many_times() {
    let mut valve = Rig::claimed();
    valve.write_time = Duration::from_millis(300);
    for source in 0..16_u8 {
        valve.command_address(0x84, source);
        valve.advance(1);
    }
    valve.advance(600);
    assert!(valve.take().contains(&"18EEFF84: 01 00 20 07 08 FF 02 20".to_owned()));
    assert_eq!(valve.node_id(), Some(0x84));
}
