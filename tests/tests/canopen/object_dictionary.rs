//! The objects that only the valves have: the description, the history that can be cleared, and the numbers that
//! follow the node ID (SPEC 4.1).

use protocol_core::device::pve::{Kind, Setup};
use tests::Rig;

const TOO_LONG: u32 = 0x0607_0012;

#[test]
fn a_description_takes_up_to_ten_characters() {
    let mut rig = Rig::booted();
    for text in ["boom left", "1234567890", "", "x", "1234567"] {
        assert_eq!(rig.write_segmented(0x6053, 0, text.as_bytes()), Ok(()), "{text}");
        // One of one to four characters is read expedited.
        match text.len() {
            1..=4 => assert_eq!(rig.read(0x6053, 0).to_le_bytes()[..text.len()], *text.as_bytes()),
            _ => assert_eq!(rig.read_segmented(0x6053, 0).as_deref(), Ok(text.as_bytes())),
        }
    }
    for text in ["12345678901", "123456789012345678901234567890"] {
        assert_eq!(rig.write_segmented(0x6053, 0, text.as_bytes()), Err(TOO_LONG), "{text}");
    }
    assert_eq!(rig.read_segmented(0x6053, 0).as_deref(), Ok(&b"1234567"[..]));
    // expedited, with a size
    assert_eq!(rig.write(0x6053, 0, 3, u32::from_le_bytes(*b"arm?")), Ok(()));
    assert_eq!(rig.read(0x6053, 0).to_le_bytes(), *b"arm\0");
}

#[test]
fn the_numbers_that_follow_the_node_id_and_the_serial_number() {
    for (node_id, serial) in [(0x01, 0), (0x7F, u32::MAX), (0x10, 42)] {
        let setup = Setup { node_id: Some(node_id), serial: Some(serial), ..Setup::new(Kind::PveaCanopen) };
        let mut rig = Rig::booted_as(setup);
        let node_id = u32::from(node_id);
        assert_eq!(rig.read(0x1014, 0), 0x80 + node_id);
        assert_eq!(rig.read(0x1400, 1), 0x200 + node_id);
        assert_eq!(rig.read(0x1800, 1), 0x180 + node_id);
        assert_eq!(rig.read(0x1018, 4), serial);
        let text = serial.to_string();
        match text.len() {
            1..=4 => assert_eq!(rig.read(0x6052, 0).to_le_bytes()[..text.len()], *text.as_bytes()),
            _ => assert_eq!(rig.read_segmented(0x6052, 0).as_deref(), Ok(text.as_bytes())),
        }
    }
}

/// The counter of a fault goes on.
#[test]
fn writing_0_clears_the_history() {
    let mut rig = Rig::booted();
    for _ in 0..10 {
        rig.internal_fault_comes_and_goes();
    }
    rig.take();
    assert_eq!(rig.read(0x1003, 0), 8);
    rig.exchange("620: 2F 03 10 00 00 00 00 00", &["5A0: 60 03 10 00 00 00 00 00"]);
    assert_eq!((rig.read(0x1003, 0), rig.read_abort(0x1003, 1)), (0, 0x0800_0024));
    rig.internal_fault_comes_and_goes();
    rig.take();
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (1, 0x000B_1000));
}
