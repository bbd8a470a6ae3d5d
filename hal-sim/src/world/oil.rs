//! The effect of the oil temperature: cold oil is viscous and slows the spool down.

use protocol_core::actuator::SpoolTimes;

/// The factors for the spool times in percent, by temperature in °C (A). Values between two entries are interpolated.
/// Below the first entry and above the last entry, the nearest factor applies.
pub const OIL: [(i16, u32); 5] = [(-40, 400), (-20, 200), (0, 100), (60, 100), (100, 90)];

/// Returns the spool times at a temperature, limited to their valid range.
pub(super) fn at_temperature(times: SpoolTimes, temperature_c: i16) -> SpoolTimes {
    let percent = percent(temperature_c);
    let (min, max) = (u32::from(*SpoolTimes::RANGE_MS.start()), u32::from(*SpoolTimes::RANGE_MS.end()));
    // The range limits the value to u16.
    let scaled = |ms: u16| (u32::from(ms) * percent / 100).clamp(min, max) as u16;
    SpoolTimes::new(scaled(times.stroke_ms()), scaled(times.return_ms())).unwrap_or(times)
}

fn percent(temperature_c: i16) -> u32 {
    let above = OIL.iter().position(|(celsius, _)| temperature_c < *celsius);
    match above {
        Some(0) => OIL[0].1,
        None => OIL[OIL.len() - 1].1,
        Some(place) => {
            let ((from, low), (to, high)) = (OIL[place - 1], OIL[place]);
            let (passed, whole) = (i64::from(temperature_c - from), i64::from(to - from));
            // The value is between two factors.
            (i64::from(low) + (i64::from(high) - i64::from(low)) * passed / whole) as u32
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol_core::actuator::SpoolFault;
    use protocol_core::controller::BitRate;
    use protocol_core::device::pve;
    use protocol_core::time::Duration;

    use super::*;
    use crate::world::{Change, ClientPortId, NodeId, World};

    #[test]
    fn the_factor_by_temperature() {
        let factors = [-60, -40, -30, -20, -10, 0, 20, 60, 80, 100, 200].map(percent);
        assert_eq!(factors, [400, 400, 300, 200, 150, 100, 100, 100, 95, 90, 90]);
        let times = |stroke, spring| SpoolTimes::new(stroke, spring).expect("times");
        assert_eq!(at_temperature(times(250, 150), -20), times(500, 300));
        assert_eq!(at_temperature(times(4000, 10), -40), times(5000, 40), "within the range");
        assert_eq!(at_temperature(times(10, 10), 100), times(10, 10));
    }

    fn moving() -> (World, NodeId, ClientPortId) {
        let mut world = World::new(BitRate::Kbit250, 1);
        let valve = world.add("boom", pve::Kind::PveaCanopen);
        let master = world.add_client_port("master");
        world.power(valve, true);
        world.set_plant(valve, Change::Oil(true)).expect("a valve");
        world.run_for(Duration::from_millis(100));
        world.send(master, "000: 01 20".parse().expect("a frame"));
        (world, valve, master)
    }

    /// Returns the positions at intervals of 50 ms after a command of full stroke.
    fn stroke(temperature_c: i16) -> Vec<i16> {
        let (mut world, valve, master) = moving();
        world.set_plant(valve, Change::TemperatureC(temperature_c)).expect("a temperature");
        let mut positions = Vec::new();
        for _ in 0..12 {
            world.send(master, "220: 0F 00 00 40".parse().expect("a frame"));
            world.run_for(Duration::from_millis(50));
            positions.push(world.view(valve).expect("power").position);
        }
        positions
    }

    #[test]
    fn cold_oil_slows_the_spool_down() {
        assert_eq!(stroke(25), stroke(0));
        assert_eq!(stroke(25), stroke(60));
        let (usual, cold) = (stroke(25), stroke(-20));
        assert_eq!(usual[7], 16_384);
        assert!(cold[7] < 11_000 && cold[11] > cold[7], "{cold:?}");
    }

    /// Oil that warms up does not hold a drifting spool.
    #[test]
    fn a_spool_drifts_in_warming_oil() {
        let (mut world, valve, master) = moving();
        world.set_plant(valve, Change::Spool(SpoolFault::Drifting)).expect("a valve");
        for step in 0..3500_i16 {
            if step % 100 == 0 {
                world.send(master, "220: 0F 00 00 20".parse().expect("a frame"));
            }
            world.set_plant(valve, Change::TemperatureC(step / 175 - 20)).expect("a temperature");
            world.run_for(Duration::from_millis(1));
        }
        let faults = world.view(valve).expect("power").faults;
        assert!(faults.iter().any(|fault| fault.name == "spool-not-at-set-point" && fault.count == 1), "{faults:?}");
    }

    #[test]
    fn a_change_moves_nothing_and_is_reversible() {
        let (mut world, valve, master) = moving();
        let own = SpoolTimes::new(320, 210).expect("times");
        world.set_plant(valve, Change::Oil(false)).expect("a valve");
        let mut inputs = *world.inputs(valve);
        inputs.valve_mut().expect("a valve").spool.times = own;
        world.set_inputs(valve, inputs);
        // Twice has no further effect.
        world.set_plants(valve, &[Change::Oil(true), Change::Oil(true)]).expect("a valve");
        for _ in 0..5 {
            world.send(master, "220: 0F 00 00 40".parse().expect("a frame"));
            world.run_for(Duration::from_millis(30));
        }
        let before = world.view(valve).expect("power").position;
        world.set_plant(valve, Change::TemperatureC(-30)).expect("a temperature");
        assert_eq!(world.view(valve).expect("power").position, before);
        assert_eq!(
            world.inputs(valve).valve().expect("a valve").spool.times,
            SpoolTimes::new(960, 630).expect("times")
        );
        world.set_plant(valve, Change::TemperatureC(25)).expect("a temperature");
        assert_eq!(world.inputs(valve).valve().expect("a valve").spool.times, own);
        world.set_plant(valve, Change::TemperatureC(-30)).expect("a temperature");
        world.set_plant(valve, Change::Oil(false)).expect("a valve");
        assert_eq!(world.inputs(valve).valve().expect("a valve").spool.times, own);
    }
}
