//! Fast scan: a standard master's search, and every rule of the answer (SPEC 4.4; CiA 305 6.4.5).

use tests::Rig;
use tests::lss::{IDENTIFIED, TO_CONFIGURATION, TO_WAITING, fast_scan};

use super::kinds::{Kind, each_kind};

/// A node without a node ID, in the LSS state in which it takes part.
fn blank(kind: &Kind) -> Rig {
    blank_with(kind, None)
}

fn blank_with(kind: &Kind, serial: Option<u32>) -> Rig {
    let mut node = kind.blank_with_serial(serial);
    node.exchange(kind.rules.scanned_in, &[]);
    node
}

/// One question; whether it was answered.
fn ask(node: &mut Rig, number: u32, bit_check: u8, sub: u8, next: u8) -> bool {
    node.send(&fast_scan(number, bit_check, sub, next));
    let sent = node.take();
    assert!(sent.is_empty() || sent == [IDENTIFIED], "{sent:?}");
    !sent.is_empty()
}

/// The search of a standard master (CiA 305): bit by bit from the top, then the whole number. `end` is `next` of the last
/// question.
fn search(node: &mut Rig, end: u8) -> Option<[u32; 4]> {
    if !ask(node, 0, 0x80, 0, 0) {
        return None;
    }
    let mut found = [0; 4];
    for (sub, number) in (0..).zip(&mut found) {
        for bit_check in (0..32).rev() {
            if !ask(node, *number, bit_check, sub, sub) {
                *number |= 1 << bit_check;
            }
        }
        let next = if sub == 3 { end } else { sub + 1 };
        if !ask(node, *number, 0, sub, next) {
            return None;
        }
    }
    Some(found)
}

/// The last question of the bits of an even number already names the whole number: the scan ends with the next one.
#[test]
fn a_standard_master_finds_every_serial_number() {
    each_kind(|kind| {
        let [vendor, product, revision, own] = kind.identity;
        for serial in [own, 0, 1, 2, u32::MAX - 1, u32::MAX, 0x8000_0000, 0xAAAA_AAAA, 0x5555_5555] {
            for end in [0, 4] {
                let mut node = blank_with(kind, Some(serial));
                let found = search(&mut node, end);
                assert_eq!(found, Some([vendor, product, revision, serial]), "serial {serial:08X}, last next {end}");
                assert!(node.is_configuring());
            }
        }
    });
}

/// Where a scan does not select, it can be repeated, and the switch selects; where it does, configuration has no scan.
#[test]
fn what_a_scan_selects() {
    each_kind(|kind| {
        let selects = kind.rules.scan_selects;
        let mut node = blank(kind);
        assert!(search(&mut node, 0).is_some());
        assert_eq!(search(&mut node, 0).is_some(), !selects, "and once more");
        node.exchange(TO_WAITING, &[]);
        assert!(!node.is_configuring());
        assert_eq!(ask(&mut node, 0, 0x80, 0, 0), selects, "in waiting");
        node.exchange(TO_CONFIGURATION, &[]);
        assert_eq!(ask(&mut node, 0, 0x80, 0, 0), !selects, "in configuration");
    });
}

#[test]
fn no_part_with_a_node_id_or_a_pending_one() {
    each_kind(|kind| {
        let mut node = kind.booted();
        node.exchange(kind.rules.scanned_in, &[]);
        assert_eq!(search(&mut node, 0), None);
        let mut node = kind.blank();
        node.exchange(TO_CONFIGURATION, &[]);
        node.configure_node_id(0x17);
        if kind.rules.scanned_in == TO_WAITING {
            node.exchange(TO_WAITING, &[]);
        }
        assert_eq!(search(&mut node, 0), None);
    });
}

/// Every bit of every number decides from its own bit check upward, and only there.
#[test]
fn the_bits_from_bit_check_upward() {
    each_kind(|kind| {
        for (sub, own) in (0..).zip(kind.identity) {
            let mut node = blank(kind);
            for part in 0..sub {
                assert!(ask(&mut node, kind.identity[usize::from(part)], 0, part, part + 1));
            }
            for bit_check in 0..32 {
                for bit in 0..32 {
                    let agrees = bit < bit_check;
                    let number = own ^ 1 << bit;
                    assert_eq!(ask(&mut node, number, bit_check, sub, sub), agrees, "{sub} {bit_check} {bit}");
                }
                assert_eq!(node.is_configuring(), !kind.rules.scan_selects, "a number of another selects nobody");
                assert!(ask(&mut node, own, bit_check, sub, sub));
            }
        }
    });
}

#[test]
fn other_bit_checks_are_ignored() {
    each_kind(|kind| {
        let [vendor, product, ..] = kind.identity;
        for bit_check in (32..=127).chain(129..=255) {
            let mut node = blank(kind);
            assert!(ask(&mut node, vendor, 0, 0, 1));
            assert!(!ask(&mut node, vendor, bit_check, 0, 0), "{bit_check}");
            assert!(!ask(&mut node, product, bit_check, 1, 2), "{bit_check}");
            assert!(ask(&mut node, product, 0, 1, 2), "{bit_check}: the position is what it was");
        }
    });
}

/// Bit check 0x80 is always answered, whatever the rest says, and sets the position to 0.
#[test]
fn who_is_there() {
    each_kind(|kind| {
        let [vendor, product, ..] = kind.identity;
        for (number, sub, next) in [(0, 0, 0), (0xFFFF_FFFF, 3, 2), (vendor, 200, 255)] {
            let mut node = blank(kind);
            assert!(ask(&mut node, vendor, 0, 0, 1));
            assert!(ask(&mut node, number, 0x80, sub, next));
            assert!(!ask(&mut node, product, 0, 1, 2));
            assert!(ask(&mut node, vendor, 0, 0, 1));
        }
    });
}

/// A question: which of the four numbers is sent, bit check, sub, next; whether it is answered.
type Step = (usize, u8, u8, u8, bool);

/// Scans that show how the position moves.
const SCANS: [(&str, &[Step]); 9] = [
    ("only with bit check 0 the position becomes next", &[(0, 1, 0, 1, true), (1, 0, 1, 2, false)]),
    ("a sub that is not the position", &[(1, 0, 1, 2, false), (3, 0, 3, 0, false), (0, 0, 0, 1, true)]),
    ("sub 0 sets the position to 0", &[(0, 0, 0, 1, true), (0, 0, 0, 1, true), (1, 0, 1, 2, true)]),
    ("and even when it does not match", &[(0, 0, 0, 1, true), (1, 0, 0, 1, false), (1, 0, 1, 2, false)]),
    ("a mismatch elsewhere leaves the position", &[(0, 0, 0, 1, true), (0, 0, 1, 2, false), (1, 0, 1, 2, true)]),
    ("a number can be left out", &[(0, 0, 0, 3, true), (3, 0, 3, 0, true)]),
    ("a position beyond the numbers", &[(0, 0, 0, 4, true), (0, 0, 4, 0, false), (0, 0, 0, 1, true)]),
    ("with 3 the position stays 3", &[(0, 0, 0, 3, true), (3, 0, 3, 3, true), (3, 0, 3, 4, true), (3, 0, 3, 4, false)]),
    ("the end sets it to 0", &[(0, 0, 0, 3, true), (3, 0, 3, 4, true), (3, 0, 3, 3, false), (0, 0, 0, 3, true)]),
];

#[test]
fn the_position() {
    each_kind(|kind| {
        for (name, steps) in SCANS {
            let mut node = blank(kind);
            for (number, (part, bit_check, sub, next, answered)) in steps.iter().enumerate() {
                if !node.is_configuring() || !kind.rules.scan_selects {
                    let sent = kind.identity[*part];
                    assert_eq!(ask(&mut node, sent, *bit_check, *sub, *next), *answered, "{name}, step {number}");
                }
            }
        }
    });
}

/// Two masters, or one that gave up: a new search begins wherever the last one stood.
#[test]
fn a_search_begins_anew_after_any_other() {
    each_kind(|kind| {
        for steps in 0..=if kind.rules.scan_selects { 3 } else { 4 } {
            let mut node = blank(kind);
            for (sub, number) in (0..steps).zip(kind.identity) {
                assert!(ask(&mut node, number, 0, sub, sub + 1));
            }
            assert_eq!(search(&mut node, 0), Some(kind.identity), "after {steps} steps");
        }
    });
}
