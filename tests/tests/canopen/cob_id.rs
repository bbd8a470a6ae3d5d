//! The objects that hold a COB-ID: what they take, and when it is in force (SPEC 4.1).

use tests::Rig;

const INVALID_VALUE: u32 = 0x0609_0030;
const DEVICE_STATE: u32 = 0x0800_0022;

const OFF: u32 = 1 << 31;
const BIT_30: u32 = 1 << 30;
const EXTENDED: u32 = 1 << 29;

const SYNC: (u16, u8) = (0x1005, 0);
const EMCY_CONSUMER: (u16, u8) = (0x1028, 1);
const RPDO: (u16, u8) = (0x1400, 1);
const TPDO: (u16, u8) = (0x1800, 1);

fn is_reserved(id: u32) -> bool {
    matches!(id, 0x000..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..=0x7FF)
}

fn write(rig: &mut Rig, (index, sub): (u16, u8), value: u32) -> Result<(), u32> {
    rig.write(index, sub, 4, value)
}

/// A valve whose PDOs are off.
fn pdos_off() -> Rig {
    let mut rig = Rig::booted();
    assert_eq!(write(&mut rig, RPDO, OFF | 0x220), Ok(()));
    assert_eq!(write(&mut rig, TPDO, OFF | 0x1A0), Ok(()));
    rig
}

#[test]
fn every_identifier() {
    let mut rig = pdos_off();
    for object in [SYNC, EMCY_CONSUMER, RPDO, TPDO] {
        for id in 0..=0x7FF {
            let expected = if is_reserved(id) { Err(INVALID_VALUE) } else { Ok(()) };
            assert_eq!(write(&mut rig, object, id), expected, "{object:04X?} := {id:03X}");
            if expected.is_ok() {
                assert_eq!(rig.read(object.0, object.1), id);
            }
            // A PDO that is on keeps its identifier.
            if object == RPDO || object == TPDO {
                assert_eq!(write(&mut rig, object, OFF), Ok(()));
            }
        }
        for more in [0x800, 0x880, 0x1_0080, 0x1000_0080, 0x1FFF_FFFF] {
            assert_eq!(write(&mut rig, object, more), Err(INVALID_VALUE), "{object:04X?} := {more:X}");
        }
    }
}

#[test]
fn bits_29_to_31() {
    let table = [
        (SYNC, BIT_30, false),
        (SYNC, OFF | BIT_30, false),
        (SYNC, EXTENDED, false),
        (EMCY_CONSUMER, BIT_30, true),
        (EMCY_CONSUMER, EXTENDED, false),
        (EMCY_CONSUMER, OFF, true),
        (RPDO, OFF | BIT_30, true),
        (RPDO, BIT_30, true),
        (RPDO, EXTENDED, false),
        (RPDO, OFF | EXTENDED, true),
        (TPDO, OFF | BIT_30, true),
        (TPDO, BIT_30, true),
        (TPDO, EXTENDED, false),
        (TPDO, OFF | EXTENDED, true),
    ];
    for (object, bits, taken) in table {
        let mut rig = pdos_off();
        let expected = if taken { Ok(()) } else { Err(INVALID_VALUE) };
        assert_eq!(write(&mut rig, object, bits | 0x190), expected, "{object:04X?} := {bits:X}");
        if taken {
            assert_eq!(rig.read(object.0, object.1), bits | 0x190);
        }
    }
}

/// Bits 29 and 30 and a reserved identifier do not matter to a consumer that is off.
#[test]
fn an_emcy_consumer_that_is_off_takes_anything() {
    let mut rig = Rig::booted();
    for value in [OFF, OFF | 0x7FF, OFF | 0x001, OFF | EXTENDED | 0x1FFF_FFFF, 0xFFFF_FFFF, OFF | BIT_30] {
        assert_eq!(write(&mut rig, EMCY_CONSUMER, value), Ok(()));
        assert_eq!(rig.read(EMCY_CONSUMER.0, EMCY_CONSUMER.1), value);
    }
    assert_eq!(write(&mut rig, EMCY_CONSUMER, 0x7FF), Err(INVALID_VALUE));
}

#[test]
fn the_identifier_of_a_pdo_changes_while_it_is_off() {
    for (object, own) in [(RPDO, 0x220), (TPDO, 0x1A0)] {
        let mut rig = Rig::booted();
        assert_eq!(write(&mut rig, object, 0x190), Err(DEVICE_STATE));
        assert_eq!(rig.read(object.0, object.1), own);
        // Off and another identifier in one.
        assert_eq!(write(&mut rig, object, OFF | 0x191), Ok(()));
        // On and another identifier in one.
        assert_eq!(write(&mut rig, object, 0x190), Ok(()));
        assert_eq!(rig.read(object.0, object.1), 0x190);
    }
}

#[test]
fn in_force_at_once() {
    let mut rig = pdos_off();
    rig.exchange("000: 01 00", &[]);
    assert_eq!(write(&mut rig, RPDO, BIT_30 | 0x6DF), Ok(()));
    assert_eq!(write(&mut rig, TPDO, BIT_30 | 0x181), Ok(()));
    rig.exchange("220: 0F 00 00 00", &[]);
    rig.exchange("6DF: 0F 00 00 00", &["181: 09 00 00 00"]);
    assert_eq!(rig.write(0x1800, 2, 1, 1), Ok(()));
    rig.exchange("080:", &["181: 09 00 00 00"]);
    assert_eq!(write(&mut rig, SYNC, 0x580), Ok(()));
    rig.exchange("080:", &[]);
    rig.exchange("580:", &["181: 09 00 00 00"]);
    // Bit 31 means nothing in 0x1005.
    assert_eq!(write(&mut rig, SYNC, OFF | 0x100), Ok(()));
    rig.exchange("580:", &[]);
    rig.exchange("100:", &["181: 09 00 00 00"]);
}
