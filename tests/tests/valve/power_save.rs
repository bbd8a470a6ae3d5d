//! Power save: without anything to do the solenoids are de-energised (SPEC 2).

use protocol_core::actuator::Led;

use super::valve::Command::{Float, Percent};
use super::valve::{FULL, NEUTRAL, Valve, each_valve};

const AT_WORK: (bool, Led) = (true, Led::GREEN);
const SAVING: (bool, Led) = (false, Led::GREEN_FLASHING);

fn shown(valve: &Valve) -> (bool, Led) {
    (valve.solenoids(), valve.rig.outputs().led)
}

/// In power save: the spool has been in neutral for 200 ms.
fn saving(valve: Valve) -> Valve {
    let mut valve = valve.commanded(NEUTRAL);
    valve.hold(NEUTRAL, 200);
    assert_eq!(shown(&valve), SAVING);
    valve
}

#[test]
fn a_set_point_ends_it_at_once() {
    each_valve(|valve| {
        for command in [Percent(1), Percent(-1), Float, FULL] {
            let mut valve = saving(valve.anew());
            valve.command(command);
            assert_eq!(shown(&valve), AT_WORK, "{command:?}");
            // neutral again: another 200 ms
            valve.drive(NEUTRAL, 199);
            assert_eq!(shown(&valve), AT_WORK, "{command:?}");
            valve.hold(NEUTRAL, 1);
            assert_eq!(shown(&valve), SAVING, "{command:?}");
        }
    });
}
