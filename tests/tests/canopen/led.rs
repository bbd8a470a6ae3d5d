//! The LED, and the solenoids outside ACTIVE (SPEC 1, 2).

use protocol_core::actuator::{Color, Led, SpoolFault};
use protocol_core::controller::BusErrorMode;
use tests::Rig;

use super::blank;

const GREEN: (Color, bool) = (Color::Green, false);
const YELLOW: (Color, bool) = (Color::Yellow, false);
const RED: (Color, bool) = (Color::Red, false);
const RED_FLASHING: (Color, bool) = (Color::Red, true);

fn led(valve: &Rig) -> (Color, bool) {
    let Led { color, flashing } = valve.outputs().led;
    (color, flashing)
}

fn solenoids(valve: &Rig) -> bool {
    valve.outputs().solenoids
}

#[test]
fn yellow_while_disabled() {
    let mut valve = Rig::booted();
    assert_eq!(led(&valve), YELLOW, "INIT");
    valve.write(0x6040, 0, 2, 0x1).unwrap();
    assert_eq!(led(&valve), YELLOW, "DISABLED");
    valve.write(0x6040, 0, 2, 0x3).unwrap();
    assert_eq!(led(&valve), YELLOW, "HOLD");
    valve.write(0x6040, 0, 2, 0x7).unwrap();
    assert_eq!(led(&valve), GREEN, "ACTIVE");
    valve.write(0x6042, 0, 1, 2).unwrap();
    assert_eq!(led(&valve), YELLOW, "hand operation");
    assert_eq!(led(&blank()), YELLOW, "no node ID");
}

#[test]
fn red_in_fault_hold_without_a_fault() {
    let mut valve = Rig::booted();
    valve.send("000: 82 00");
    valve.take();
    assert_eq!((valve.read(0x1001, 0), led(&valve)), (0, RED_FLASHING));
}

/// FAULT_HOLD comes before the missing node ID in the order.
#[test]
fn red_in_fault_hold_without_a_node_id() {
    let mut valve = blank();
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(led(&valve), RED);
    valve.sense(|inputs| inputs.internal_fault = false);
    assert_eq!(led(&valve), RED_FLASHING);
}

/// Each fault alone, then with the internal error, then with bus-off, which wins over all.
#[test]
fn the_order_of_the_faults() {
    let mut valve = Rig::booted();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance(250);
    assert_eq!(led(&valve), RED_FLASHING, "temperature");
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(led(&valve), RED, "the internal error is of higher priority");
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    assert_eq!(led(&valve), RED, "bus-off");
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    assert_eq!(led(&valve), RED_FLASHING);

    // a fault of the spool is of higher priority than the internal error, and bus-off wins over it
    let mut valve = Rig::active();
    valve.send("220: 0F 00 00 40");
    valve.advance_cyclic(300, "220: 0F 00 00 40");
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    valve.advance_cyclic(600, "220: 0F 00 00 00");
    valve.take();
    assert_eq!((valve.read(0x1001, 0), led(&valve)), (0x21, RED_FLASHING));
    valve.sense(|inputs| inputs.internal_fault = true);
    assert_eq!(led(&valve), RED_FLASHING);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    assert_eq!(led(&valve), RED);
}

#[test]
fn outside_active_the_solenoids_are_off_at_once() {
    let ways: [fn(&mut Rig); 5] = [
        |valve| valve.send("220: 03 00 00 40"),
        |valve| valve.send("000: 02 00"),
        |valve| valve.write(0x6042, 0, 1, 2).unwrap(),
        |valve| valve.sense(|inputs| inputs.internal_fault = true),
        |valve| valve.send("000: 81 00"),
    ];
    for way in ways {
        let mut valve = Rig::active();
        valve.send("220: 0F 00 00 40");
        valve.take();
        assert!(solenoids(&valve));
        way(&mut valve);
        assert!(!solenoids(&valve));
    }
}
