//! Event timer and inhibit time (SPEC 9).

use protocol_core::device::ProductInputs;
use protocol_core::encoder::Shaft;
use protocol_core::time::{Duration, Instant};
use tests::Rig;

use super::booted;

/// TPDO 1 on, with this event timer in ms and inhibit time in 100 µs, in pre-operational.
fn cyclic(event_timer: u32, inhibit: u32) -> Rig {
    let mut rig = booted();
    rig.write_all(&[(0x1800, 3, 2, inhibit), (0x1800, 5, 2, event_timer), (0x1800, 1, 4, 0x181)]);
    rig
}

/// When frames were sent, in µs after an instant.
fn times(rig: &mut Rig, start: Instant) -> Vec<u64> {
    let sent = rig.take_timed();
    assert!(sent.iter().all(|(_, frame)| frame.to_string().starts_with("181:")), "{sent:?}");
    sent.iter().map(|(at, _)| at.as_micros() - start.as_micros()).collect()
}

#[test]
fn a_fixed_grid_from_entering_operational() {
    for kind in [254, 255] {
        let mut rig = cyclic(1, 0);
        assert_eq!(rig.write(0x1800, 2, 1, kind), Ok(()));
        rig.silent_for(10);
        rig.advance_by(Duration::from_micros(333));
        let start = rig.now();
        rig.exchange("000: 01 00", &[]);
        rig.advance(1_000);
        let expected: Vec<u64> = (1..=1_000).map(|period| period * 1_000).collect();
        assert_eq!(times(&mut rig, start), expected);
    }
}

#[test]
fn the_longest_period() {
    let mut rig = cyclic(0xFFFF, 0);
    let start = rig.now();
    rig.exchange("000: 01 00", &[]);
    rig.advance(131_070);
    assert_eq!(times(&mut rig, start), [65_535_000, 131_070_000]);
}

#[test]
fn leaving_operational_ends_it() {
    for (command, operational) in [("000: 80 00", false), ("000: 02 00", false), ("000: 01 00", true)] {
        let mut rig = cyclic(10, 0);
        let start = rig.now();
        rig.exchange("000: 01 00", &[]);
        rig.advance(15);
        rig.send(command);
        rig.advance(20);
        let expected: &[u64] = if operational { &[10_000, 20_000, 30_000] } else { &[10_000] };
        assert_eq!(times(&mut rig, start), expected, "{command}");
    }
}

#[test]
fn a_write_of_type_or_timer_begins_a_new_grid_and_so_does_switching_on() {
    for (sub, size, values) in [(2, 1, &[255][..]), (5, 2, &[10]), (1, 4, &[0x8000_0181, 0x181])] {
        let mut rig = cyclic(10, 0);
        rig.exchange("000: 01 00", &[]);
        rig.advance(13);
        rig.take();
        for value in values {
            assert_eq!(rig.write(0x1800, sub, size, *value), Ok(()));
        }
        let start = rig.now();
        rig.advance(25);
        assert_eq!(times(&mut rig, start), [10_000, 20_000], "1800:{sub}");
    }
}

#[test]
fn a_cob_id_that_is_written_again_switches_nothing_on() {
    for cob_id in [0x181, 0x4000_0181] {
        let mut rig = cyclic(10, 0);
        let start = rig.now();
        rig.exchange("000: 01 00", &[]);
        rig.advance(13);
        rig.take();
        assert_eq!(rig.write(0x1800, 1, 4, cob_id), Ok(()));
        rig.advance(20);
        assert_eq!(times(&mut rig, start), [20_000, 30_000], "{cob_id:X}");
    }
}

#[test]
fn a_timer_of_0_and_synchronous_types_send_nothing_by_themselves() {
    let mut rig = cyclic(10, 0);
    rig.exchange("000: 01 00", &[]);
    for (sub, size, value) in [(2, 1, 1), (2, 1, 0), (2, 1, 254), (5, 2, 0)] {
        assert_eq!(rig.write(0x1800, sub, size, value), Ok(()));
        rig.silent_for(9);
    }
    rig.silent_for(1_000);
    rig.exchange("080:", &[]);
}

#[test]
fn the_position_is_that_of_the_due_instant() {
    let mut rig = cyclic(1, 0);
    // A step in 1/16 ms.
    let shaft = Shaft { speed_rpm: 60_000 / 1_024, since: rig.now(), ..Shaft::at(0) };
    rig.sense_hat(|inputs| inputs.product = ProductInputs::Encoder(shaft));
    rig.exchange("000: 01 00", &[]);
    for _ in 0..50 {
        let due = rig.now() + Duration::from_millis(1);
        // Polled late.
        rig.leap(Duration::from_micros(1_300));
        let expected = shaft.position_at(due).to_le_bytes();
        assert_eq!(rig.take_next().unwrap().data(), expected);
        rig.leap(Duration::from_micros(700));
        rig.take();
    }
}

#[test]
fn missed_periods_merge_on_a_blocked_bus() {
    let mut rig = cyclic(1, 0);
    let start = rig.now();
    let shaft = Shaft { speed_rpm: 60, since: start, ..Shaft::at(0) };
    rig.sense_hat(|inputs| inputs.product = ProductInputs::Encoder(shaft));
    rig.exchange("000: 01 00", &[]);
    rig.hold_bus(true);
    rig.advance_by(Duration::from_micros(50_400));
    assert_eq!(rig.pending(), 1);
    rig.hold_bus(false);
    let sent = rig.take_timed();
    assert_eq!(sent.len(), 1);
    let newest = shaft.position_at(start + Duration::from_millis(50)).to_le_bytes();
    assert_eq!(sent[0].1.data(), newest);
    rig.advance(2);
    assert_eq!(times(&mut rig, start), [51_000, 52_000], "the grid stays");
}

#[test]
fn the_inhibit_time_counts_from_the_last_request() {
    // 2.5 ms: what falls into it merges at its end.
    let mut rig = cyclic(1, 25);
    let start = rig.now();
    rig.exchange("000: 01 00", &[]);
    rig.advance(10);
    assert_eq!(times(&mut rig, start), [1_000, 3_500, 6_000, 8_500]);
}

#[test]
fn an_inhibit_time_that_is_written_again_runs_on() {
    // 100 ms
    let mut rig = cyclic(10, 1_000);
    let start = rig.now();
    rig.exchange("000: 01 00", &[]);
    rig.advance(25);
    assert_eq!(times(&mut rig, start), [10_000]);
    assert_eq!(rig.write(0x1800, 3, 2, 1_000), Ok(()));
    rig.advance(200);
    assert_eq!(times(&mut rig, start), [110_000, 210_000]);
}

#[test]
fn a_request_that_waits_for_the_inhibit_time_ends_with_its_grid() {
    for (sub, size, value) in [(5, 2, 0), (2, 1, 1)] {
        let mut rig = cyclic(10, 1_000);
        let start = rig.now();
        rig.exchange("000: 01 00", &[]);
        rig.advance(25);
        assert_eq!(times(&mut rig, start), [10_000], "that of 20 ms waits");
        assert_eq!(rig.write(0x1800, sub, size, value), Ok(()));
        rig.silent_for(200);
    }
}

#[test]
fn an_inhibit_time_is_for_the_event_timer_alone() {
    let mut rig = cyclic(0, 10_000);
    assert_eq!(rig.write(0x1800, 2, 1, 1), Ok(()));
    rig.exchange("000: 01 00", &[]);
    for _ in 0..5 {
        rig.exchange("080:", &["181: 00 00 00 00"]);
    }
}

#[test]
fn an_emcy_goes_before_the_pdo_of_the_same_instant() {
    let mut rig = cyclic(10, 0);
    rig.write_all(&[(0x1014, 0, 4, 0x8000_0081), (0x1014, 0, 4, 0x3FFF_FFFF), (0x1029, 2, 1, 1)]);
    rig.exchange("000: 01 00", &[]);
    rig.hold_bus(true);
    rig.sense_hat(|inputs| inputs.internal_fault = true);
    rig.advance(10);
    rig.free_bus_sends(&["1FFFFFFF: 00 FF 81 02 00 00 00 00", "181: 00 00 00 00"]);
}
