//! The EMCY consumer: an emergency stop that another node tells (SPEC 4.2, 4.3).

use tests::Rig;

const EMERGENCY_STOP: &str = "0A1: 00 10 01 05 00 00 00 00";
const ACTIVE: u32 = 0x0F;
const FAULT_HOLD: u32 = 0x03;

/// Listens for the EMCY of node 0x21, and is in ACTIVE.
fn listening() -> Rig {
    let mut rig = Rig::booted();
    assert_eq!(rig.write(0x1028, 1, 4, 0xA1), Ok(()));
    rig.activate();
    rig
}

#[test]
fn it_shuts_down_and_is_no_fault_of_this_device() {
    let mut rig = listening();
    rig.advance_cyclic(400, "220: 0F 00 00 40");
    rig.take();
    rig.exchange(EMERGENCY_STOP, &[]);
    assert!(!rig.outputs().solenoids);
    assert_eq!((rig.read(0x1001, 0), rig.read(0x1003, 0)), (0, 0));
    for counter in [0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024, 0x2040] {
        assert_eq!(rig.read(counter, 0), 0);
    }
    rig.exchange("220: 0F 00 00 40", &["1A0: 03 00 00 40"]);
    rig.silent_for(1000);
    // D11 leads out at once.
    rig.exchange("220: 03 00 00 00", &["1A0: 03 00 00 00"]);
    rig.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
}

#[test]
fn it_comes_before_an_rpdo_and_a_sync_with_its_identifier() {
    for (index, sub) in [(0x1400, 1), (0x1005, 0)] {
        let mut rig = listening();
        if index == 0x1400 {
            assert_eq!(rig.write(index, sub, 4, 0x8000_0220), Ok(()));
        }
        assert_eq!(rig.write(index, sub, 4, 0xA1), Ok(()));
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(rig.status(), FAULT_HOLD, "{index:04X}");
    }
}

#[test]
fn what_is_no_emergency_stop() {
    for other in [
        "0A1: 00 00 00 00 00 00 00 00",
        "0A1: 01 10 01 00 00 00 00 00",
        "0A1: 00 20 01 00 00 00 00 00",
        "0A1: 10 00 01 00 00 00 00 00",
        "0A1: 12 34 05 01 00 00 00 00",
        "0A1: 00 10",
        "0A1: 00 10 01 05 00 00 00",
        "0A1: R8",
        "0A2: 00 10 01 05 00 00 00 00",
        "080: 00 10 01 05 00 00 00 00",
        "000000A1: 00 10 01 05 00 00 00 00",
    ] {
        let mut rig = listening();
        rig.exchange(other, &[]);
        assert_eq!(rig.status(), ACTIVE, "{other}");
    }
}

#[test]
fn the_consumer_is_off_until_it_is_configured() {
    for cob_id in [0x8000_0000, 0x8000_00A1, 0x0000_00A2] {
        let mut rig = listening();
        assert_eq!(rig.write(0x1028, 1, 4, cob_id), Ok(()));
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(rig.status(), ACTIVE);
        // Changed at any time, in force at once.
        assert_eq!(rig.write(0x1028, 1, 4, 0x4000_00A1), Ok(()));
        rig.exchange(EMERGENCY_STOP, &[]);
        assert_eq!(rig.status(), FAULT_HOLD);
    }
}
