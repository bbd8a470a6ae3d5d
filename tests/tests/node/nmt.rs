//! NMT (SPEC 4.2, 9): boot-up, the five commands, and a node without a node ID.

use protocol_core::device::Setup;
use protocol_core::time::Duration;
use tests::nmt::{ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION, RESETS, START, STOP, heartbeat};
use tests::{Rig, sdo};

use super::kinds::{Kind, each_kind};

const OPERATIONAL: u8 = 0x05;
const STOPPED: u8 = 0x04;
const PRE_OPERATIONAL: u8 = 0x7F;

/// A node with a heartbeat every 100 ms, the first of which is taken.
fn beating(kind: &Kind) -> Rig {
    let mut node = kind.booted();
    node.write_all(&[(0x1017, 0, 2, 100)]);
    node.expect_all(&[heartbeat(kind.node_id, PRE_OPERATIONAL)]);
    node
}

#[test]
fn boots_into_pre_operational_and_obeys_all_five_commands() {
    each_kind(|kind| {
        let id = kind.node_id;
        for to in [0, id] {
            let order = |command: u8| format!("000: {command:02X} {to:02X}");
            let mut node = beating(kind);
            for (command, state) in [(0x01, OPERATIONAL), (0x02, STOPPED), (0x80, PRE_OPERATIONAL), (0x02, STOPPED)] {
                node.exchange(&order(command), &[]);
                node.silent_until(100, &[heartbeat(id, state)]);
            }
            for reset in [0x81, 0x82] {
                kind.boots(&mut node, &order(reset), id);
                node.write_all(&[(0x1017, 0, 2, 100)]);
                node.expect_all(&[heartbeat(id, PRE_OPERATIONAL)]);
            }
        }
    });
}

#[test]
fn orders_for_others_and_what_is_none() {
    each_kind(|kind| {
        let id = kind.node_id;
        let other = format!("000: 81 {:02X}", id + 1);
        let high = format!("000: 81 {:02X}", id | 0x80);
        let orders = ["000: 81 80", "000: 83 00", "000: 00 00", "000: 81", "000: 81 00 00", "000: R2", &other, &high];
        for order in orders {
            let mut node = beating(kind);
            node.exchange(START, &[]);
            node.exchange(order, &[]);
            node.silent_until(100, &[heartbeat(id, OPERATIONAL)]);
        }
    });
}

/// An answer that waits for the bus goes out before the device restarts.
#[test]
fn a_reset_does_not_swallow_an_answer() {
    each_kind(|kind| {
        for reset in RESETS {
            let mut node = kind.booted();
            let answer = node.sdo(0x40, 0x1000, 0, 0).to_string();
            node.hold_bus(true);
            node.send_all(&[&sdo::read(kind.node_id, 0x1000, 0), reset]);
            node.free_bus_sends(&[vec![answer], kind.boot(kind.node_id)].concat());
        }
    });
}

/// A wider reset replaces one that waits for the memory, and a narrower one does not: the history tells which it was.
#[test]
fn a_wider_reset_replaces_one_that_waits() {
    each_kind(|kind| {
        for (orders, entries) in [([RESETS[1], RESETS[1]], 1), ([RESETS[1], RESETS[0]], 0), ([RESETS[0], RESETS[1]], 0)]
        {
            let mut node = kind.booted();
            node.internal_fault_comes_and_goes();
            node.take();
            node.flush();
            node.write_time = Duration::from_millis(10);
            let group = if kind.rules.reset_emcy { 1 } else { 2 };
            node.send(&sdo::write(kind.node_id, 0x1010, group, b"save"));
            node.silent_to(&orders);
            node.advance_sends(10, &kind.boot(kind.node_id));
            assert_eq!(node.read(0x1003, 0), entries, "{orders:?}");
        }
    });
}

/// What waits for the bus tells the state as it is when it is sent.
#[test]
fn heartbeats_on_a_bus_that_blocks() {
    each_kind(|kind| {
        let id = kind.node_id;
        for later in [0, 99, 100, 350] {
            for (command, state) in [(START, OPERATIONAL), (STOP, STOPPED)] {
                let mut node = beating(kind);
                node.hold_bus(true);
                node.advance(100);
                node.send(command);
                node.advance(later);
                node.free_bus_sends(&[heartbeat(id, state)]);
            }
        }
        // One that was switched off is not sent.
        let mut node = beating(kind);
        node.hold_bus(true);
        node.advance(100);
        node.send(&sdo::write(id, 0x1017, 0, &[0, 0]));
        node.free_bus_sends(&[sdo::written(id, 0x1017, 0)]);
    });
}

/// A node without a node ID: NMT initialisation, LSS alone.
#[test]
fn without_a_node_id() {
    each_kind(|kind| {
        let mut node = kind.blank();
        for to in [0, 1, kind.node_id, 0x7F] {
            let (rpdo, uds) = (0x200 + u16::from(to), 0x1BC7_8800 + u32::from(to));
            node.silent_to(&[
                &sdo::read(to, 0x1000, 0),
                &format!("{rpdo:03X}: 0F 00 00 00"),
                &format!("{uds:08X}: 03 22 F0 10"),
            ]);
        }
        node.silent_to(&[
            START,
            RESETS[0],
            RESET_COMMUNICATION,
            STOP,
            ENTER_PRE_OPERATIONAL,
            "080:",
            "1BC788FF: 03 22 F0 10",
        ]);
        node.internal_fault_comes_and_goes();
        node.silent_for(10_000);
        node.power_cycle();
        node.expect_nothing();
        assert_eq!(node.node_id(), None, "and it stays so");
        node.lss("04 01", None);
        node.lss("5E", Some("5E FF"));
        assert_eq!(node.node_id(), None);
    });
}

/// A device of every node ID boots, answers and executes commands under its own identifiers.
#[test]
fn every_node_id() {
    each_kind(|kind| {
        for node_id in 1..=127_u8 {
            let mut node = Rig::power_on(Setup { node_id: Some(node_id), ..kind.setup });
            assert_eq!(node.take(), kind.boot(node_id));
            assert_eq!(node.read(0x1018, 1), kind.identity[0]);
            assert_eq!(node.read(0x1014, 0), 0x80 + u32::from(node_id));
            assert_eq!(node.read(0x1800, 1) & 0x7FF, 0x180 + u32::from(node_id));
            node.exchange(&format!("000: 01 {node_id:02X}"), &[]);
            if kind.rules.reset_emcy {
                let [rpdo, tpdo] = [0x200, 0x180].map(|function| function + u16::from(node_id));
                node.exchange(&format!("{rpdo:03X}: 01 00 00 00"), &[&format!("{tpdo:03X}: 09 00 00 00")]);
            }
            kind.boots(&mut node, &format!("000: 82 {node_id:02X}"), node_id);
        }
    });
}
