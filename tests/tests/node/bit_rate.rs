//! The bit rate (SPEC 4.4, 9): configured, activated, stored.

use protocol_core::controller::BitRate;
use protocol_core::time::Duration;
use tests::lss::{ACTIVATE, STORE, STORED, TO_CONFIGURATION, TO_WAITING, activate, answer};
use tests::nmt::{ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, RESETS, START, STOP, heartbeat};
use tests::{Rig, sdo};

use super::kinds::{Kind, each_kind, emcy};

/// A bit rate that is no kind's default, and its index.
const OTHER: (u8, BitRate) = (4, BitRate::Kbit125);

/// A node with another bit rate pending.
fn configured(kind: &Kind) -> Rig {
    let mut node = kind.configuring();
    node.configure_bit_rate(OTHER.0);
    node
}

#[test]
fn every_table_and_index() {
    each_kind(|kind| {
        for table in 0..=255_u8 {
            for index in (0..=255_u8).filter(|index| table <= 1 || *index <= 5) {
                let rate = kind.bit_rates.iter().find(|rate| (table, index) == (0, rate.0)).map(|rate| rate.1);
                let mut node = kind.configuring();
                node.lss(&format!("13 {table:02X} {index:02X}"), Some(if rate.is_some() { "13" } else { "13 01" }));
                node.exchange(ACTIVATE, &[]);
                assert_eq!(node.bit_rates(), [rate.unwrap_or(kind.bit_rate)], "{table} {index}");
            }
        }
    });
}

#[test]
fn each_can_be_stored() {
    each_kind(|kind| {
        for (index, rate) in kind.bit_rates {
            let mut node = kind.configuring();
            node.configure_bit_rate(*index);
            assert_eq!(node.bit_rates(), [], "not before it is activated");
            node.exchange(STORE, &[STORED]);
            kind.starts(&mut node, kind.node_id);
            assert_eq!(node.device().bit_rate(), *rate);
        }
    });
}

/// The delay runs twice: the rate changes after the first, and nothing is sent until the second has passed.
#[test]
fn the_two_delays() {
    each_kind(|kind| {
        let request = sdo::read(kind.node_id, 0x1018, 1);
        for delay in [1000, 1] {
            let mut node = configured(kind);
            node.exchange(&activate(delay), &[]);
            let step = Duration::from_micros(1);
            let delay = Duration::from_millis(delay.into());
            node.advance_by(delay - step);
            assert_eq!(node.bit_rates(), [], "{delay}");
            node.advance_by(step);
            assert_eq!((node.bit_rates(), node.device().bit_rate()), (&[OTHER.1][..], OTHER.1), "{delay}");
            node.advance_by(delay - step);
            node.exchange(&request, &[]);
            node.advance_by(step);
            node.expect_nothing();
            assert_eq!(node.read(0x1018, 1), kind.identity[0], "{delay}");
            assert_eq!(node.bit_rates().len(), 1);
        }
    });
}

/// Answers and heartbeats of the silence are lost; the heartbeat goes on in its rhythm.
#[test]
fn the_silence() {
    each_kind(|kind| {
        let mut node = configured(kind);
        node.write(0x1017, 0, 2, 100).unwrap();
        node.take();
        node.advance(50);
        node.exchange(&activate(250), &[]);
        let read = sdo::read(kind.node_id, 0x1000, 0);
        let uds = format!("1BC788{:02X}: 03 22 F0 10", kind.node_id);
        for frame in [&read, "7E5: 5E 00 00 00 00 00 00 00", STORE, ACTIVATE, TO_WAITING, &uds] {
            node.exchange(frame, &[]);
            node.advance(20);
        }
        node.silent_for(379);
        node.silent_for(1);
        node.advance(50);
        assert_eq!(node.take(), [heartbeat(kind.node_id, 0x7F)], "600 ms after the first");
        // The requests were not served later, and configuration was not left.
        node.lss("5E", Some(&format!("5E {:02X}", kind.node_id)));
    });
}

/// An EMCY waits for the end of the silence; but not beyond a stop: in stopped it cannot be sent, and later it is not.
#[test]
fn an_emcy_waits() {
    each_kind(|kind| {
        let (told, entry) = kind.rules.internal_fault;
        for stopped in [false, true] {
            let mut node = configured(kind);
            node.exchange(&activate(100), &[]);
            node.sense_hat(|inputs| inputs.internal_fault = true);
            if stopped {
                node.exchange(STOP, &[]);
            }
            node.silent_for(199);
            node.advance(1);
            if stopped {
                node.exchange(ENTER_PRE_OPERATIONAL, &[]);
            } else {
                assert_eq!(node.take(), [emcy(kind.node_id, told)]);
            }
            assert_eq!(node.read(0x1003, 1), entry);
        }
    });
}

/// Reset node in the first delay: the rate is not switched to, and the silence is kept all the same.
#[test]
fn reset_node_before_the_switch() {
    each_kind(|kind| {
        let mut node = configured(kind);
        node.exchange(&activate(100), &[]);
        node.advance(50);
        node.send(RESET_NODE);
        node.silent_for(149);
        node.advance_sends(1, &kind.boot(kind.node_id));
        assert_eq!(node.device().bit_rate(), kind.bit_rate);
        assert!(!node.bit_rates().contains(&OTHER.1), "{:?}", node.bit_rates());
    });
}

/// An answer that waits for the bus is not sent at the new rate.
#[test]
fn what_waits_for_the_bus_is_dropped() {
    each_kind(|kind| {
        let mut node = configured(kind);
        node.hold_bus(true);
        node.send_all(&[&sdo::read(kind.node_id, 0x1000, 0), ACTIVATE]);
        node.hold_bus(false);
        node.expect_nothing();
        assert_eq!(node.bit_rates(), [OTHER.1]);
    });
}

/// Without a configured rate the present one is switched to, and the silence is kept all the same.
#[test]
fn activated_without_being_configured() {
    each_kind(|kind| {
        let mut node = kind.configuring();
        node.exchange(&activate(100), &[]);
        node.advance(199);
        node.exchange(&sdo::read(kind.node_id, 0x1000, 0), &[]);
        node.advance(1);
        assert_eq!(node.bit_rates(), [kind.bit_rate]);
        assert_eq!(node.read(0x1018, 1), kind.identity[0]);
    });
}

/// Activated and not stored: gone at the next start, which a reset of the communication is not.
#[test]
fn activated_and_not_stored() {
    each_kind(|kind| {
        let mut node = configured(kind);
        node.exchange(ACTIVATE, &[]);
        kind.boots(&mut node, RESET_COMMUNICATION, kind.node_id);
        assert_eq!(node.device().bit_rate(), OTHER.1);
        kind.boots(&mut node, RESET_NODE, kind.node_id);
        assert_eq!(node.device().bit_rate(), kind.bit_rate);
        // A store after that knows nothing of it.
        node.exchange(TO_CONFIGURATION, &[]);
        node.exchange(STORE, &[STORED]);
        kind.starts(&mut node, kind.node_id);
        assert_eq!(node.device().bit_rate(), kind.bit_rate);
    });
}

/// Activated, tried in operational, then stored.
#[test]
fn stored_after_it_was_tried() {
    each_kind(|kind| {
        let mut node = configured(kind);
        for order in [ACTIVATE, START, ENTER_PRE_OPERATIONAL, TO_CONFIGURATION] {
            node.exchange(order, &[]);
        }
        node.exchange(STORE, &[STORED]);
        for restart in 0..2 {
            if restart == 0 {
                node.send(RESET_NODE)
            } else {
                node.power_cycle()
            }
            assert_eq!(node.take(), kind.boot(kind.node_id));
            assert_eq!(node.device().bit_rate(), OTHER.1);
        }
    });
}

/// Stored and not activated: in force at the next start, which a reset of the communication is not.
#[test]
fn stored_and_not_activated() {
    each_kind(|kind| {
        let mut node = configured(kind);
        node.exchange(STORE, &[STORED]);
        node.exchange(TO_WAITING, &[]);
        assert_eq!((node.device().bit_rate(), node.bit_rates()), (kind.bit_rate, &[][..]));
        kind.boots(&mut node, RESET_COMMUNICATION, kind.node_id);
        assert_eq!(node.device().bit_rate(), kind.bit_rate);
        kind.boots(&mut node, RESET_NODE, kind.node_id);
        assert_eq!(node.device().bit_rate(), OTHER.1);
    });
}

#[test]
fn pending_and_neither_is_dropped() {
    each_kind(|kind| {
        for reset in RESETS {
            let mut node = configured(kind);
            kind.boots(&mut node, reset, kind.node_id);
            node.silent_to(&[TO_CONFIGURATION, ACTIVATE]);
            assert_eq!(node.bit_rates(), [kind.bit_rate], "{reset}");
            node.exchange(STORE, &[&answer("17")]);
            kind.starts(&mut node, kind.node_id);
            assert_eq!(node.device().bit_rate(), kind.bit_rate, "{reset}");
        }
    });
}

#[test]
fn without_a_node_id() {
    each_kind(|kind| {
        let mut node = kind.blank();
        node.exchange(TO_CONFIGURATION, &[]);
        node.configure_bit_rate(OTHER.0);
        node.exchange(ACTIVATE, &[]);
        node.exchange(STORE, &[STORED]);
        node.power_cycle();
        assert_eq!((node.device().bit_rate(), node.node_id()), (OTHER.1, None));
    });
}
