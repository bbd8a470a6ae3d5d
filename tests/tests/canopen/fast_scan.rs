//! Fast scan: the manual's sequence, a standard master's search, and every rule of the answer (SPEC 4.4; CiA 305
//! 6.4.5).

use protocol_core::device::pve::{Kind, Setup};
use tests::Rig;

const IDENTITY: [u32; 4] = [0x0100_0019, 0x5336_0000, 0x0001_0020, 0x5B2E_0100];

/// A valve without node ID in LSS configuration, where alone it takes part (R).
fn blank() -> Rig {
    blank_with(None)
}

fn blank_with(serial: Option<u32>) -> Rig {
    let mut valve = Rig::power_on(Setup { node_id: None, serial, ..Setup::new(Kind::PveaCanopen) });
    valve.exchange("7E5: 04 01 00 00 00 00 00 00", &[]);
    valve
}

/// One question; whether it was answered.
fn ask(valve: &mut Rig, number: u32, bit_check: u8, sub: u8, next: u8) -> bool {
    let [a, b, c, d] = number.to_le_bytes();
    valve.send(&format!("7E5: 51 {a:02X} {b:02X} {c:02X} {d:02X} {bit_check:02X} {sub:02X} {next:02X}"));
    match valve.take().as_slice() {
        [] => false,
        [answer] if answer == "7E4: 4F 00 00 00 00 00 00 00" => true,
        others => panic!("{others:?}"),
    }
}

/// The search of a standard master (CiA 305): bit by bit from the top, then the whole number. `next` of the last
/// question.
fn search(valve: &mut Rig, end: u8) -> Option<[u32; 4]> {
    if !ask(valve, 0, 0x80, 0, 0) {
        return None;
    }
    let mut found = [0; 4];
    for (sub, number) in (0..).zip(&mut found) {
        for bit_check in (0..32).rev() {
            if !ask(valve, *number, bit_check, sub, sub) {
                *number |= 1 << bit_check;
            }
        }
        let next = if sub == 3 { end } else { sub + 1 };
        if !ask(valve, *number, 0, sub, next) {
            return None;
        }
    }
    Some(found)
}

#[test]
fn the_manuals_sequence() {
    let mut valve = blank();
    for (sub, number) in (0..).zip(IDENTITY) {
        assert!(ask(&mut valve, number, 0, sub, sub + 1), "{sub}");
    }
    // and once more: the scan has ended
    for (sub, number) in (0..).zip(IDENTITY) {
        assert!(ask(&mut valve, number, 0, sub, sub + 1), "{sub}, again");
    }
}

#[test]
fn a_standard_master_finds_every_serial_number() {
    for serial in [IDENTITY[3], 0, 1, u32::MAX, 0x8000_0000, 0xAAAA_AAAA, 0x5555_5555] {
        let mut valve = blank_with(Some(serial));
        let expected = Some([IDENTITY[0], IDENTITY[1], IDENTITY[2], serial]);
        for end in [0, 4] {
            assert_eq!(search(&mut valve, end), expected, "serial {serial:08X}, last next {end}");
        }
    }
}

/// The scan selects nobody: the switch does. What was found can then be selected.
#[test]
fn a_scan_selects_nobody() {
    let mut valve = blank();
    assert!(search(&mut valve, 0).is_some());
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &[]);
    valve.exchange("7E5: 5E 00 00 00 00 00 00 00", &[]);
    assert!(!ask(&mut valve, 0, 0x80, 0, 0), "no part in waiting");
}

#[test]
fn no_part_with_a_node_id() {
    let mut valve = Rig::booted();
    valve.exchange("7E5: 04 01 00 00 00 00 00 00", &[]);
    assert_eq!(search(&mut valve, 0), None);
    let mut valve = blank();
    valve.exchange("7E5: 11 17 00 00 00 00 00 00", &["7E4: 11 00 00 00 00 00 00 00"]);
    assert_eq!(search(&mut valve, 0), None);
}

/// Every bit of every number decides from its own bit check upward, and only there.
#[test]
fn the_bits_from_bit_check_upward() {
    for (sub, own) in (0..).zip(IDENTITY) {
        let mut valve = blank();
        for part in 0..sub {
            assert!(ask(&mut valve, IDENTITY[usize::from(part)], 0, part, part + 1));
        }
        for bit_check in 0..32 {
            for bit in 0..32 {
                let agrees = bit < bit_check;
                let number = own ^ 1 << bit;
                assert_eq!(ask(&mut valve, number, bit_check, sub, sub), agrees, "{sub} {bit_check} {bit}");
            }
            assert!(ask(&mut valve, own, bit_check, sub, sub));
        }
    }
}

#[test]
fn other_bit_checks_are_ignored() {
    for bit_check in (32..=127).chain(129..=255) {
        let mut valve = blank();
        assert!(ask(&mut valve, IDENTITY[0], 0, 0, 1));
        assert!(!ask(&mut valve, IDENTITY[0], bit_check, 0, 0), "{bit_check}");
        assert!(!ask(&mut valve, IDENTITY[1], bit_check, 1, 2), "{bit_check}");
        assert!(ask(&mut valve, IDENTITY[1], 0, 1, 2), "{bit_check}: the position is what it was");
    }
}

/// Bit check 0x80 is always answered, whatever the rest says, and sets the position to 0.
#[test]
fn who_is_there() {
    for (number, sub, next) in [(0, 0, 0), (0xFFFF_FFFF, 3, 2), (IDENTITY[0], 200, 255)] {
        let mut valve = blank();
        assert!(ask(&mut valve, IDENTITY[0], 0, 0, 1));
        assert!(ask(&mut valve, number, 0x80, sub, next));
        assert!(!ask(&mut valve, IDENTITY[1], 0, 1, 2));
        assert!(ask(&mut valve, IDENTITY[0], 0, 0, 1));
    }
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
    for (name, steps) in SCANS {
        let mut valve = blank();
        for (number, (part, bit_check, sub, next, answered)) in steps.iter().enumerate() {
            assert_eq!(ask(&mut valve, IDENTITY[*part], *bit_check, *sub, *next), *answered, "{name}, step {number}");
        }
    }
}

/// Two masters, or one that gave up: a new search begins wherever the last one stood.
#[test]
fn a_search_begins_anew_after_any_other() {
    for steps in 0..=4_u8 {
        let mut valve = blank();
        for (sub, number) in (0..steps).zip(IDENTITY) {
            assert!(ask(&mut valve, number, 0, sub, sub + 1));
        }
        assert_eq!(search(&mut valve, 0), Some(IDENTITY), "after {steps} steps");
    }
}
