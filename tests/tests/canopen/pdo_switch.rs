//! Switching a PDO, and the emergency-stop consumer, on and off by their COB-IDs (SPEC 4.1).

use tests::Rig;

use super::{SAVE, SAVED};

const OFF: u32 = 0x8000_0000;
const INVALID_VALUE: u32 = 0x0609_0030;

/// The communication parameters of the PDOs: index, mapping, and the identifier without a node ID.
const PDOS: [(u16, u16, u32); 2] = [(0x1400, 0x1600, 0x220), (0x1800, 0x1A00, 0x1A0)];

/// With bit 31 set the rest is not looked at.
const OFF_VALUES: [u32; 7] =
    [0x8000_0000, 0xFFFF_FFFF, 0xA000_0220, 0x8000_0001, 0x8000_0101, 0x8000_05A0, 0xC000_07FF];

#[test]
fn any_value_with_bit_31_switches_a_pdo_off() {
    for (communication, ..) in PDOS {
        for value in OFF_VALUES {
            let mut valve = Rig::booted();
            assert_eq!(valve.write(communication, 1, 4, value), Ok(()), "{communication:04X} := {value:08X}");
            assert_eq!(valve.read(communication, 1), value);
            valve.send("000: 01 20");
            valve.exchange("220: 0F 00 00 00", &[]);
            // Stored and loaded as it was written.
            valve.exchange(SAVE, &[SAVED]);
            valve.start_anew();
            assert_eq!(valve.read(communication, 1), value);
        }
    }
}

/// In any state of the PDO: on, off, off with another value.
#[test]
fn a_pdo_that_is_off_takes_another_value() {
    for (communication, _, identifier) in PDOS {
        let mut valve = Rig::booted();
        for value in OFF_VALUES.into_iter().chain([identifier, OFF | identifier, OFF, identifier]) {
            assert_eq!(valve.write(communication, 1, 4, value), Ok(()), "{communication:04X} := {value:08X}");
            assert_eq!(valve.read(communication, 1), value);
        }
        valve.send("000: 01 20");
        valve.exchange("220: 01 00 00 00", &["1A0: 09 00 00 00"]);
    }
}

/// (A) A PDO with nothing mapped cannot be switched on; one that only has dummies can.
#[test]
fn a_pdo_with_nothing_mapped() {
    for (communication, mapping, identifier) in PDOS {
        let mut valve = Rig::booted();
        valve.write_all(&[(communication, 1, 4, OFF | identifier), (mapping, 0, 1, 0)]);
        assert_eq!(valve.write(communication, 1, 4, identifier), Err(INVALID_VALUE), "{communication:04X}");
        assert_eq!(valve.read(communication, 1), OFF | identifier);
        valve.send_all(&["000: 01 20", "220: 01 00 00 00", "220:"]);
        valve.expect_nothing();
        // "save" keeps it off.
        valve.exchange(SAVE, &[SAVED]);
        valve.start_anew();
        assert_eq!((valve.read(communication, 1), valve.read(mapping, 0)), (OFF | identifier, 0));

        valve.write_all(&[(mapping, 1, 4, 0x0007_0020), (mapping, 0, 1, 1)]);
        assert_eq!(valve.write(communication, 1, 4, identifier), Ok(()), "{communication:04X}");
    }
}
