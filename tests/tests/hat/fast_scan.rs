//! Fast scan of a sensor without a node ID (CiA 305; SPEC 9).

use protocol_core::device::hat::{Kind, Setup};
use tests::Rig;

use super::{blank, booted};

const IDENTIFIED: &str = "7E4: 4F 00 00 00 00 00 00 00";
const NUMBERS: [u32; 4] = [0xDA, 925_010, 0x0001_0007, 1];

fn ask(rig: &mut Rig, number: u32, bit_check: u8, sub: u8, next: u8) -> bool {
    let [a, b, c, d] = number.to_le_bytes();
    rig.send(&format!("7E5: 51 {a:02X} {b:02X} {c:02X} {d:02X} {bit_check:02X} {sub:02X} {next:02X}"));
    let sent = rig.take();
    assert!(sent.is_empty() || sent == [IDENTIFIED], "{sent:?}");
    !sent.is_empty()
}

/// A whole scan, bit by bit, as a master does it: the four numbers.
fn scan(rig: &mut Rig) -> [u32; 4] {
    assert!(ask(rig, 0, 0x80, 0, 0));
    let mut found = [0; 4];
    for sub in 0..4_u8 {
        let mut number = 0;
        for bit in (0..32).rev() {
            if !ask(rig, number, bit, sub, sub) {
                number |= 1 << bit;
            }
        }
        assert!(ask(rig, number, 0, sub, (sub + 1) % 4));
        found[usize::from(sub)] = number;
    }
    found
}

#[test]
fn a_full_match_enters_configuration() {
    let mut rig = blank();
    assert_eq!(scan(&mut rig), NUMBERS);
    // Only configuration answers this, and in configuration there is no scan.
    rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E FF 00 00 00 00 00 00"]);
    assert!(!ask(&mut rig, 0, 0x80, 0, 0));
    rig.exchange("7E5: 11 0C 00 00 00 00 00 00", &["7E4: 11 00 00 00 00 00 00 00"]);
    rig.exchange("7E5: 17 00 00 00 00 00 00 00", &["7E4: 17 00 00 00 00 00 00 00"]);
    rig.exchange("7E5: 04 00 00 00 00 00 00 00", &["70C: 00"]);
    assert!(!ask(&mut rig, 0, 0x80, 0, 0), "it has a node ID now");
}

/// The last question of the bits of an even number already names the whole number: the scan ends with the next one.
#[test]
fn every_serial_number_is_found() {
    let [vendor, product, revision, _] = NUMBERS;
    for serial in [0, 1, 2, 0x8000_0000, 0xAAAA_AAAA, 0x5555_5555, u32::MAX - 1, u32::MAX] {
        let mut rig = Rig::power_on(Setup { node_id: None, serial: Some(serial), ..Setup::new(Kind::Hat1000) });
        assert_eq!(scan(&mut rig), [vendor, product, revision, serial]);
        rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E FF 00 00 00 00 00 00"]);
    }
}

#[test]
fn no_scan_with_a_node_id_or_a_pending_one() {
    assert!(!ask(&mut booted(), 0, 0x80, 0, 0));
    let mut rig = blank();
    rig.exchange("7E5: 04 01 00 00 00 00 00 00", &[]);
    rig.exchange("7E5: 11 0C 00 00 00 00 00 00", &["7E4: 11 00 00 00 00 00 00 00"]);
    rig.exchange("7E5: 04 00 00 00 00 00 00 00", &[]);
    assert!(!ask(&mut rig, 0, 0x80, 0, 0));
}

#[test]
fn a_match_of_another_serial_number_selects_nobody() {
    let mut rig = blank();
    assert!(ask(&mut rig, 0, 0x80, 0, 0));
    for (sub, number) in (0..3).zip(NUMBERS) {
        assert!(ask(&mut rig, number, 0, sub, sub + 1));
    }
    assert!(!ask(&mut rig, 2, 0, 3, 0));
    rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &[]);
}

#[test]
fn a_sensor_that_a_scan_has_left_behind_is_silent() {
    let mut rig = blank();
    assert!(ask(&mut rig, 0, 0x80, 0, 0));
    assert!(!ask(&mut rig, 0xDB, 0, 0, 1), "another vendor");
    for sub in 1..4 {
        assert!(!ask(&mut rig, 0, 31, sub, sub));
    }
}
