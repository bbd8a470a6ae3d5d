//! LSS, where the sensors have rules of their own: identify remote slave, and the pairs of node ID and bit rate (SPEC 9).

use protocol_core::controller::BitRate;
use protocol_core::device::hat::{Kind, Setup};
use protocol_core::time::Duration;
use tests::lss::{
    ACTIVATE, IDENTIFIED, IDENTIFY_NON_CONFIGURED, NON_CONFIGURED, STORE, STORED, TO_CONFIGURATION, TO_WAITING,
};
use tests::{Rig, sdo};

use super::{blank, booted, booted_as};

/// In LSS configuration.
fn configuration() -> Rig {
    let mut rig = booted();
    rig.exchange(TO_CONFIGURATION, &[]);
    rig
}

/// The six bounds around the numbers of a new HAT 1000.
const REMOTE: [&str; 6] = [
    "7E5: 46 DA 00 00 00 00 00 00",
    "7E5: 47 52 1D 0E 00 00 00 00",
    "7E5: 48 07 00 01 00 00 00 00",
    "7E5: 49 07 00 01 00 00 00 00",
    "7E5: 4A 01 00 00 00 00 00 00",
    "7E5: 4B 01 00 00 00 00 00 00",
];

fn identify(rig: &mut Rig, bounds: [&str; 6]) -> bool {
    let [first @ .., last] = bounds;
    first.iter().for_each(|bound| rig.exchange(bound, &[]));
    rig.send(last);
    let sent = rig.take();
    assert!(sent.is_empty() || sent == [IDENTIFIED], "{sent:?}");
    !sent.is_empty()
}

#[test]
fn identify_remote_slave_is_answered_in_both_lss_states() {
    for switch in [TO_WAITING, TO_CONFIGURATION] {
        for mut rig in [booted(), blank()] {
            rig.exchange(switch, &[]);
            assert!(identify(&mut rig, REMOTE));
        }
        // Not in operational, and what was begun before it is not gone on with.
        let mut rig = booted();
        rig.exchange(switch, &[]);
        let (begin, end) = REMOTE.split_at(2);
        begin.iter().for_each(|request| rig.exchange(request, &[]));
        rig.exchange("000: 01 00", &[]);
        assert!(!identify(&mut rig, REMOTE));
        rig.exchange("000: 80 00", &[]);
        end.iter().for_each(|request| rig.exchange(request, &[]));
    }
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
    rig.silent_to(&[bounds[0], bounds[1]]);
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
fn a_store_that_fails() {
    let mut rig = configuration();
    rig.configure_node_id(12);
    rig.writes_fail = true;
    rig.exchange(STORE, &["7E4: 17 FF 00 00 00 00 00 00"]);
    assert_eq!(rig.read(0x1001, 0), 0, "no error of the sensor");
    assert_eq!(rig.read(0x2001, 2), 1, "demanded is what is stored");
    rig.writes_fail = false;
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2001, 2), 12);
}

/// A sensor with a node ID waits for its reset: to waiting takes over nothing, neither pending nor stored.
#[test]
fn a_pending_node_id_waits_for_a_reset() {
    for stored in [false, true] {
        let mut rig = configuration();
        rig.configure_node_id(12);
        if stored {
            rig.exchange(STORE, &[STORED]);
        }
        rig.exchange(TO_WAITING, &[]);
        assert_eq!(rig.node_id(), Some(1));
        rig.exchange("000: 82 00", &["70C: 00"]);
        let demanded = if stored { 12 } else { 1 };
        assert_eq!((rig.read(0x2001, 1), rig.read(0x2001, 2)), (12, demanded), "the demanded one reads what is stored");
        // What is held can be stored.
        rig.exchange(TO_CONFIGURATION, &[]);
        rig.exchange(STORE, &[STORED]);
        assert_eq!(rig.read(0x2001, 2), 12);
    }
}

#[test]
fn lss_store_stores_what_is_pending_and_updates_what_is_demanded() {
    let mut rig = configuration();
    rig.write_all(&[(0x2001, 2, 1, 5), (0x2002, 2, 1, 3)]);
    rig.configure_node_id(12);
    rig.exchange(STORE, &[STORED]);
    assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (12, 3));
    rig.exchange("000: 81 00", &["70C: 00"]);
    assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (12, 2), "the rate was demanded, not stored");
}

#[test]
fn lss_store_stores_what_is_pending_again_when_it_was_overwritten() {
    for (index, signature) in [(0x1010, sdo::SAVE), (0x1011, sdo::LOAD)] {
        let mut rig = configuration();
        rig.configure_node_id(12);
        rig.configure_bit_rate(4);
        rig.exchange(STORE, &[STORED]);
        rig.write_all(&[(0x2001, 2, 1, 9), (0x2002, 2, 1, 3), (index, 4, 4, signature)]);
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
    rig.configure_node_id(12);
    rig.configure_bit_rate(4);
    rig.exchange(ACTIVATE, &[]);
    rig.exchange("000: 82 00", &["70C: 00"]);
    for (object, value) in [("2F 01 20 02", "09"), ("2F 02 20 02", "03"), ("23 10 10 04", "73 61 76 65")] {
        let padding = " 00".repeat(4 - (value.len() + 1) / 3);
        let answer = format!("58C: 60{} 00 00 00 00", &object[2..]);
        rig.exchange(&format!("60C: {object} {value}{padding}"), &[&answer]);
    }
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    rig.power_cycle_sends(&["709: 00"]);
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit250);
}

#[test]
fn save_stores_the_demanded_pair() {
    let mut rig = booted();
    rig.write_all(&[(0x2001, 2, 1, 12), (0x2002, 2, 1, 4)]);
    assert_eq!((rig.read(0x2001, 1), rig.read(0x2002, 1)), (1, 2), "in force as before");
    // Unsaved, it is lost.
    rig.exchange("000: 82 00", &["701: 00"]);
    assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (1, 2));
    rig.write_all(&[(0x2001, 2, 1, 12), (0x2002, 2, 1, 4)]);
    rig.save(4);
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
    rig.save(4);
    rig.exchange("000: 82 00", &[]);
    assert_eq!(rig.node_id(), None);
    for frame in ["601: 40 00 10 00 00 00 00 00", "000: 81 00", "080:"] {
        rig.exchange(frame, &[]);
    }
    rig.power_cycle();
    rig.expect_nothing();
    rig.exchange(IDENTIFY_NON_CONFIGURED, &[NON_CONFIGURED]);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.configure_node_id(12);
    // Pending and not stored: 04 00 does nothing.
    rig.silent_to(&[TO_WAITING, IDENTIFY_NON_CONFIGURED, TO_CONFIGURATION]);
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
        rig.configure_node_id(12);
        rig.silent_to(&[STORE, TO_WAITING]);
        rig.advance_sends(100, sent);
        assert_eq!(rig.node_id(), if fails { None } else { Some(12) });
    }
    // A master that goes back to configuration is served there first.
    let mut rig = blank();
    rig.write_time = Duration::from_millis(10);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.configure_node_id(12);
    for request in [STORE, TO_WAITING, TO_CONFIGURATION] {
        rig.exchange(request, &[]);
    }
    rig.advance_sends(100, &[STORED]);
    rig.exchange(TO_WAITING, &["70C: 00"]);
}

#[test]
fn lss_takes_the_node_id_away() {
    let mut rig = configuration();
    rig.configure_node_id(255);
    rig.exchange(TO_WAITING, &[]);
    assert_eq!(rig.node_id(), Some(1));
    rig.exchange("000: 82 00", &[]);
    assert_eq!(rig.node_id(), None);
    rig.exchange(IDENTIFY_NON_CONFIGURED, &[NON_CONFIGURED]);
    rig.power_cycle();
    assert_eq!(rig.take(), ["701: 00"], "not stored");
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.configure_node_id(255);
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2001, 2), 255);
    rig.exchange("000: 81 00", &[]);
    assert_eq!(rig.node_id(), None);
    // Taken away again while there is none: it stays unconfigured, and what is pending stays so.
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.configure_node_id(255);
    rig.exchange(STORE, &[STORED]);
    rig.configure_bit_rate(4);
    rig.exchange(TO_WAITING, &[]);
    rig.exchange(IDENTIFY_NON_CONFIGURED, &[NON_CONFIGURED]);
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    rig.power_cycle();
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit125);
}

/// The numbers of the bit rate in force and of the demanded one follow what LSS does.
#[test]
fn an_activated_unstored_bit_rate_lasts_to_reset_node() {
    let mut rig = configuration();
    rig.configure_bit_rate(4);
    rig.exchange(ACTIVATE, &[]);
    for (reset, numbers) in [("000: 82 00", (4, 2)), ("000: 81 00", (2, 2))] {
        rig.exchange(reset, &["701: 00"]);
        assert_eq!((rig.read(0x2002, 1), rig.read(0x2002, 2)), numbers);
    }
    rig.exchange(TO_CONFIGURATION, &[]);
    rig.exchange(STORE, &[STORED]);
    assert_eq!(rig.read(0x2002, 2), 2, "it is forgotten");
}

#[test]
fn every_lss_store_has_its_answer() {
    let mut rig = configuration();
    rig.write_time = Duration::from_millis(10);
    rig.configure_node_id(12);
    for _ in 0..3 {
        rig.exchange(STORE, &[]);
    }
    rig.send(&sdo::write(1, 0x1010, 4, b"save"));
    rig.advance(100);
    let sent = rig.take();
    assert_eq!(sent, [STORED, STORED, STORED, &sdo::written(1, 0x1010, 4)]);
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
        rig.configure_node_id(12);
        rig.configure_bit_rate(4);
        if memory_is_busy {
            rig.exchange(&sdo::write(1, 0x1010, 3, b"save"), &[]);
        }
        rig.exchange(STORE, &[]);
        rig.advance(5);
        let (index, value) = object;
        assert_eq!(rig.write(index, 2, 1, value), Ok(()));
        rig.advance_sends(50, &[STORED]);
        assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), demanded, "{index:04X} := {value}");
        // The next store is newer.
        rig.configure_node_id(13);
        rig.configure_bit_rate(6);
        rig.exchange(STORE, &[]);
        rig.advance_sends(10, &[STORED]);
        assert_eq!((rig.read(0x2001, 2), rig.read(0x2002, 2)), (13, 6));
    }
}
