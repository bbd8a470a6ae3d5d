//! LSS: every service in every state, and the two pairs of node ID and bit rate (SPEC 9).

use protocol_core::controller::BitRate;
use protocol_core::device::hat::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;

use super::{INVALID, LOAD, SAVE, blank, booted, booted_as};

const TO_WAITING: &str = "7E5: 04 00 00 00 00 00 00 00";
const TO_CONFIGURATION: &str = "7E5: 04 01 00 00 00 00 00 00";
const STORE: &str = "7E5: 17 00 00 00 00 00 00 00";
const STORED: &str = "7E4: 17 00 00 00 00 00 00 00";

fn node_id(rig: &mut Rig, node_id: u8, error: u8) {
    let answer = format!("7E4: 11 {error:02X} 00 00 00 00 00 00");
    rig.exchange(&format!("7E5: 11 {node_id:02X} 00 00 00 00 00 00"), &[&answer]);
}

fn bit_rate(rig: &mut Rig, table: u8, index: u8, error: u8) {
    let answer = format!("7E4: 13 {error:02X} 00 00 00 00 00 00");
    rig.exchange(&format!("7E5: 13 {table:02X} {index:02X} 00 00 00 00 00"), &[&answer]);
}

/// In LSS configuration.
fn configuration() -> Rig {
    let mut rig = booted();
    rig.exchange(TO_CONFIGURATION, &[]);
    rig
}

/// The numbers of a new HAT 1000.
const SELECT: [&str; 4] = [
    "7E5: 40 DA 00 00 00 00 00 00",
    "7E5: 41 52 1D 0E 00 00 00 00",
    "7E5: 42 07 00 01 00 00 00 00",
    "7E5: 43 01 00 00 00 00 00 00",
];
const SELECTED: &str = "7E4: 44 00 00 00 00 00 00 00";

/// The six bounds around it.
const REMOTE: [&str; 6] = [
    "7E5: 46 DA 00 00 00 00 00 00",
    "7E5: 47 52 1D 0E 00 00 00 00",
    "7E5: 48 07 00 01 00 00 00 00",
    "7E5: 49 07 00 01 00 00 00 00",
    "7E5: 4A 01 00 00 00 00 00 00",
    "7E5: 4B 01 00 00 00 00 00 00",
];
const IDENTIFIED: &str = "7E4: 4F 00 00 00 00 00 00 00";

fn select(rig: &mut Rig, answered: bool) {
    let [first @ .., last] = SELECT;
    first.iter().for_each(|number| rig.exchange(number, &[]));
    rig.exchange(last, if answered { &[SELECTED] } else { &[] });
}

fn identify(rig: &mut Rig, bounds: [&str; 6]) -> bool {
    let [first @ .., last] = bounds;
    first.iter().for_each(|bound| rig.exchange(bound, &[]));
    rig.send(last);
    let sent = rig.take();
    assert!(sent.is_empty() || sent == [IDENTIFIED], "{sent:?}");
    !sent.is_empty()
}

#[test]
fn the_state_table() {
    // Request, answered in waiting, in configuration.
    for (request, waiting, configuring) in [
        ("7E5: 11 0C 00 00 00 00 00 00", false, true),
        ("7E5: 13 00 04 00 00 00 00 00", false, true),
        (STORE, false, true),
        ("7E5: 5A 00 00 00 00 00 00 00", false, true),
        ("7E5: 5B 00 00 00 00 00 00 00", false, true),
        ("7E5: 5C 00 00 00 00 00 00 00", false, true),
        ("7E5: 5D 00 00 00 00 00 00 00", false, true),
        ("7E5: 5E 00 00 00 00 00 00 00", false, true),
    ] {
        let mut rig = booted();
        rig.send(request);
        assert_eq!(!rig.take().is_empty(), waiting, "{request} in waiting");
        rig.exchange(TO_CONFIGURATION, &[]);
        rig.send(request);
        assert_eq!(!rig.take().is_empty(), configuring, "{request} in configuration");
    }
    // Activation has no answer: the rate tells.
    let mut rig = booted();
    rig.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    assert_eq!(rig.bit_rates(), []);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    assert_eq!(rig.bit_rates(), [BitRate::Kbit500]);
    select(&mut rig, false);
    assert!(identify(&mut rig, REMOTE));
    rig.exchange(TO_WAITING, &[]);
    assert!(identify(&mut rig, REMOTE));
    select(&mut rig, true);
    rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E 01 00 00 00 00 00 00"]);
    // Identify non-configured: in both, without a node ID.
    for switch in [TO_WAITING, TO_CONFIGURATION] {
        rig.exchange(switch, &[]);
        rig.exchange("7E5: 4C 00 00 00 00 00 00 00", &[]);
        let mut blank = blank();
        blank.exchange(switch, &[]);
        blank.exchange("7E5: 4C 00 00 00 00 00 00 00", &["7E4: 50 00 00 00 00 00 00 00"]);
        assert!(identify(&mut blank, REMOTE));
    }
}

#[test]
fn in_which_nmt_states() {
    let mut rig = configuration();
    rig.exchange("000: 02 00", &[]);
    rig.exchange(STORE, &[STORED]);
    rig.exchange("000: 80 00", &[]);
    rig.exchange(STORE, &[STORED]);
    rig.exchange("000: 01 00", &[]);
    for request in [STORE, TO_CONFIGURATION, REMOTE[0]] {
        rig.exchange(request, &[]);
    }
    rig.exchange("000: 80 00", &[]);
    rig.exchange(STORE, &[]);
    // What was begun before operational is not gone on with after it.
    for sequence in [&SELECT[..], &REMOTE] {
        let (begin, end) = sequence.split_at(2);
        begin.iter().for_each(|request| rig.exchange(request, &[]));
        rig.exchange("000: 01 00", &[]);
        rig.exchange("000: 80 00", &[]);
        end.iter().for_each(|request| rig.exchange(request, &[]));
    }
}

#[test]
fn inquiries() {
    let mut rig = configuration();
    for (request, answer) in
        [("5A", "DA 00 00 00"), ("5B", "52 1D 0E 00"), ("5C", "07 00 01 00"), ("5D", "01 00 00 00")]
    {
        rig.exchange(&format!("7E5: {request} 00 00 00 00 00 00 00"), &[&format!("7E4: {request} {answer} 00 00 00")]);
    }
    node_id(&mut rig, 12, 0);
    rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E 01 00 00 00 00 00 00"]);
    let mut rig = blank();
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E FF 00 00 00 00 00 00"]);
}

#[test]
fn identify_remote_slave_limits_are_inclusive_and_in_order() {
    let mut rig = booted_as(Setup { serial: Some(100), ..Setup::new(Kind::Hat1000) });
    let serials = |low, high| {
        let mut bounds = REMOTE.map(str::to_owned);
        bounds[4] = format!("7E5: 4A {low:02X} 00 00 00 00 00 00");
        bounds[5] = format!("7E5: 4B {high:02X} 00 00 00 00 00 00");
        bounds
    };
    for (low, high, inside) in [(100, 100, true), (99, 100, true), (100, 101, true), (101, 200, false), (0, 99, false)]
    {
        let bounds = serials(low, high);
        assert_eq!(identify(&mut rig, bounds.each_ref().map(String::as_str)), inside, "{low}–{high}");
    }
    let bounds = serials(0, 255);
    let bounds = bounds.each_ref().map(String::as_str);
    for wrong in ["7E5: 46 DB", "7E5: 47 53 1D 0E", "7E5: 48 08 00 01", "7E5: 49 06 00 01"] {
        let position = usize::from(wrong.as_bytes()[6] - b'6');
        let mut changed = bounds;
        let text = format!("{wrong}{}", " 00".repeat(8 - (wrong.len() - 5).div_ceil(3)));
        changed[position] = &text;
        assert!(!identify(&mut rig, changed), "{text}");
        assert!(identify(&mut rig, bounds));
    }
    for (one, other) in [(0, 1), (2, 3), (4, 5), (1, 4)] {
        let mut swapped = bounds;
        swapped.swap(one, other);
        assert!(!identify(&mut rig, swapped), "{one} and {other} swapped");
    }
    // Begun anew in the middle, and broken off by a switch to waiting.
    rig.exchange(bounds[0], &[]);
    rig.exchange(bounds[1], &[]);
    assert!(identify(&mut rig, bounds));
    let (begin, end) = bounds.split_at(2);
    begin.iter().for_each(|bound| rig.exchange(bound, &[]));
    rig.exchange(TO_WAITING, &[]);
    end.iter().for_each(|bound| rig.exchange(bound, &[]));
    // A bound left out.
    for left_out in 0..5 {
        for (position, bound) in bounds.iter().enumerate() {
            if position != left_out {
                rig.exchange(bound, &[]);
            }
        }
    }
}

#[test]
fn a_mismatch_of_switch_selective_starts_over() {
    let mut rig = booted();
    rig.exchange(SELECT[0], &[]);
    rig.exchange("7E5: 41 53 1D 0E 00 00 00 00", &[]);
    rig.exchange(SELECT[2], &[]);
    rig.exchange(SELECT[3], &[]);
    select(&mut rig, true);
}

#[test]
fn node_ids_that_are_taken() {
    let mut rig = configuration();
    for id in 0..=255 {
        node_id(&mut rig, id, if matches!(id, 1..=127 | 255) { 0 } else { 255 });
    }
}

#[test]
fn bit_rates_that_are_taken() {
    let mut rig = configuration();
    for index in 0..=255 {
        bit_rate(&mut rig, 0, index, u8::from(!matches!(index, 0..=4 | 6..=8)));
    }
    for table in [1, 128, 255] {
        bit_rate(&mut rig, table, 2, 1);
    }
}

#[test]
fn a_store_that_fails() {
    let mut rig = configuration();
    node_id(&mut rig, 12, 0);
    rig.writes_fail = true;
    rig.exchange(STORE, &["7E4: 17 FF 00 00 00 00 00 00"]);
    assert_eq!(rig.read(0x1001, 0), 0, "no error of the sensor");
    assert_eq!(rig.read(0x2001, 2), 1, "demanded is what is stored");
    rig.writes_fail = false;
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2001, 2), 12);
}

#[test]
fn a_pending_node_id_without_store() {
    // Reset communication takes it over, and it is held until power-off.
    let mut rig = configuration();
    node_id(&mut rig, 12, 0);
    rig.exchange(TO_WAITING, &[]);
    assert_eq!(rig.node_id(), Some(1), "no restart on 04 00");
    rig.exchange("000: 82 00", &["70C: 00"]);
    assert_eq!((rig.read(0x2001, 1), rig.read(0x2001, 2)), (12, 1), "the demanded one reads what is stored");
    rig.exchange("000: 82 00", &["70C: 00"]);
    rig.exchange("000: 81 00", &["70C: 00"]);
    rig.power_cycle();
    assert_eq!(rig.take(), ["701: 00"]);
    // Reset node drops it.
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 12, 0);
    rig.exchange("000: 81 00", &["701: 00"]);
    rig.exchange("000: 82 00", &["701: 00"]);
    // Operational does not.
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 12, 0);
    rig.exchange("000: 01 00", &[]);
    rig.exchange("000: 82 00", &["70C: 00"]);
    // Nor does a switch to waiting when it is stored: a device with a node ID waits for its reset.
    rig.power_cycle();
    assert_eq!(rig.take(), ["701: 00"]);
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 12, 0);
    rig.exchange(STORE, &[STORED]);
    rig.exchange(TO_WAITING, &[]);
    assert_eq!(rig.node_id(), Some(1));
    rig.exchange("000: 82 00", &["70C: 00"]);
}

#[test]
fn a_held_node_id_can_be_stored() {
    let mut rig = configuration();
    node_id(&mut rig, 12, 0);
    rig.exchange("000: 82 00", &["70C: 00"]);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2001, 2), 12);
    rig.power_cycle();
    assert_eq!(rig.take(), ["70C: 00"]);
}

#[test]
fn lss_store_stores_what_is_pending_and_updates_what_is_demanded() {
    let mut rig = configuration();
    assert_eq!(rig.write(0x2001, 2, 1, 5), Ok(()));
    assert_eq!(rig.write(0x2002, 2, 1, 3), Ok(()));
    node_id(&mut rig, 12, 0);
    rig.exchange(STORE, &[STORED]);
    assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (12, 3));
    rig.exchange("000: 81 00", &["70C: 00"]);
    assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (12, 2), "the rate was demanded, not stored");
}

#[test]
fn one_lss_store_keeps_what_another_has_stored() {
    for rate_first in [false, true] {
        let mut rig = configuration();
        if rate_first {
            bit_rate(&mut rig, 0, 4, 0);
            rig.exchange(STORE, &[STORED]);
        }
        node_id(&mut rig, 12, 0);
        rig.exchange(STORE, &[STORED]);
        if !rate_first {
            bit_rate(&mut rig, 0, 4, 0);
            rig.exchange(STORE, &[STORED]);
        }
        rig.power_cycle();
        assert_eq!(rig.take(), ["70C: 00"]);
        assert_eq!(rig.device().bit_rate(), BitRate::Kbit125);
    }
}

#[test]
fn lss_store_stores_what_is_pending_again_when_it_was_overwritten() {
    for (index, signature) in [(0x1010, SAVE), (0x1011, LOAD)] {
        let mut rig = configuration();
        node_id(&mut rig, 12, 0);
        bit_rate(&mut rig, 0, 4, 0);
        rig.exchange(STORE, &[STORED]);
        assert_eq!(rig.write(0x2001, 2, 1, 9), Ok(()));
        assert_eq!(rig.write(0x2002, 2, 1, 3), Ok(()));
        assert_eq!(rig.write(index, 4, 4, signature), Ok(()));
        rig.exchange(STORE, &[STORED]);
        assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (12, 4));
        rig.power_cycle();
        assert_eq!(rig.take(), ["70C: 00"], "{index:X}");
        assert_eq!(rig.device().bit_rate(), BitRate::Kbit125);
    }
}

/// In force and not pending any more: what is saved in its place counts.
#[test]
fn lss_store_does_not_store_what_is_held_when_it_was_overwritten() {
    let mut rig = configuration();
    node_id(&mut rig, 12, 0);
    bit_rate(&mut rig, 0, 4, 0);
    rig.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    rig.exchange("000: 82 00", &["70C: 00"]);
    for (object, value) in [("2F 01 20 02", "09"), ("2F 02 20 02", "03"), ("23 10 10 04", "73 61 76 65")] {
        let padding = " 00".repeat(4 - (value.len() + 1) / 3);
        let answer = format!("58C: 60{} 00 00 00 00", &object[2..]);
        rig.exchange(&format!("60C: {object} {value}{padding}"), &[&answer]);
    }
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    rig.power_cycle();
    assert_eq!(rig.take(), ["709: 00"]);
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit250);
}

#[test]
fn save_stores_the_demanded_pair() {
    let mut rig = booted();
    assert_eq!(rig.write(0x2001, 2, 1, 12), Ok(()));
    assert_eq!(rig.write(0x2002, 2, 1, 4), Ok(()));
    assert_eq!((rig.read(0x2001, 1), rig.read(0x2002, 1)), (1, 2), "in force as before");
    // Unsaved, it is lost.
    rig.exchange("000: 82 00", &["701: 00"]);
    assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (1, 2));
    assert_eq!(rig.write(0x2001, 2, 1, 12), Ok(()));
    assert_eq!(rig.write(0x2002, 2, 1, 4), Ok(()));
    assert_eq!(rig.write(0x1010, 4, 4, SAVE), Ok(()));
    assert_eq!(rig.node_id(), Some(1));
    rig.exchange("000: 82 00", &["70C: 00"]);
    assert_eq!((rig.device().bit_rate(), rig.read(0x2002, 1), rig.read(0x2002, 2)), (BitRate::Kbit500, 2, 4));
    rig.exchange("000: 81 00", &["70C: 00"]);
    assert_eq!((rig.device().bit_rate(), rig.read(0x2002, 1)), (BitRate::Kbit125, 4));
    assert_eq!(rig.read(0x1014, 0), 0x8C, "COB-IDs that were not saved follow");
}

#[test]
fn no_node_id_and_the_way_back() {
    let mut rig = booted();
    assert_eq!(rig.write(0x2001, 2, 1, 255), Ok(()));
    assert_eq!(rig.read(0x2001, 2), 255);
    assert_eq!(rig.write(0x1010, 4, 4, SAVE), Ok(()));
    rig.exchange("000: 82 00", &[]);
    assert_eq!(rig.node_id(), None);
    for frame in ["601: 40 00 10 00 00 00 00 00", "000: 81 00", "080:"] {
        rig.exchange(frame, &[]);
    }
    rig.power_cycle();
    rig.expect_nothing();
    rig.exchange("7E5: 4C 00 00 00 00 00 00 00", &["7E4: 50 00 00 00 00 00 00 00"]);
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 12, 0);
    // Pending and not stored: 04 00 does nothing.
    rig.exchange(TO_WAITING, &[]);
    rig.exchange("7E5: 4C 00 00 00 00 00 00 00", &[]);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    rig.exchange(TO_WAITING, &["70C: 00"]);
    assert_eq!((rig.read(0x2001, 1), rig.read(0x2001, 2)), (12, 12));
    assert_eq!((rig.read(0x1014, 0), rig.read(0x1800, 1)), (0x8C, 0x8000_018C));
}

/// A master that does not wait for the memory: the sensor boots when the new node ID is stored.
#[test]
fn to_waiting_while_the_new_node_id_is_stored() {
    for (fails, sent) in [(false, &[STORED, "70C: 00"][..]), (true, &["7E4: 17 FF 00 00 00 00 00 00"])] {
        let mut rig = blank();
        rig.write_time = Duration::from_millis(10);
        rig.writes_fail = fails;
        rig.exchange(TO_CONFIGURATION, &[]);
        node_id(&mut rig, 12, 0);
        rig.exchange(STORE, &[]);
        rig.exchange(TO_WAITING, &[]);
        rig.advance(100);
        assert_eq!(rig.take(), sent);
        assert_eq!(rig.node_id(), if fails { None } else { Some(12) });
    }
    // A master that goes back to configuration is served there first.
    let mut rig = blank();
    rig.write_time = Duration::from_millis(10);
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 12, 0);
    for request in [STORE, TO_WAITING, TO_CONFIGURATION] {
        rig.exchange(request, &[]);
    }
    rig.advance(100);
    assert_eq!(rig.take(), [STORED]);
    rig.exchange(TO_WAITING, &["70C: 00"]);
}

#[test]
fn lss_takes_the_node_id_away() {
    let mut rig = configuration();
    node_id(&mut rig, 255, 0);
    rig.exchange(TO_WAITING, &[]);
    assert_eq!(rig.node_id(), Some(1));
    rig.exchange("000: 82 00", &[]);
    assert_eq!(rig.node_id(), None);
    rig.exchange("7E5: 4C 00 00 00 00 00 00 00", &["7E4: 50 00 00 00 00 00 00 00"]);
    rig.power_cycle();
    assert_eq!(rig.take(), ["701: 00"], "not stored");
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 255, 0);
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2001, 2), 255);
    rig.exchange("000: 81 00", &[]);
    assert_eq!(rig.node_id(), None);
    // Taken away again while there is none: it stays unconfigured, and what is pending stays so.
    rig.exchange(TO_CONFIGURATION, &[]);
    node_id(&mut rig, 255, 0);
    rig.exchange(STORE, &[STORED]);
    bit_rate(&mut rig, 0, 4, 0);
    rig.exchange(TO_WAITING, &[]);
    rig.exchange("7E5: 4C 00 00 00 00 00 00 00", &["7E4: 50 00 00 00 00 00 00 00"]);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    rig.power_cycle();
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit125);
}

#[test]
fn an_unactivated_bit_rate_dies_at_a_reset() {
    for reset in ["000: 81 00", "000: 82 00"] {
        let mut rig = configuration();
        bit_rate(&mut rig, 0, 4, 0);
        rig.exchange(reset, &["701: 00"]);
        rig.exchange(TO_CONFIGURATION, &[]);
        rig.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
        rig.exchange(STORE, &[STORED]);
        assert_eq!(rig.bit_rates(), [BitRate::Kbit500], "{reset}");
        assert_eq!(rig.read(0x2002, 2), 2);
    }
}

#[test]
fn an_activated_unstored_bit_rate_lasts_to_reset_node() {
    let mut rig = configuration();
    bit_rate(&mut rig, 0, 4, 0);
    rig.exchange("7E5: 15 00 00 00 00 00 00 00", &[]);
    assert_eq!(rig.bit_rates(), [BitRate::Kbit125]);
    rig.exchange("000: 82 00", &["701: 00"]);
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit125);
    assert_eq!((rig.read(0x2002, 1), rig.read(0x2002, 2)), (4, 2));
    rig.exchange("000: 81 00", &["701: 00"]);
    assert_eq!((rig.device().bit_rate(), rig.read(0x2002, 1)), (BitRate::Kbit500, 2));
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2002, 2), 2, "it is forgotten");
}

#[test]
fn activation_is_silent_for_both_delays() {
    let mut rig = configuration();
    assert_eq!(rig.write(0x1017, 0, 2, 10), Ok(()));
    rig.take();
    bit_rate(&mut rig, 0, 8, 0);
    rig.exchange("7E5: 15 64 00 00 00 00 00 00", &[]);
    rig.advance_by(Duration::from_micros(99_999));
    assert_eq!(rig.bit_rates(), []);
    rig.advance_by(Duration::from_micros(1));
    assert_eq!(rig.bit_rates(), [BitRate::Kbit10]);
    rig.exchange(STORE, &[]);
    rig.advance(99);
    rig.expect_nothing();
    rig.advance(1);
    rig.take();
    rig.exchange(STORE, &[STORED]);
}

#[test]
fn all_eight_bit_rates_by_both_ways() {
    for rate in BitRate::ALL {
        let mut rig = booted();
        assert_eq!(rig.write(0x2002, 2, 1, rate.table_index().into()), Ok(()));
        assert_eq!(rig.write(0x1010, 4, 4, SAVE), Ok(()));
        rig.exchange("000: 81 00", &["701: 00"]);
        assert_eq!(rig.device().bit_rate(), rate);
        let mut rig = configuration();
        bit_rate(&mut rig, 0, rate.table_index(), 0);
        rig.exchange(STORE, &[STORED]);
        rig.power_cycle();
        rig.take();
        assert_eq!(rig.device().bit_rate(), rate);
    }
    assert_eq!(booted().write(0x2002, 2, 1, 5), INVALID);
}

#[test]
fn every_lss_store_has_its_answer() {
    let mut rig = configuration();
    rig.write_time = Duration::from_millis(10);
    node_id(&mut rig, 12, 0);
    for _ in 0..3 {
        rig.exchange(STORE, &[]);
    }
    rig.send("601: 23 10 10 04 73 61 76 65");
    rig.advance(100);
    let sent = rig.take();
    assert_eq!(sent, [STORED, STORED, STORED, "581: 60 10 10 04 00 00 00 00"]);
    rig.power_cycle();
    assert_eq!(rig.take(), ["70C: 00"], "the demanded pair was updated before it was saved");
}

/// 0x2001:2 and 0x2002:2 follow LSS, but for what a client has demanded since the store was asked for.
#[test]
fn what_is_demanded_while_lss_stores_stays() {
    for (memory_is_busy, object, demanded) in [
        (false, (0x2001, 9), (9, 4)),
        (false, (0x2002, 3), (12, 3)),
        (true, (0x2001, 9), (9, 4)),
        (true, (0x2002, 3), (12, 3)),
        // The value that it had.
        (false, (0x2001, 1), (1, 4)),
    ] {
        let mut rig = configuration();
        rig.write_time = Duration::from_millis(10);
        node_id(&mut rig, 12, 0);
        bit_rate(&mut rig, 0, 4, 0);
        if memory_is_busy {
            rig.exchange("601: 23 10 10 03 73 61 76 65", &[]);
        }
        rig.exchange(STORE, &[]);
        rig.advance(5);
        let (index, value) = object;
        assert_eq!(rig.write(index, 2, 1, value), Ok(()));
        rig.advance(50);
        assert_eq!(rig.take(), [STORED]);
        assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), demanded, "{index:04X} := {value}");
        // The next store is newer.
        node_id(&mut rig, 13, 0);
        bit_rate(&mut rig, 0, 6, 0);
        rig.exchange(STORE, &[]);
        rig.advance(10);
        assert_eq!(rig.take(), [STORED]);
        assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (13, 6));
    }
}

/// The master is answered in operational too, and what it asked for is stored.
#[test]
fn a_store_that_nmt_start_comes_into() {
    for memory_is_busy in [false, true] {
        let mut rig = configuration();
        rig.write_time = Duration::from_millis(10);
        node_id(&mut rig, 12, 0);
        if memory_is_busy {
            rig.exchange("601: 23 10 10 03 73 61 76 65", &[]);
        }
        rig.exchange(STORE, &[]);
        rig.exchange("000: 01 00", &[]);
        rig.advance(50);
        let sent = rig.take();
        assert_eq!(sent.iter().filter(|frame| *frame == STORED).count(), 1, "{sent:?}");
        rig.power_cycle();
        assert_eq!(rig.take(), ["70C: 00"], "busy: {memory_is_busy}");
    }
}
