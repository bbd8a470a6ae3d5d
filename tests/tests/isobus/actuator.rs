//! The actuator under ISOBUS: power save, hand operation, emergency stop, LED (SPEC 1, 2, 5).

use protocol_core::actuator::{Led, Position, SpoolFault};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, EXTEND, FLOAT, HAND, LOWER_NAME, RETRACT, STOP};

const ONE: Duration = Duration::from_micros(1);
const NOTHING: &str = "0CFE3327: 00 FF 31 FF FF FF FF FF";

fn solenoids(valve: &Rig) -> bool {
    valve.outputs().solenoids
}

fn led(valve: &Rig) -> Led {
    valve.outputs().led
}

/// 200 ms after power-up, before any command: the valve is blocked from the beginning.
#[test]
fn power_save_from_the_beginning() {
    let mut valve = Rig::power_on(Setup::new(Kind::PveaIsobus));
    assert!(solenoids(&valve));
    assert_eq!(led(&valve), Led::GREEN);
    valve.advance_by(Duration::from_micros(199_999));
    assert!(solenoids(&valve));
    valve.advance_by(ONE);
    assert!(!solenoids(&valve));
    assert_eq!(led(&valve), Led::GREEN_FLASHING);
}

/// Any command that is not neutral ends it at once; another neutral one does not.
#[test]
fn what_ends_power_save() {
    for (command, energised) in [
        (BLOCK, false),
        (NOTHING, false),
        ("0CFE3327: 00 FF 32 FF FF FF FF FF", false),
        ("0CFE3327: 01 FF 31 FF FF FF FF FF", true),
        ("0CFE3327: 01 FF 32 FF FF FF FF FF", true),
        (FLOAT, true),
        (HAND, false),
        (STOP, false),
    ] {
        let mut valve = Rig::claimed();
        assert!(!solenoids(&valve));
        valve.send(command);
        assert_eq!(solenoids(&valve), energised, "{command}");
        assert_eq!(led(&valve) == Led::GREEN, energised, "{command}");
    }
}

#[test]
fn hand_operation() {
    let mut valve = Rig::extending(300);
    assert!(solenoids(&valve));
    valve.send(HAND);
    assert!(!solenoids(&valve));
    assert_eq!(led(&valve), Led::YELLOW);
    // the springs bring it back
    assert_eq!(valve.flow(), [0xE1, 0x7D, 0x3A]);
    valve.advance_cyclic(150, HAND);
    assert_eq!(valve.flow(), [0x7D, 0x7D, 0x3A]);
    // a lever, a stuck spool: for as long as it likes
    for position in [16384, -16384, 3000] {
        valve.sense(|inputs| inputs.spool.lever = Position::new(position));
        valve.advance_cyclic(3000, HAND);
    }
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    valve.advance_cyclic_news(3000, HAND, &[]);
    valve.send("18EA8327: CB FE 00");
    valve.expect_news(&["18FECB83: 00 FF 00 00 00 00 FF FF"]);
}

/// They end with the next valid command of another state, and the monitors begin anew then.
#[test]
fn the_end_of_hand_operation_and_emergency_stop() {
    for command in [HAND, STOP] {
        let mut valve = Rig::claimed();
        valve.send(command);
        valve.sense(|inputs| inputs.spool.lever = Position::new(8192));
        valve.advance_cyclic(2000, command);
        // what is ignored ends nothing
        valve.send_all(&["0CFE3327: FB FF 31 FF FF FF FF FF", "0CFE3327: 00 FF 34 FF FF FF FF FF"]);
        assert_eq!(valve.flow()[2], if command == HAND { 0x3A } else { 0x3E });
        valve.send(BLOCK);
        assert_eq!(valve.flow(), [0xAF, 0x7D, 0x30]);
        valve.advance_cyclic_news(499, BLOCK, &[]);
        valve.advance_news(1, &["18FECA83: 10 FF EC 8F 87 01 FF FF"]);

        for (next, state) in [(EXTEND, 0x31), (RETRACT, 0x32), (FLOAT, 0x33), (HAND, 0x3A), (STOP, 0x3E)] {
            let mut valve = Rig::claimed();
            valve.send(command);
            valve.advance(100);
            valve.send(next);
            assert_eq!(valve.flow()[2], state);
            assert_eq!(solenoids(&valve), state <= 0x33);
        }
    }
}

#[test]
fn emergency_stop() {
    let mut valve = Rig::claimed();
    valve.send(RETRACT);
    valve.advance_cyclic(300, RETRACT);
    valve.send(STOP);
    assert!(!solenoids(&valve));
    assert_eq!(led(&valve), Led::YELLOW);
    assert_eq!(valve.flow(), [0x7D, 0xE1, 0x3E]);
    valve.advance_cyclic(150, STOP);
    assert_eq!(valve.flow(), [0x7D, 0x7D, 0x3E]);
    valve.advance_cyclic_news(5000, STOP, &[]);
    // straight back to work
    valve.send(EXTEND);
    assert!(solenoids(&valve));
    assert_eq!(led(&valve), Led::GREEN);
}

#[test]
fn the_led() {
    let mut valve = Rig::claimed();
    assert_eq!(led(&valve), Led::GREEN_FLASHING, "power save");
    valve.send(EXTEND);
    assert_eq!(led(&valve), Led::GREEN);
    valve.advance(250);
    assert_eq!(led(&valve), Led::RED_FLASHING, "time guarding");
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(led(&valve), Led::RED, "internal error");
    valve.sense(|inputs| inputs.internal_fault = false);
    assert_eq!(led(&valve), Led::RED_FLASHING);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    assert_eq!(led(&valve), Led::RED, "bus-off");
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    valve.advance_cyclic(200, EXTEND);
    assert_eq!(led(&valve), Led::RED_FLASHING, "shut down without an active fault");
    valve.recover();
    assert_ne!(led(&valve), Led::RED_FLASHING);
    valve.advance_cyclic(300, BLOCK);
    assert_eq!(led(&valve), Led::GREEN_FLASHING);
    valve.send(LOWER_NAME);
    assert_eq!(led(&valve), Led::YELLOW, "cannot claim");
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(led(&valve), Led::RED, "a fault comes first");
}
