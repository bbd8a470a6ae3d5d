//! Spools with noise and a dead-band, shafts with play and noise, and rough links.

use protocol_core::controller::BitRate;
use protocol_core::time::after;

use super::*;
use crate::devices::{DeviceSpec, named};
use crate::memory::Memory;
use crate::world::{Change, ClientPortId, Link};

/// A valve that a master keeps active, and a sensor.
#[derive(Clone)]
struct Rig {
    world: World,
    valve: NodeId,
    sensor: NodeId,
    master: ClientPortId,
}

impl Rig {
    fn new(valve: &str, sensor: &str, link: Option<Link>) -> Self {
        let specs: Vec<DeviceSpec> = [valve, sensor].map(|spec| spec.parse().expect(spec)).into();
        let mut world = World::new(BitRate::Kbit250, 1);
        let master = world.add_client_port("master");
        let nodes: Vec<NodeId> =
            named(specs).expect("names").iter().map(|device| device.add_to(&mut world, Memory::in_ram())).collect();
        let [valve, sensor] = nodes[..] else { panic!("two devices") };
        if let Some(link) = link {
            world.link(valve, sensor, link).expect("a valve and a sensor");
        }
        nodes.iter().for_each(|node| world.power(*node, true));
        world.run_for(Duration::from_millis(100));
        let mut rig = Self { world, valve, sensor, master };
        rig.send("000: 01 20");
        for _ in 0..3 {
            rig.send("220: 0F 00 00 00");
        }
        rig
    }

    fn send(&mut self, frame: &str) {
        self.world.send(self.master, frame.parse().expect(frame));
        self.world.run_for(Duration::from_millis(5));
    }

    /// Holds a set-point for `periods` periods of 50 ms. Returns the spool position every 5 ms.
    fn hold(&mut self, set_point: i16, periods: usize) -> Vec<i16> {
        let [low, high] = set_point.to_le_bytes();
        let mut positions = Vec::new();
        for _ in 0..periods {
            self.send(&format!("220: 0F 00 {low:02X} {high:02X}"));
            for _ in 0..9 {
                self.world.run_for(Duration::from_millis(5));
                positions.push(self.world.view(self.valve).expect("power").position);
            }
        }
        positions
    }

    /// Turns the shaft. Returns the measured angle, in steps of the sensor.
    fn turn(&mut self, angle_cdeg: u32) -> i16 {
        self.world.set_plant(self.sensor, Change::AngleCdeg(angle_cdeg)).expect("an angle");
        self.seen()
    }

    fn seen(&mut self) -> i16 {
        self.world.view(self.sensor).expect("power").position
    }
}

const SENSOR: &str = "hat1000,bit-rate=250k";

fn position(angle_cdeg: u32) -> i16 {
    Shaft::at(angle_cdeg).position_at(Instant::from_ticks(0)) as i16
}

#[test]
fn noise_is_within_its_limits_and_changes_every_step() {
    let at = |ms| Instant::from_millis(ms);
    let values: Vec<i32> = (0..1000).map(|step| noise(7, 5, at(10 * step))).collect();
    assert!((-5..=5).all(|value| values.contains(&value)) && values.iter().all(|value| value.abs() <= 5));
    assert!(values.iter().sum::<i32>().abs() < 400, "no direction is preferred");
    assert_eq!(noise(7, 5, at(19)), noise(7, 5, at(10)));
    assert_eq!(noise(7, 0, at(19)), 0);
    assert_ne!(values, (0..1000).map(|step| noise(8, 5, at(10 * step))).collect::<Vec<_>>(), "another seed");
    assert_eq!([0, 9, 10].map(|ms| next_step(at(ms))), [10, 10, 20].map(at));
    assert_eq!(next_step(NEVER), NEVER);
}

#[test]
fn a_spool_trembles_about_its_set_point() {
    let run = |valve: &str| {
        let mut rig = Rig::new(valve, SENSOR, None);
        rig.hold(8192, 8);
        (rig.hold(8192, 8), rig.hold(0, 8))
    };
    let (smooth, _) = run("pvea-canopen");
    assert!(smooth.iter().all(|position| *position == 8192));
    let (rough, _) = run("pvea-canopen,noise=200");
    assert!(rough.iter().all(|position| (position - 8192).abs() <= 200), "{rough:?}");
    assert!(
        rough.iter().any(|position| *position > 8250) && rough.iter().any(|position| *position < 8150),
        "{rough:?}"
    );
    assert_eq!(run("pvea-canopen,noise=200").0, rough, "the same seed");
}

#[test]
fn a_spool_does_not_follow_small_changes() {
    let mut rig = Rig::new("pvea-canopen,dead-band=100", SENSOR, None);
    rig.hold(8192, 8);
    assert_eq!(rig.hold(8292, 4).last(), Some(&8192));
    assert_eq!(rig.hold(8293, 4).last(), Some(&8293));
    assert_eq!(rig.hold(8193, 4).last(), Some(&8293));
    assert_eq!(rig.hold(8192, 4).last(), Some(&8192));
}

#[test]
fn a_trembling_spool_in_the_monitors_tolerance_is_no_fault() {
    let mut rig = Rig::new("pvea-canopen,noise=800,dead-band=300", SENSOR, None);
    for set_point in [8192, -8192, 16_384, 200] {
        rig.hold(set_point, 30);
    }
    let faults = rig.world.view(rig.valve).expect("power").faults;
    assert!(faults.iter().all(|fault| !fault.active), "{faults:?}");
}

/// New inputs do not change the roughness.
#[test]
fn new_inputs_do_not_make_a_spool_smooth() {
    let mut rig = Rig::new("pvea-canopen,dead-band=100", SENSOR, None);
    let kind = protocol_core::device::pve::Kind::PveaCanopen;
    rig.world.set_inputs(rig.valve, Inputs::healthy(kind.into()));
    rig.hold(8192, 8);
    assert_eq!(rig.hold(8292, 4).last(), Some(&8192));
}

#[test]
fn a_shaft_has_play() {
    let mut rig = Rig::new("pvea-canopen", &format!("{SENSOR},dead-band=100"), None);
    assert_eq!(rig.turn(0), position(0));
    for (turned, seen) in
        [(100, 0), (150, 50), (9_000, 8_900), (8_900, 8_900), (8_801, 8_900), (8_700, 8_800), (50, 150)]
    {
        assert_eq!(rig.turn(turned), position(seen), "{turned}");
    }
    // Across 0, the shorter way round.
    assert_eq!(rig.turn(35_900), position(0));
    assert_eq!(rig.turn(35_800), position(35_900));
    assert_eq!(rig.world.angle_cdeg(rig.sensor), Some(35_800), "the plant has the angle of the shaft");
}

/// The sensor follows behind, however far the shaft turns between two looks.
#[test]
fn a_turning_shaft_has_play() {
    for (speed_rpm, play) in [(10, -500), (-10, 500), (3_000, -500), (1, -9_000), (-1, 9_000)] {
        let mut rig = Rig::new("pvea-canopen", &format!("{SENSOR},dead-band={}", i32::abs(play)), None);
        rig.world.set_plant(rig.sensor, Change::SpeedRpm(speed_rpm)).expect("a speed");
        rig.world.run_for(Duration::from_secs(30));
        for ms in [1, 1_000, 4_000, 3_500, 5_999, 59_999, 3_600_000] {
            rig.world.run_for(Duration::from_millis(ms));
            let angle = rig.world.angle_cdeg(rig.sensor).expect("a shaft");
            let behind = (i64::from(angle) + i64::from(play)).rem_euclid(36_000);
            assert_eq!(rig.seen(), position(behind as u32), "{speed_rpm} rpm, {ms} ms");
        }
    }
}

/// The shaft reverses, jumps and turns between two cycles of the sensor, and while the sensor has no power.
#[test]
fn the_play_of_a_shaft_that_no_sensor_samples() {
    let mut rig = Rig::new("pvea-canopen", &format!("{SENSOR},dead-band=500,cycle-ms=1000"), None);
    let mut turn = |speed_rpm, ms| {
        rig.world.set_plant(rig.sensor, Change::SpeedRpm(speed_rpm)).expect("a speed");
        rig.world.run_for(Duration::from_millis(ms));
        rig.world.set_plant(rig.sensor, Change::SpeedRpm(0)).expect("a speed");
        rig.world.angle_cdeg(rig.sensor).expect("a shaft")
    };
    assert_eq!([turn(10, 200), turn(-10, 100)], [1_200, 600]);
    rig.world.run_for(Duration::from_secs(1));
    assert_eq!(rig.seen(), position(700));
    rig.world.power(rig.sensor, false);
    rig.world.set_plants(rig.sensor, &[Change::AngleCdeg(2_000), Change::SpeedRpm(5)]).expect("both");
    rig.world.run_for(Duration::from_millis(100));
    rig.world.set_plant(rig.sensor, Change::AngleCdeg(1_600)).expect("an angle");
    rig.world.power(rig.sensor, true);
    assert_eq!(rig.seen(), position(1_800));
}

/// The play of a linked shaft depends on the path of the shaft, whether or not the sensor samples this path.
#[test]
fn a_linked_shaft_has_play() {
    for (samples, dead_band) in [(false, 500), (true, 500), (false, 9_000), (true, 9_000)] {
        let link = Link { rate: 36_000, max: 35_000, dead_band: 1_000, ..Link::default() };
        let mut rig = Rig::new("pvea-canopen", &format!("{SENSOR},dead-band={dead_band}"), Some(link));
        let angle = |rig: &Rig| i64::from(rig.world.angle_cdeg(rig.sensor).expect("a shaft"));
        let mut behind = angle(&rig);
        for (set_point, periods) in [(16_384, 18), (-16_384, 6), (4_000, 8), (-16_384, 20), (9_000, 7), (-3_000, 6)] {
            let [low, high] = i16::to_le_bytes(set_point);
            for _ in 0..periods {
                rig.world.send(rig.master, format!("220: 0F 00 {low:02X} {high:02X}").parse().expect("a frame"));
                if samples {
                    rig.world.send(rig.master, READ_POSITION.parse().expect("a frame"));
                }
                for _ in 0..500 {
                    rig.world.run_for(Duration::from_micros(100));
                    behind = behind.clamp(angle(&rig) - dead_band, angle(&rig) + dead_band);
                }
            }
            let expected = position(behind.rem_euclid(36_000) as u32);
            let near = |found: i16| (found - expected).abs() <= 1;
            assert!(near(rig.seen()), "{} for {expected}", rig.seen());
            if samples {
                let frames: Vec<_> = rig.world.take_received(rig.master).map(|(_, frame)| frame).collect();
                assert!(frames.iter().any(|frame| frame.to_string().starts_with("581: 43 04 60 00")), "{frames:?}");
            }
        }
    }
}

const READ_POSITION: &str = "601: 40 04 60 00 00 00 00 00";

#[test]
fn a_sensor_measures_with_noise() {
    let mut rig = Rig::new("pvea-canopen", &format!("{SENSOR},noise=20"), None);
    rig.turn(9_000);
    let mut seen = Vec::new();
    for _ in 0..200 {
        rig.world.run_for(Duration::from_millis(10));
        seen.push(rig.seen());
    }
    let (min, max) = (seen.iter().min().expect("some"), seen.iter().max().expect("some"));
    assert!(*min >= position(8_980) && *max <= position(9_020) && max - min > 12, "{min} to {max}");
    assert_eq!(rig.world.angle_cdeg(rig.sensor), Some(9_000));
}

/// The predicted instant of the next position is correct.
#[test]
fn the_next_position_is_found() {
    for sensor in [",noise=500", ",noise=20,dead-band=300"] {
        let mut rig = Rig::new("pvea-canopen", &format!("{SENSOR}{sensor}"), None);
        rig.world.set_plant(rig.sensor, Change::SpeedRpm(7)).expect("a speed");
        for _ in 0..300 {
            let here = rig.seen();
            let next = rig.world.next_position(rig.sensor, after(rig.world.now(), Duration::from_millis(500)));
            let last = Instant::from_ticks(next.as_ticks() - 1);
            if last > rig.world.now() {
                rig.world.run_until(last);
                assert_eq!(rig.seen(), here, "{sensor}");
            }
            rig.world.run_until(next);
        }
    }
}

#[test]
fn within_the_dead_band_of_a_link_nothing_flows() {
    let link = Link { rate: 9_000, max: 35_000, dead_band: 4096, ..Link::default() };
    let mut rig = Rig::new("pvea-canopen", SENSOR, Some(link));
    rig.hold(4096, 20);
    assert_eq!(rig.world.angle_cdeg(rig.sensor), Some(0));
    // A third of the stroke beyond the band: a third of the rate.
    rig.hold(8192, 10);
    let before = rig.world.angle_cdeg(rig.sensor).expect("a shaft");
    rig.hold(8192, 20);
    assert_eq!(rig.world.angle_cdeg(rig.sensor), Some(before + 3_000));
    // The way back is that through neutral.
    rig.hold(-4096, 20);
    let at_rest = rig.world.angle_cdeg(rig.sensor);
    rig.hold(-4096, 5);
    assert_eq!(rig.world.angle_cdeg(rig.sensor), at_rest);
}

/// A link has its rate at full stroke, whatever its dead-band.
#[test]
fn the_rate_of_a_link_is_that_at_full_stroke() {
    for (dead_band, rate, a_second) in
        [(0, 3_000, 3_000), (1, 3_000, 3_000), (8_192, -3_001, -3_001), (16_383, 3_000, 3_000), (16_384, 3_000, 0)]
    {
        let link = Link { rate, max: 35_000, dead_band, ..Link::default() };
        let mut rig = Rig::new("pvea-canopen", SENSOR, Some(link));
        rig.world.set_plant(rig.sensor, Change::AngleCdeg(20_000)).expect("an angle");
        rig.hold(16_384, 6);
        let angle = |rig: &Rig| rig.world.angle_cdeg(rig.sensor).expect("a shaft") as i32;
        let before = angle(&rig);
        rig.hold(16_384, 20);
        assert_eq!(angle(&rig) - before, a_second, "{dead_band}");
    }
}

/// The angles of a link and of its sensor do not depend on how often they are read. The shaft reverses within its play,
/// and the sensor itself samples its shaft only at the end.
#[test]
fn reading_a_rough_link_or_a_rough_shaft_changes_nothing() {
    let smooth = Link { rate: 9_000, max: 35_000, ..Link::default() };
    let rough = Link { noise: 50, dead_band: 1_000, ..smooth };
    for (valve, noise, link) in [("pvea-canopen", 0, smooth), ("pvea-canopen,noise=100,dead-band=50", 30, rough)] {
        let sensor = format!("{SENSOR},noise={noise},dead-band=500");
        let run = |reads: bool| {
            let mut rig = Rig::new(valve, &sensor, Some(link));
            rig.world.record_events(true);
            for set_point in [8_000, -3_000, 4_000, -3_000] {
                let [low, high] = i16::to_le_bytes(set_point);
                for _ in 0..2 {
                    rig.send(&format!("220: 0F 00 {low:02X} {high:02X}"));
                    for _ in 0..100 {
                        rig.world.run_for(Duration::from_millis(1));
                        if reads {
                            rig.seen();
                            let _ = rig.world.next_position(rig.sensor, NEVER);
                        }
                    }
                }
            }
            rig.send(READ_POSITION);
            let events: Vec<String> = rig.world.take_events().map(|event| format!("{event:?}")).collect();
            (rig.world.angle_cdeg(rig.sensor), rig.seen(), events)
        };
        let (angle, seen, events) = run(false);
        assert!(events.iter().any(|event| event.contains("581")), "{events:?}");
        assert_eq!((angle, seen, events), run(true), "{valve}");
    }
}

#[test]
fn a_clone_goes_on_alike() {
    let link = Link { noise: 50, dead_band: 1_000, ..Link::default() };
    let mut original = Rig::new("pvea-canopen,noise=300", &format!("{SENSOR},noise=30,dead-band=70"), Some(link));
    original.hold(8_192, 3);
    let mut clone = original.clone();
    let ends = [&mut original, &mut clone].map(|rig| (rig.hold(-8_192, 20), rig.seen()));
    assert_eq!(ends[0], ends[1]);
}

#[test]
fn what_is_too_rough_is_refused() {
    for (device, reason) in [
        ("pvea-canopen,noise=16385", "'16385' is not a valid noise; accepted: 0–16384, 16384 is full stroke"),
        ("hat1000,dead-band=9001", "'9001' is not a valid dead-band; accepted: 0–9000, in 1/100 degree"),
        ("hat1000,noise", "'noise' needs a value"),
    ] {
        let refused = device.parse::<DeviceSpec>().expect_err(device);
        assert!(refused.starts_with(reason), "{refused}");
    }
}

/// A spool that does not hold its position is found by monitor 1, rough or not.
#[test]
fn a_rough_spool_drifts() {
    for (valve, set_point) in [
        ("pvea-canopen,noise=1", 8192),
        ("pvea-canopen,noise=1", 13_107),
        ("pvea-canopen,noise=1000,stroke-ms=500", 8192),
        ("pvea-canopen,noise=1000,stroke-ms=500,dead-band=5", 8192),
    ] {
        let mut rig = Rig::new(valve, SENSOR, None);
        let drifting = Change::Spool(actuator::SpoolFault::Drifting);
        rig.world.set_plant(rig.valve, drifting).expect("a valve");
        rig.hold(set_point, 60);
        let faults = rig.world.view(rig.valve).expect("power").faults;
        let is_found = faults.iter().any(|fault| fault.name == "spool-not-at-set-point" && fault.count == 1);
        assert!(is_found, "{valve}, {set_point}: {faults:?}");
    }
}
