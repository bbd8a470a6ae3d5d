//! Power save: without anything to do the solenoids are de-energised.

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

/// From 20 % the spool needs 37.5 ms to come within 5 %, and the 200 ms count from there.
#[test]
fn it_begins_after_200_ms_in_neutral() {
    each_valve(|valve| {
        let mut valve = valve.commanded(Percent(20));
        valve.hold(Percent(20), 200);
        valve.drive(NEUTRAL, 237);
        assert_eq!(shown(&valve), AT_WORK);
        valve.hold(NEUTRAL, 1);
        assert_eq!(shown(&valve), SAVING);
        valve.hold(NEUTRAL, 1000);
        assert_eq!(shown(&valve), SAVING);
    });
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

#[test]
fn a_spool_that_moves_ends_it_at_once() {
    each_valve(|valve| {
        let mut valve = saving(valve);
        valve.lever(Some(4000));
        assert_eq!(shown(&valve), AT_WORK);
        valve.lever(None);
        assert_eq!(valve.hold(NEUTRAL, 400), [""; 0]);
        assert_eq!(shown(&valve), SAVING, "and it begins again");
    });
}
