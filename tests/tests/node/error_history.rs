//! The error history, object 0x1003, and the EMCYs that are entered and not sent (SPEC 4.1, 4.2, 9).

use protocol_core::controller::BusErrorMode::{BusOff, ErrorActive};
use tests::Rig;
use tests::nmt::{ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, START, STOP};

use super::kinds::{Kind, each_kind};

const NO_DATA: u32 = 0x0800_0024;

/// The entry of an internal fault that occurs for this time: a valve's has the count, a sensor's the cause.
fn entry(kind: &Kind, count: u32) -> u32 {
    let (_, first) = kind.rules.internal_fault;
    if kind.is_sensor() { first } else { first & 0xFFFF | count << 16 }
}

/// An internal fault comes and goes.
fn internal(node: &mut Rig) {
    node.internal_fault_comes_and_goes();
    node.take();
}

/// The bus is off, and back; the entry of that.
fn bus_off(kind: &Kind, node: &mut Rig) -> u32 {
    node.sense_hat(|inputs| inputs.bus = BusOff);
    node.sense_hat(|inputs| inputs.bus = ErrorActive);
    node.take();
    if kind.is_sensor() { 0x0004_8140 } else { 0x0001_8140 }
}

/// The history is exactly this, newest first.
#[track_caller]
fn assert_history(node: &mut Rig, expected: &[u32]) {
    assert_eq!(node.read(0x1003, 0) as usize, expected.len());
    for (sub, error) in (1..).zip(expected) {
        assert_eq!(node.read(0x1003, sub), *error, "{sub}");
    }
    for sub in expected.len() as u8 + 1..=8 {
        assert_eq!(node.read_abort(0x1003, sub), NO_DATA, "{sub}");
    }
}

#[test]
fn newest_first_and_eight_deep() {
    each_kind(|kind| {
        let mut node = kind.booted();
        assert_history(&mut node, &[]);
        internal(&mut node);
        let mut expected = vec![bus_off(kind, &mut node), entry(kind, 1)];
        assert_history(&mut node, &expected);
        for count in 2..=20 {
            internal(&mut node);
            expected.insert(0, entry(kind, count));
            expected.truncate(8);
            assert_history(&mut node, &expected);
        }
    });
}

#[test]
fn it_survives_reset_communication_alone() {
    each_kind(|kind| {
        let mut node = kind.booted();
        internal(&mut node);
        let expected = [bus_off(kind, &mut node), entry(kind, 1)];
        node.save(1);
        kind.boots(&mut node, RESET_COMMUNICATION, kind.node_id);
        assert_history(&mut node, &expected);
        kind.boots(&mut node, RESET_NODE, kind.node_id);
        assert_history(&mut node, &[]);
        internal(&mut node);
        kind.starts(&mut node, kind.node_id);
        assert_history(&mut node, &[]);
    });
}

/// An EMCY that falls due in stopped, or was still in the controller then, is entered and not sent later; nor is its end.
#[test]
fn emcys_of_stopped_are_not_sent_later() {
    each_kind(|kind| {
        for leave in [START, ENTER_PRE_OPERATIONAL] {
            for stopped_before in [true, false] {
                let mut node = kind.booted();
                node.hold_bus(true);
                if stopped_before {
                    node.send(STOP);
                }
                node.internal_fault_comes_and_goes();
                if !stopped_before {
                    node.send(STOP);
                }
                node.hold_bus(false);
                node.silent_for(1000);
                node.exchange(leave, &[]);
                node.silent_for(1000);
                assert_history(&mut node, &[entry(kind, 1)]);
            }
        }
    });
}
