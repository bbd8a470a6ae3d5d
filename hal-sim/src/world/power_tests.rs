//! The mechanics outlast the electronics: without power, springs, jams and hands move the spool (SPEC 2).

use protocol_core::actuator::SpoolFault;
use protocol_core::controller::BitRate;

use super::*;
use crate::devices::{DeviceSpec, named};
use crate::memory::Memory;
use crate::world::{Change, ClientPortId, Link};

/// A valve, a sensor and a master.
struct Rig {
    world: World,
    valve: NodeId,
    sensor: NodeId,
    master: ClientPortId,
}

impl Rig {
    /// Creates a rig without power.
    fn new(valve: &str) -> Self {
        let specs: Vec<DeviceSpec> = [valve, "hat1000,bit-rate=250k"].map(|spec| spec.parse().expect(spec)).into();
        let mut world = World::new(BitRate::Kbit250, 1);
        let master = world.add_client_port("master");
        let nodes: Vec<NodeId> =
            named(specs).expect("names").iter().map(|device| device.add_to(&mut world, Memory::in_ram())).collect();
        let [valve, sensor] = nodes[..] else { panic!("two devices") };
        Self { world, valve, sensor, master }
    }

    /// Creates a rig whose valve is at full stroke, with this fault of its spool.
    fn open(valve: &str, fault: SpoolFault) -> Self {
        let mut rig = Self::new(valve);
        rig.world.power_all(Duration::from_ticks(0));
        rig.pass(2_500);
        rig.drive();
        assert_eq!(rig.position(), 16_384);
        rig.set(Change::Spool(fault));
        rig
    }

    /// Drives the valve to full stroke.
    fn drive(&mut self) {
        let frames = match self.world.name(self.valve).ends_with("isobus") {
            true => ["0CFE3027: FA FF 31 FF FF FF FF FF"; 2],
            false => ["000: 01 20", "220: 0F 00 00 40"],
        };
        for _ in 0..10 {
            for frame in frames {
                self.world.send(self.master, frame.parse().expect(frame));
            }
            self.pass(50);
        }
    }

    fn pass(&mut self, ms: u64) {
        self.world.run_for(Duration::from_millis(ms));
    }

    fn set(&mut self, change: Change) {
        self.world.set_plant(self.valve, change).expect("a valve");
    }

    fn position(&self) -> i16 {
        let position = self.world.spool_position(self.valve).expect("a valve");
        if let Some(view) = self.world.view(self.valve) {
            assert_eq!(view.position, position);
        }
        position
    }

    /// Compares the position with the expected one after each of these times. A new program knows the position to one
    /// unit.
    fn moves<const N: usize>(&mut self, steps: [(u64, i16); N]) {
        for (ms, expected) in steps {
            self.pass(ms);
            let position = self.position();
            assert!((position - expected).abs() <= 1, "{ms} ms: {position}, not {expected}");
        }
    }

    /// Resets the processor, or cuts its power: for ever, for an instant, or by a low supply.
    fn interrupt(&mut self, by: &str) {
        match by {
            "watchdog" => self.world.power_with(self.valve, StartCause::Watchdog),
            "off" => self.world.power(self.valve, false),
            "off and on" => {
                self.world.power(self.valve, false);
                self.world.power(self.valve, true);
            }
            "brown-out" => {
                self.set(Change::SupplyMv(6_000));
                assert!(!self.world.is_powered(self.valve));
                self.set(Change::SupplyMv(24_000));
            }
            _ => unreachable!("{by}"),
        }
    }
}

const INTERRUPTIONS: [&str; 4] = ["watchdog", "off", "off and on", "brown-out"];
const VALVES: [&str; 3] = [
    "pvea-canopen,brown-out-mv=7000",
    "pveo-canopen,brown-out-mv=7000,boot-ms=100",
    "pvea-isobus,brown-out-mv=7000,boot-ms=2000",
];

#[test]
fn springs_return_the_spool_in_their_time() {
    for (valve, by) in VALVES.into_iter().flat_map(|valve| INTERRUPTIONS.map(|by| (valve, by))) {
        let mut rig = Rig::open(valve, SpoolFault::None);
        rig.interrupt(by);
        rig.moves([(0, 16_384), (75, 8_192), (74, 109), (1, 0), (500, 0)]);
    }
    // A valve on ISOBUS that starts at once is blocked: its solenoids bring the spool to neutral.
    let mut rig = Rig::open("pvea-isobus", SpoolFault::None);
    rig.interrupt("off and on");
    rig.moves([(0, 16_384), (125, 8_192), (125, 0)]);
    // The power comes and goes on the way.
    let mut rig = Rig::open("pvea-canopen", SpoolFault::None);
    for expected in [10_923, 5_461, 0] {
        rig.interrupt("off");
        rig.pass(25);
        rig.interrupt("off and on");
        rig.moves([(25, expected)]);
    }
    let mut rig = Rig::open("pvea-canopen,return-ms=600", SpoolFault::None);
    rig.interrupt("off");
    rig.moves([(300, 8_192), (300, 0)]);
}

#[test]
fn a_stuck_spool_stays_and_a_slow_one_is_slow() {
    for (valve, by) in VALVES.into_iter().flat_map(|valve| INTERRUPTIONS.map(|by| (valve, by))) {
        let mut rig = Rig::open(valve, SpoolFault::Stuck);
        rig.interrupt(by);
        rig.moves([(0, 16_384), (100, 16_384), (1_700, 16_384)]);
        rig.set(Change::Spool(SpoolFault::None));
        rig.moves([(75, 8_192), (75, 0)]);

        let mut rig = Rig::open(valve, SpoolFault::Slow);
        rig.interrupt(by);
        rig.moves([(600, 8_192), (600, 0)]);
    }
}

/// The fault of a spool that is stuck open is found again after the reset.
#[test]
fn a_restarted_valve_finds_its_spool_stuck() {
    let mut rig = Rig::open("pvea-isobus", SpoolFault::Stuck);
    rig.interrupt("off and on");
    rig.pass(600);
    let is_active = |rig: &Rig| {
        let view = rig.world.view(rig.valve).expect("power");
        view.faults.iter().any(|fault| fault.name == "spool-not-at-set-point" && fault.active)
    };
    assert!(is_active(&rig));
    rig.set(Change::Spool(SpoolFault::None));
    rig.pass(150);
    assert!(!is_active(&rig));
}

#[test]
fn a_hand_moves_the_spool_without_power() {
    // Before the first start, and after the last.
    for mut rig in [Rig::new("pvea-canopen"), Rig::open("pvea-canopen", SpoolFault::None)] {
        rig.interrupt("off");
        rig.set(Change::Lever(Some(-8_192)));
        rig.moves([(0, -8_192), (100, -8_192)]);
        rig.set(Change::Lever(None));
        rig.moves([(25, -5_461), (50, 0)]);
        rig.set(Change::Lever(Some(4_096)));
        rig.interrupt("off and on");
        rig.moves([(0, 4_096), (100, 4_096)]);
    }
}

#[test]
fn a_linked_shaft_follows_the_spool_without_power() {
    for by in INTERRUPTIONS {
        let mut rig = Rig::open("pvea-canopen,brown-out-mv=7000", SpoolFault::None);
        rig.world.link(rig.valve, rig.sensor, Link::default()).expect("a valve and a sensor");
        rig.interrupt(by);
        rig.pass(1_000);
        // 75 ms of full flow: 30 degrees a second.
        assert_eq!(rig.world.angle_cdeg(rig.sensor), Some(225), "{by}");

        let mut rig = Rig::open("pvea-canopen,brown-out-mv=7000", SpoolFault::Stuck);
        rig.world.link(rig.valve, rig.sensor, Link::default()).expect("a valve and a sensor");
        rig.interrupt(by);
        rig.pass(1_000);
        assert_eq!(rig.world.angle_cdeg(rig.sensor), Some(3_000), "{by}");
    }
}

/// The next change of the position is predicted without power as with power.
#[test]
fn the_next_position_without_power() {
    let mut rig = Rig::open("pvea-canopen", SpoolFault::None);
    rig.interrupt("off");
    let limit = after(rig.world.now(), Duration::from_secs(1));
    let first = after(rig.world.now(), Duration::from_micros(1));
    assert_eq!(rig.world.next_position(rig.valve, limit), first);
    rig.world.run_until(rig.world.next_inside(rig.valve, &(0..=0), limit));
    assert_eq!(rig.position(), 0);
    rig.pass(1);
    assert_eq!(rig.world.next_position(rig.valve, limit), limit);
}
