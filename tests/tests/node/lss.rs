//! LSS (SPEC 4.4, 9): every service in every LSS and NMT state, and what each comes to.

use protocol_core::controller::BitRate;
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::lss::{IDENTIFY_NON_CONFIGURED, NON_CONFIGURED, STORE, STORED, TO_CONFIGURATION, TO_WAITING, answer};
use tests::nmt::{ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION, RESET_NODE, RESETS, START, STOP};
use tests::{Rig, sdo};

use super::kinds::{Kind, each_kind, emcy};

/// The index of a bit rate that is no kind's default.
const KBIT_125: u8 = 4;

const STATES: [Nmt; 4] = [Nmt::PreOperational, Nmt::Stopped, Nmt::Operational, Nmt::NoNodeId];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Nmt {
    PreOperational,
    Stopped,
    Operational,
    NoNodeId,
}

fn node_in(kind: &Kind, nmt: Nmt) -> Rig {
    let mut node = if nmt == Nmt::NoNodeId { kind.blank() } else { kind.booted() };
    match nmt {
        Nmt::Stopped => node.send(STOP),
        Nmt::Operational => node.send(START),
        Nmt::PreOperational | Nmt::NoNodeId => {}
    }
    node.expect_nothing();
    node
}

/// The four requests of switch selective.
fn select(kind: &Kind) -> [String; 4] {
    let [vendor, product, revision, serial] = kind.identity_bytes();
    [format!("40 {vendor}"), format!("41 {product}"), format!("42 {revision}"), format!("43 {serial}")]
}

/// The services: request, answer in configuration with and without a node ID.
fn services(kind: &Kind) -> Vec<(String, Option<String>, Option<String>)> {
    let rules = kind.rules;
    let refused = rules.refused_node_id;
    let scan = (rules.scanned_in == TO_CONFIGURATION).then_some("4F");
    let taken_away = if rules.node_id_can_go { "11" } else { refused };
    let in_force = format!("5E {:02X}", kind.node_id);
    let index_1 = if kind.bit_rates.iter().any(|(index, _)| *index == 1) { "13" } else { "13 01" };
    let other = [
        ("04 00", None, None),
        ("04 01", None, None),
        ("04 02", None, None),
        ("04 FF", None, None),
        ("11 17", Some("11"), Some("11")),
        ("11 00", Some(refused), Some(refused)),
        ("11 80", Some(refused), Some(refused)),
        ("11 FF", Some(taken_away), Some(taken_away)),
        ("13 00 02", Some("13"), Some("13")),
        ("13 00 01", Some(index_1), Some(index_1)),
        ("13 01 02", Some("13 01"), Some("13 01")),
        ("15 00 00", None, None),
        ("17", Some("17"), Some("17")),
        ("5E", Some(&*in_force), Some("5E FF")),
        ("4C", None, Some("50")),
        ("51 00 00 00 00 80 00 00", None, scan),
        // what is a slave's own, what comes alone, and what nobody knows
        ("44", None, None),
        ("4F", None, None),
        ("50", None, None),
        ("46 19 00 00 01", None, None),
        ("00", None, None),
        ("FF", None, None),
    ];
    let owned = |bytes: Option<&str>| bytes.map(str::to_owned);
    let other = other.map(|(request, with, without)| (request.to_owned(), owned(with), owned(without)));
    let select = select(kind).map(|request| (request, None, None));
    let inquire = |(command, number)| {
        let answer = Some(format!("{command:X} {number}"));
        (format!("{command:X}"), answer.clone(), answer)
    };
    other.into_iter().chain(select).chain((0x5A..).zip(kind.identity_bytes()).map(inquire)).collect()
}

#[test]
fn every_service_in_every_lss_and_nmt_state() {
    each_kind(|kind| {
        for (request, with_node_id, without) in services(kind) {
            for nmt in STATES {
                for configuration in [false, true] {
                    let mut node = node_in(kind, nmt);
                    if configuration {
                        node.exchange(TO_CONFIGURATION, &[]);
                    }
                    let in_waiting =
                        kind.rules.answered_in_waiting.iter().find(|allowed| request.starts_with(**allowed));
                    let expected = match nmt {
                        Nmt::Operational => None,
                        Nmt::NoNodeId if configuration => without.as_deref(),
                        Nmt::NoNodeId => in_waiting.map(|allowed| if *allowed == "4C" { "50" } else { "4F" }),
                        Nmt::PreOperational | Nmt::Stopped => with_node_id.as_deref().filter(|_| configuration),
                    };
                    node.lss(&request, expected);
                    let stays = match request.as_str() {
                        "04 00" => false,
                        "04 01" => true,
                        _ => configuration,
                    };
                    let what = format!("{request}, {nmt:?}, configuration: {configuration}");
                    assert_eq!(node.is_configuring(), stays && nmt != Nmt::Operational, "{what}");
                }
            }
        }
    });
}

#[test]
fn other_lengths_and_remote_frames_are_ignored() {
    each_kind(|kind| {
        for request in [
            "7E5: 5E",
            "7E5: 5E 00 00 00 00 00 00",
            "7E5:",
            "7E5: R8",
            "7E4: 5E 00 00 00 00 00 00 00",
            "000007E5: 5E 00 00 00 00 00 00 00",
        ] {
            kind.configuring().exchange(request, &[]);
        }
    });
}

/// What is sent to a node in waiting, by number of the part, `x` for another number; whether it is selected at the end.
const SELECTIONS: [(&str, bool); 20] = [
    ("0 1 2 3", true),
    ("0 1 2", false),
    ("1 2 3", false),
    ("0 1 3", false),
    ("0 2 1 3", false),
    ("3 2 1 0", false),
    ("x0 1 2 3", false),
    ("0 x1 2 3", false),
    ("0 1 x2 3", false),
    ("0 1 2 x3", false),
    // a mismatch starts over
    ("0 1 2 x3 3", false),
    ("0 1 x2 2 3", false),
    ("0 x1 0 1 2 3", true),
    ("x0 0 1 2 3", true),
    ("0 1 2 x3 0 1 2 3", true),
    ("0 1 0 1 2 3", true),
    ("0 0 1 2 3", true),
    ("0 1 1 2 3", false),
    // another slave is selected meanwhile
    ("0 x0 1 2 3", false),
    ("0 1 2 x0 x1 x2 x3 3", false),
];

#[test]
fn switch_selective() {
    each_kind(|kind| {
        let select = select(kind);
        for (selection, selected) in SELECTIONS {
            for nmt in STATES {
                let mut node = node_in(kind, nmt);
                let selected = selected && nmt != Nmt::Operational;
                let steps: Vec<&str> = selection.split(' ').collect();
                for (position, step) in steps.iter().enumerate() {
                    let part: usize = step.trim_start_matches('x').parse().unwrap();
                    let other = format!("{} FF FF FF FF", &select[part][..2]);
                    let last = position + 1 == steps.len();
                    let request = if step.starts_with('x') { &other } else { &select[part] };
                    node.lss(request, (last && selected).then_some("44"));
                }
                assert_eq!(node.is_configuring(), selected, "{selection}, {nmt:?}");
            }
        }
    });
}

/// Leaving to waiting and NMT start forget how far a selection has come; requests that waiting does not allow, and other
/// services do not.
#[test]
fn what_comes_between_a_switch_selective() {
    each_kind(|kind| {
        let select = select(kind);
        for (between, selected) in [
            (&[TO_WAITING][..], false),
            (&[START, ENTER_PRE_OPERATIONAL], false),
            (&[STORE], true),
            (&["7E5: 5A 00 00 00 00 00 00 00"], true),
        ] {
            let mut node = kind.booted();
            node.lss(&select[0], None);
            node.lss(&select[1], None);
            between.iter().for_each(|request| node.exchange(request, &[]));
            assert_eq!(node.read(0x1018, 4), kind.identity[3]);
            node.lss(&select[2], None);
            node.lss(&select[3], selected.then_some("44"));
        }
    });
}

#[test]
fn the_node_ids_that_are_taken() {
    each_kind(|kind| {
        for node_id in 0..=255_u8 {
            let mut node = kind.configuring();
            let gone = kind.rules.node_id_can_go && node_id == 255;
            let valid = (1..=127).contains(&node_id);
            let expected = if valid || gone { "11" } else { kind.rules.refused_node_id };
            node.lss(&format!("11 {node_id:02X}"), Some(expected));
            node.lss("5E", Some(&format!("5E {:02X}", kind.node_id)));
            node.exchange(STORE, &[STORED]);
            node.power_cycle();
            assert_eq!(node.node_id(), (!gone).then_some(if valid { node_id } else { kind.node_id }));
        }
    });
}

#[test]
fn a_refused_node_id_leaves_the_pending_one_alone() {
    each_kind(|kind| {
        let mut node = kind.configuring();
        node.configure_node_id(0x17);
        node.lss("11 80", Some(kind.rules.refused_node_id));
        kind.boots(&mut node, kind.rules.into_force[0], 0x17);
    });
}

/// What is not stored is held until power-off, resets included.
#[test]
fn a_node_id_that_is_not_stored_is_held_until_power_off() {
    each_kind(|kind| {
        for into_force in kind.rules.into_force {
            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            kind.boots(&mut node, into_force, 0x17);
            for reset in [RESETS, RESETS].concat() {
                kind.boots(&mut node, reset, 0x17);
            }
            kind.starts(&mut node, kind.node_id);
        }
    });
}

/// And one that is stored stays, whether it was stored while pending or in force.
#[test]
fn a_node_id_that_is_stored_stays() {
    each_kind(|kind| {
        for into_force in kind.rules.into_force {
            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            node.exchange(STORE, &[STORED]);
            kind.boots(&mut node, into_force, 0x17);
            kind.starts(&mut node, 0x17);

            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            kind.boots(&mut node, into_force, 0x17);
            node.exchange(TO_CONFIGURATION, &[]);
            node.exchange(STORE, &[STORED]);
            kind.starts(&mut node, 0x17);
        }
    });
}

/// Stored, but configuration never left: in force after the next reset, communication included.
#[test]
fn which_resets_take_a_node_id_over() {
    each_kind(|kind| {
        for reset in RESETS {
            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            node.exchange(STORE, &[STORED]);
            kind.boots(&mut node, reset, 0x17);
        }
        // Pending and not stored: reset node drops it for good.
        for (reset, node_id) in [(RESET_NODE, kind.node_id), (RESET_COMMUNICATION, 0x17)] {
            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            assert_eq!(node.node_id(), Some(kind.node_id));
            kind.boots(&mut node, reset, node_id);
            assert!(!node.is_configuring());
            kind.boots(&mut node, RESET_COMMUNICATION, node_id);
        }
    });
}

#[test]
fn start_leaves_configuration() {
    each_kind(|kind| {
        let dropped = kind.rules.start_drops_what_is_pending;
        let started = || {
            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            node.configure_bit_rate(KBIT_125);
            node.silent_to(&[START, ENTER_PRE_OPERATIONAL]);
            assert!(!node.is_configuring());
            node
        };
        let node_id = if dropped { kind.node_id } else { 0x17 };
        kind.boots(&mut started(), RESET_COMMUNICATION, node_id);
        let mut node = started();
        for (request, answers) in [(TO_CONFIGURATION, &[][..]), (STORE, &[STORED])] {
            node.exchange(request, answers);
        }
        kind.starts(&mut node, node_id);
        assert_eq!(node.device().bit_rate(), if dropped { kind.bit_rate } else { BitRate::Kbit125 });
    });
}

/// The master is answered in operational too, once, and what it asked for is stored.
#[test]
fn a_store_that_start_comes_into() {
    each_kind(|kind| {
        for memory_is_busy in [false, true] {
            let mut node = kind.configuring();
            node.write_time = Duration::from_millis(30);
            node.configure_node_id(0x17);
            node.configure_bit_rate(KBIT_125);
            if memory_is_busy {
                node.exchange(&sdo::write(kind.node_id, 0x1010, 1, b"save"), &[]);
            }
            node.silent_to(&[STORE, START]);
            node.advance(100);
            let sent = node.take();
            assert_eq!(sent.iter().filter(|frame| *frame == STORED).count(), 1, "{sent:?}");
            kind.starts(&mut node, 0x17);
            assert_eq!(node.device().bit_rate(), BitRate::Kbit125, "busy: {memory_is_busy}");
        }
    });
}

/// Nor does another store, of what was configured since, take the place of one that start came into.
#[test]
fn a_second_store_behind_one_that_start_comes_into() {
    each_kind(|kind| {
        let mut node = kind.configuring();
        node.write_time = Duration::from_millis(30);
        node.silent_to(&[&sdo::write(kind.node_id, 0x1010, 1, b"save")]);
        node.configure_node_id(0x17);
        node.silent_to(&[STORE, START, ENTER_PRE_OPERATIONAL, TO_CONFIGURATION]);
        node.configure_bit_rate(KBIT_125);
        node.silent_to(&[STORE]);
        node.advance(200);
        node.take();
        kind.starts(&mut node, 0x17);
        assert_eq!(node.device().bit_rate(), BitRate::Kbit125);
    });
}

/// A number that is configured after the store was asked for is not part of it.
#[test]
fn a_store_stores_what_was_configured_when_it_was_asked_for() {
    each_kind(|kind| {
        let mut node = kind.configuring();
        node.write_time = Duration::from_millis(30);
        node.configure_node_id(0x17);
        node.silent_to(&[&sdo::write(kind.node_id, 0x1010, 1, b"save"), STORE]);
        node.configure_node_id(0x18);
        node.advance(100);
        node.take();
        kind.starts(&mut node, 0x17);
    });
}

#[test]
fn stop_and_pre_operational_leave_configuration_alone() {
    each_kind(|kind| {
        for order in [STOP, ENTER_PRE_OPERATIONAL] {
            let mut node = kind.configuring();
            node.configure_node_id(0x17);
            node.exchange(order, &[]);
            assert!(node.is_configuring());
            kind.boots(&mut node, kind.rules.into_force[0], 0x17);
        }
    });
}

#[test]
fn a_reset_leaves_configuration() {
    each_kind(|kind| {
        for reset in RESETS {
            let mut node = kind.configuring();
            kind.boots(&mut node, reset, kind.node_id);
            assert!(!node.is_configuring());
        }
    });
}

/// Answered when the memory holds the data, with an error when it fails; then some kinds tell that by EMCY too.
#[test]
fn store_is_answered_when_the_memory_holds_it() {
    each_kind(|kind| {
        let (failed, error) = kind.rules.store_failed;
        let told = |data| emcy(kind.node_id, data);
        let end = error.map(|_| told("00 00 00 00 00 00 00 00"));
        let mut node = kind.configuring();
        node.write_time = Duration::from_millis(30);
        node.configure_node_id(0x17);
        for (fails, emcy, answer) in
            [(false, None, STORED.to_owned()), (true, error.map(told), answer(failed)), (false, end, STORED.to_owned())]
        {
            node.writes_fail = fails;
            node.exchange(STORE, &[]);
            node.silent_for(29);
            node.advance(1);
            let mut sent = node.take();
            sent.sort();
            assert_eq!(sent, emcy.into_iter().chain([answer]).collect::<Vec<_>>());
            assert_eq!(node.read(0x1001, 0), u32::from(fails && error.is_some()));
        }
        assert_eq!(node.writes.last(), Some(&RecordKey::LocalLayer));
    });
}

#[test]
fn every_store_has_its_answer() {
    each_kind(|kind| {
        let mut node = kind.configuring();
        node.write_time = Duration::from_millis(10);
        node.configure_node_id(0x17);
        for _ in 0..3 {
            node.exchange(STORE, &[]);
        }
        node.advance(100);
        assert_eq!(node.take(), [STORED; 3]);
    });
}

/// A store of the one keeps what another has stored of the other, even when start has dropped it since.
#[test]
fn a_store_keeps_what_another_has_stored() {
    each_kind(|kind| {
        for rate_first in [false, true] {
            let mut node = kind.booted();
            for rate in [rate_first, !rate_first] {
                node.exchange(TO_CONFIGURATION, &[]);
                if rate {
                    node.configure_bit_rate(KBIT_125)
                } else {
                    node.configure_node_id(0x17)
                }
                node.exchange(STORE, &[STORED]);
                node.silent_to(&[START, ENTER_PRE_OPERATIONAL]);
            }
            kind.starts(&mut node, 0x17);
            assert_eq!(node.device().bit_rate(), BitRate::Kbit125);
        }
    });
}

mod without_a_node_id {
    use super::*;

    #[test]
    fn it_gets_one_and_boots() {
        each_kind(|kind| {
            let mut node = kind.blank();
            node.exchange(IDENTIFY_NON_CONFIGURED, if kind.rules.scan_selects { &[NON_CONFIGURED] } else { &[] });
            node.exchange(TO_CONFIGURATION, &[]);
            node.configure_node_id(0x17);
            node.exchange(STORE, &[STORED]);
            kind.boots(&mut node, TO_WAITING, 0x17);
            assert_eq!(node.read(0x1014, 0), 0x97);
            assert_eq!(node.read(0x1800, 1) & 0x7FF, 0x197);
            kind.starts(&mut node, 0x17);
        });
    }

    /// A pending node ID counts as configured.
    #[test]
    fn identify_only_while_none_is_pending() {
        each_kind(|kind| {
            let mut node = kind.blank();
            node.exchange(TO_CONFIGURATION, &[]);
            node.exchange(IDENTIFY_NON_CONFIGURED, &[NON_CONFIGURED]);
            node.configure_node_id(0x17);
            node.exchange(IDENTIFY_NON_CONFIGURED, &[]);
            node.lss("51 00 00 00 00 80", None);
            node.lss("5E", Some("5E FF"));
        });
    }

    #[test]
    fn leaving_without_one_changes_nothing() {
        each_kind(|kind| {
            let mut node = kind.blank();
            node.exchange(TO_CONFIGURATION, &[]);
            node.exchange(STORE, &[STORED]);
            node.exchange(TO_WAITING, &[]);
            assert_eq!(node.node_id(), None);
            node.power_cycle();
            node.expect_nothing();
        });
    }
}
