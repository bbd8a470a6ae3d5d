//! Heartbeat producer, and the boot-up that counts as its first (SPEC 4.1 row 0x1017, 4.2, 9).

use protocol_core::controller::BusErrorMode::{BusOff, ErrorActive};
use protocol_core::time::Duration;
use tests::nmt::{RESETS, heartbeat};
use tests::{Rig, sdo};

use super::kinds::{Kind, each_kind};

/// The heartbeat of a node in pre-operational.
fn beat(kind: &Kind) -> String {
    heartbeat(kind.node_id, 0x7F)
}

/// The write of a time is followed by a heartbeat at once.
#[track_caller]
fn set(kind: &Kind, node: &mut Rig, ms: u32) {
    node.write_all(&[(0x1017, 0, 2, ms)]);
    node.expect_all(&[beat(kind)]);
}

fn beating(kind: &Kind, ms: u32) -> Rig {
    let mut node = kind.booted();
    set(kind, &mut node, ms);
    node
}

#[test]
fn off_by_default() {
    each_kind(|kind| kind.booted().silent_for(100_000));
}

#[test]
fn the_period_is_that_of_the_kind_and_reads_back_as_written() {
    each_kind(|kind| {
        let step = kind.rules.heartbeat_step_ms;
        for written in [1, 7, 9, 10, 11, 99, 105, 1000, 1001, 0x7FFF, kind.rules.heartbeat_max_ms] {
            let mut node = beating(kind, written);
            for _ in 0..3 {
                node.silent_until(u64::from(written).next_multiple_of(step), &[beat(kind)]);
            }
            assert_eq!(node.read(0x1017, 0), written);
        }
    });
}

#[test]
fn every_write_of_a_time_begins_at_once_and_0_ends_it() {
    each_kind(|kind| {
        let mut node = beating(kind, 100);
        for _ in 0..2 {
            node.advance(30);
            set(kind, &mut node, 50);
            node.silent_until(50, &[beat(kind)]);
        }
        // A time that is refused changes nothing.
        node.advance(20);
        if kind.rules.heartbeat_max_ms < 0xFFFF {
            assert_eq!(node.write(0x1017, 0, 2, kind.rules.heartbeat_max_ms + 1), Err(0x0609_0031));
        }
        node.silent_until(30, &[beat(kind)]);
        node.write_all(&[(0x1017, 0, 2, 0)]);
        node.silent_for(100_000);
    });
}

#[test]
fn it_tells_the_nmt_state_and_keeps_its_pace() {
    each_kind(|kind| {
        let (own, other) = (kind.node_id, kind.node_id + 1);
        let mut node = beating(kind, 100);
        for (command, to, state) in [
            (0x01, 0, 0x05),
            (0x02, 0, 0x04),
            (0x02, 0, 0x04),
            (0x80, 0, 0x7F),
            (0x01, own, 0x05),
            (0x80, own, 0x7F),
            (0x02, own, 0x04),
            (0x01, other, 0x04),
        ] {
            node.advance(60);
            node.exchange(&format!("000: {command:02X} {to:02X}"), &[]);
            node.silent_until(40, &[heartbeat(own, state)]);
        }
    });
}

#[test]
fn the_boot_up_counts_as_the_first() {
    each_kind(|kind| {
        let mut node = beating(kind, 200);
        node.save(1);
        for reset in RESETS {
            node.advance(70);
            kind.boots(&mut node, reset, kind.node_id);
            for _ in 0..3 {
                node.silent_until(200, &[beat(kind)]);
            }
            assert_eq!(node.read(0x1017, 0), 200);
        }
        node.advance(70);
        kind.starts(&mut node, kind.node_id);
        node.silent_until(200, &[beat(kind)]);
    });
}

/// After a pause one heartbeat goes out, whatever was missed; the pace is kept, or begins anew after a whole period.
#[test]
fn a_late_poll() {
    each_kind(|kind| {
        for (late, until_next) in [(30, 70), (99, 1), (100, 100), (250, 100)] {
            let mut node = beating(kind, 100);
            node.leap(Duration::from_millis(100 + late));
            node.expect_all(&[beat(kind)]);
            node.silent_until(until_next, &[beat(kind)]);
        }
    });
}

/// A node whose reset waits for the memory is no node of the bus any more.
#[test]
fn none_while_a_reset_waits() {
    each_kind(|kind| {
        let group = if kind.rules.reset_emcy { 1 } else { 2 };
        for reset in RESETS {
            let mut node = beating(kind, 100);
            node.write_time = Duration::from_secs(1);
            node.silent_to(&[&sdo::write(kind.node_id, 0x1010, group, b"save"), reset]);
            // What was saved is the time: it goes on from the boot-up.
            node.silent_until(1_000, &kind.boot(kind.node_id));
            node.silent_until(100, &[beat(kind)]);
        }
    });
}

#[test]
fn a_time_that_was_not_stored_is_gone_with_a_reset() {
    each_kind(|kind| {
        for reset in RESETS {
            let mut node = beating(kind, 100);
            kind.boots(&mut node, reset, kind.node_id);
            assert_eq!(node.read(0x1017, 0), 0);
            node.silent_for(10_000);
        }
    });
}

#[test]
fn what_falls_into_bus_off_is_not_sent_afterwards() {
    each_kind(|kind| {
        let mut node = beating(kind, 100);
        node.sense_hat(|inputs| inputs.bus = BusOff);
        node.advance(350);
        node.sense_hat(|inputs| inputs.bus = ErrorActive);
        let sent = node.take();
        assert!(!sent.contains(&beat(kind)), "{sent:?}");
        node.silent_until(50, &[beat(kind)]);
    });
}

/// No node guarding, and no consumer.
#[test]
fn nobody_is_guarded() {
    each_kind(|kind| {
        let own = 0x700 + u16::from(kind.node_id);
        let mut node = kind.booted();
        for request in ["R1", "R0", "R8", "05"] {
            node.exchange(&format!("{own:03X}: {request}"), &[]);
        }
        node.silent_to(&["721: 05", "702: 05", "703: 00"]);
        node.silent_for(10_000);
    });
}
