//! The objects that only the sensors have, and the values that they accept and the valves do not (SPEC 9).

use protocol_core::device::hat::{Kind, Setup};
use tests::Rig;

use super::{INVALID, STATE, booted, booted_as};

const OFF: u32 = 1 << 31;

#[test]
fn the_serial_number_is_told_twice() {
    let mut rig = booted_as(Setup { serial: Some(0x1234_5678), ..Setup::new(Kind::Hat3000) });
    assert_eq!((rig.read(0x1018, 4), rig.read(0x650B, 0)), (0x1234_5678, 0x1234_5678));
}

#[test]
fn the_cob_id_of_the_emcy() {
    let mut rig = booted();
    // While it is on, the identifier stays.
    assert_eq!(rig.write(0x1014, 0, 4, 0x82), STATE);
    for refused in [0x4000_0081, 0xC000_0081] {
        assert_eq!(rig.write(0x1014, 0, 4, refused), INVALID, "{refused:X}");
    }
    assert_eq!(rig.write(0x1014, 0, 4, OFF | 0x81), Ok(()));
    for refused in [0x7F, 0x581, 0x701, 0x800, 0x0001_0081] {
        assert_eq!(rig.write(0x1014, 0, 4, refused), INVALID, "{refused:X}");
    }
    assert_eq!(rig.write(0x1014, 0, 4, 0x2ABC_DEF0), Ok(()));
    assert_eq!(rig.read(0x1014, 0), 0x2ABC_DEF0);
    assert_eq!(rig.write(0x1014, 0, 4, 0x2ABC_DEF0), Ok(()), "rewritten");
    assert_eq!(rig.write(0x1014, 0, 4, 0x81), STATE);
}

#[test]
fn the_mapping_in_the_order_of_cia_301_only() {
    let mut rig = booted();
    const NOT_MAPPABLE: Result<(), u32> = Err(0x0604_0041);
    const TOO_LONG: Result<(), u32> = Err(0x0604_0042);
    assert_eq!(rig.write(0x1A00, 1, 4, 0x6503_0010), STATE, "sub 0 is not 0");
    assert_eq!(rig.write(0x1A00, 0, 1, 2), NOT_MAPPABLE, "entry 2 maps nothing");
    assert_eq!(rig.write(0x1A00, 0, 1, 9), TOO_LONG);
    assert_eq!(rig.write(0x1A00, 0, 1, 0), Ok(()));
    for dummy in [0x0001_0001, 0x0005_0008, 0x6004_0010, 0x6003_0020, 0x1018_0420, 0x6004_0120] {
        assert_eq!(rig.write(0x1A00, 1, 4, dummy), NOT_MAPPABLE, "{dummy:X}");
    }
    for (sub, entry) in [(1, 0x1001_0008), (2, 0x1002_0020), (3, 0x6503_0010), (4, 0x1001_0008), (5, 0x6004_0020)] {
        assert_eq!(rig.write(0x1A00, sub, 4, entry), Ok(()), "{entry:X}");
    }
    assert_eq!(rig.write(0x1A00, 0, 1, 5), TOO_LONG);
    rig.write_all(&[(0x1A00, 0, 1, 4), (0x1800, 1, 4, 0x181)]);
    assert_eq!(rig.write(0x1A00, 0, 1, 0), STATE, "on");
    assert_eq!(rig.write(0x1800, 3, 2, 1), STATE, "on");
    assert_eq!(rig.write(0x1800, 3, 2, 0), Ok(()), "rewritten");
    assert_eq!(rig.write(0x1800, 1, 4, 0x182), STATE);
}

#[test]
fn reserved_and_29_bit_identifiers_of_the_pdo() {
    let mut rig = booted();
    for refused in [0x7F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x0001_0181] {
        assert_eq!(rig.write(0x1800, 1, 4, refused), INVALID, "{refused:X}");
        assert_eq!(rig.write(0x1800, 1, 4, refused | OFF), Ok(()), "off: not looked at");
    }
    rig.write_all(&[(0x1800, 1, 4, 0x2000_0181), (0x1800, 2, 1, 1)]);
    rig.exchange("000: 01 00", &[]);
    rig.exchange("080:", &["00000181: 00 00 00 00"]);
}

#[test]
fn what_only_the_valve_has() {
    let mut rig = booted();
    for text in ["1BC788F1: 03 22 10 01", "201: 0F 00 00 00", "181: R4", "080: R0"] {
        rig.exchange(text, &[]);
    }
    assert!(Rig::booted().read_abort(0x6003, 0) == 0x0602_0000);
}
