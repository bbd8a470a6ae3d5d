//! Slow devices and weak supplies, to the microsecond.

use protocol_core::controller::BitRate;
use protocol_core::device::pve::Kind;

use super::*;
use crate::devices::{DeviceSpec, NamedDevice, named};
use crate::memory::Memory;
use crate::world::{Change, ClientPortId, EventKind, Link, NodeId, World};

/// A world with a device and a master.
struct Rig {
    world: World,
    device: NodeId,
    master: ClientPortId,
}

impl Rig {
    fn new(device: &str) -> Self {
        let spec: DeviceSpec = device.parse().unwrap_or_else(|error| panic!("{device}: {error}"));
        let device: NamedDevice = named(vec![spec]).expect("a name").remove(0);
        let mut world = World::new(BitRate::Kbit250, 1);
        world.record_events(true);
        let master = world.add_client_port("master");
        let node = device.add_to(&mut world, Memory::in_ram());
        Self { world, device: node, master }
    }

    /// Creates a rig whose device has been powered for one second.
    fn started(device: &str) -> Self {
        let mut rig = Self::new(device);
        rig.world.power(rig.device, true);
        rig.frames(1000);
        rig
    }

    /// Advances time by `ms` milliseconds. Returns the device's frames with their start times in µs.
    fn frames(&mut self, ms: u64) -> Vec<(u64, String)> {
        let name = self.world.name(self.device).to_owned();
        self.world.run_for(Duration::from_millis(ms));
        let frames =
            self.world.take_events().filter(|event| *event.who == *name).filter_map(|event| match event.what {
                EventKind::Frame { frame, start } => Some((start.as_micros(), frame.to_string())),
                _ => None,
            });
        frames.collect()
    }

    /// Sends a frame. Returns its end time in µs; nothing else is sent afterwards.
    fn send(&mut self, frame: &str) -> u64 {
        self.world.send(self.master, frame.parse().expect(frame));
        while self.world.pending(self.master) > 0 {
            self.world.step();
        }
        self.world.now().as_micros()
    }

    fn set(&mut self, plants: &[Change]) {
        self.world.set_plants(self.device, plants).expect("a valve");
    }

    fn supply(&mut self, mv: u32) {
        self.world.set_plant(self.device, Change::SupplyMv(mv)).expect("a supply");
    }
}

const READ_VENDOR: &str = "620: 40 18 10 01 00 00 00 00";

#[test]
fn a_device_starts_late() {
    let at = |device| {
        let mut rig = Rig::new(device);
        rig.world.power(rig.device, true);
        rig.frames(3000).first().cloned().expect("a boot-up")
    };
    let (usual, boot_up) = at("pvea-canopen");
    assert_eq!(at("pvea-canopen,boot-ms=1500"), (usual + 1_500_000, boot_up));
    assert_eq!(at("pvea-isobus,boot-ms=300").0, at("pvea-isobus").0 + 300_000);
    assert_eq!(at("hat1000,boot-ms=300,bit-rate=250k").0, at("hat1000,bit-rate=250k").0 + 300_000);
}

#[test]
fn power_during_the_start() {
    let mut rig = Rig::new("pvea-canopen,boot-ms=100");
    rig.world.power(rig.device, true);
    assert_eq!(rig.frames(60), []);
    // The device is already on, so this has no effect.
    rig.world.power(rig.device, true);
    assert_eq!(rig.frames(45).len(), 2, "boot-up and EMCY");
    rig.world.power(rig.device, false);
    rig.world.power(rig.device, true);
    rig.frames(60);
    rig.world.power(rig.device, false);
    assert_eq!(rig.frames(1000), []);
}

#[test]
fn answers_come_late_and_nothing_else_does() {
    let answer = |device: &str| {
        let mut rig = Rig::started(device);
        let asked = rig.send(READ_VENDOR);
        let frames = rig.frames(200);
        let [(start, frame)] = frames.as_slice() else { panic!("{frames:?}") };
        assert_eq!(frame, "5A0: 43 18 10 01 19 00 00 01");
        start - asked
    };
    let usual = answer("pvea-canopen");
    assert_eq!(answer("pvea-canopen,answer-ms=20"), usual.max(20_000));
    let late = answer("pvea-canopen,answer-ms=5..20");
    assert!((5_000..=20_100).contains(&late) && late != answer("pvea-canopen,answer-ms=20"), "{late}");
    assert_eq!(late, answer("pvea-canopen,answer-ms=5..20"), "the same seed");
    // Heartbeat and TPDOs keep their times.
    let cyclic = |device: &str| {
        let mut rig = Rig::started(device);
        rig.send("620: 2B 17 10 00 32 00 00 00");
        rig.frames(100);
        rig.send("000: 01 20");
        rig.frames(500)
    };
    assert_eq!(cyclic("pvea-canopen"), cyclic("pvea-canopen,answer-ms=7"));
}

#[test]
fn answers_of_isobus_come_late() {
    // Requests for DM2, and for a parameter group that the valve does not support.
    for request in ["18EA8027: CB FE 00", "18EA8027: D8 00 00"] {
        let answer = |device: &str| {
            let mut rig = Rig::started(device);
            let asked = rig.send(request);
            let cyclic = |frame: &str| frame.starts_with("0CFE") || frame.starts_with("18FECA");
            let frames = rig.frames(90);
            let found = frames.iter().find(|(start, frame)| *start >= asked && !cyclic(frame));
            let (start, frame) = found.unwrap_or_else(|| panic!("{request}: {frames:?}"));
            (start - asked, frame.clone())
        };
        let ((usual, frame), (late, same)) = (answer("pvea-isobus"), answer("pvea-isobus,answer-ms=40"));
        assert!(usual < 5_000 && (40_000..41_000).contains(&late), "{request}: {usual} and {late}");
        assert_eq!(frame, same);
    }
}

#[test]
fn a_slow_application_acts_in_its_cycle() {
    let mut rig = Rig::started("pvea-canopen,cycle-ms=10");
    for offset in [0, 1234, 4321, 9999] {
        rig.world.run_for(Duration::from_micros(offset));
        let asked = rig.send(READ_VENDOR);
        let frames = rig.frames(20);
        let [(start, _)] = frames.as_slice() else { panic!("{frames:?}") };
        assert_eq!(*start, asked.next_multiple_of(10_000), "asked at {asked}");
    }
    rig.send("000: 01 20");
    rig.supply(8_000);
    for (start, frame) in rig.frames(2000) {
        // The frames of one cycle follow one another.
        assert!(start % 10_000 < 2_000, "{start} {frame}");
    }
}

/// Neither noise nor a moving link nor a view makes a slow sensor sense between its cycles.
#[test]
fn a_slow_sensor_senses_in_its_cycle() {
    for device in ["hat1000,cycle-ms=500", "hat1000,cycle-ms=500,noise=10", "hat1000,cycle-ms=500,dead-band=10"] {
        let mut rig = Rig::started(device);
        let valve = rig.world.add("boom", Kind::PveaCanopen);
        rig.world.power(valve, true);
        rig.world.link(valve, rig.device, Link::default()).expect("a valve and a sensor");
        rig.world.set_plant(valve, Change::Lever(Some(8_192))).expect("a valve");
        rig.frames(1100);
        rig.set(&[Change::InternalFault(true)]);
        rig.frames(25);
        rig.world.set_plant(valve, Change::TemperatureC(30)).expect("a valve");
        let view = rig.world.view(rig.device).expect("power");
        assert!(view.faults.iter().all(|fault| !fault.active), "{device}");
        let angle = rig.world.angle_cdeg(rig.device).expect("a shaft");
        assert!(
            angle > 1_000 && (i64::from(view.position) - i64::from(angle) * 16_384 / 36_000).abs() <= 6,
            "{device}"
        );
        rig.set(&[Change::InternalFault(false)]);
        assert_eq!(rig.frames(1000), [], "{device}");
    }
}

/// All frames of a cycle leave the device, one after the other.
#[test]
fn each_frame_of_a_cycle_is_sent() {
    let mut rig = Rig::started("pvea-canopen,cycle-ms=10");
    rig.send("620: 2B 17 10 00 64 00 00 00");
    rig.frames(20);
    rig.send("000: 01 20");
    let mut frames = Vec::new();
    for _ in 0..100 {
        rig.send("220: 0F 00 00 20");
        frames.extend(rig.frames(9));
    }
    rig.send(READ_VENDOR);
    frames.extend(rig.frames(30));
    let count = |start: &str| frames.iter().filter(|(_, frame)| frame.starts_with(start)).count();
    assert!(count("720: 05") >= 8 && count("1A0: ") >= 20 && count("5A0: 43 18") == 1, "{frames:?}");
}

/// The shutdown stores a fault counted after the last fault log write, without waiting for the next cycle.
#[test]
fn the_end_does_not_wait_for_a_cycle() {
    let mut rig = Rig::started("pvea-canopen,cycle-ms=1000");
    let set_fault = |rig: &mut Rig, is_there| {
        rig.world.set_plant(rig.device, Change::InternalFault(is_there)).expect("a valve");
    };
    let counts = |rig: &mut Rig| {
        let view = rig.world.view(rig.device).expect("power");
        view.faults.iter().map(|fault| u32::from(fault.count)).sum::<u32>()
    };
    for is_there in [true, false, true] {
        set_fault(&mut rig, is_there);
        rig.frames(1001);
    }
    assert_eq!(counts(&mut rig), 2);
    rig.world.flush_all();
    rig.world.power(rig.device, false);
    set_fault(&mut rig, false);
    rig.world.power(rig.device, true);
    rig.frames(10);
    assert_eq!(counts(&mut rig), 2);
}

/// Too many requests make a slow application drop answers, but do not delay other frames.
#[test]
fn many_slow_answers_hold_back_nothing_else() {
    let mut rig = Rig::started("pvea-canopen,answer-ms=5000");
    rig.send("620: 2B 17 10 00 64 00 00 00");
    rig.frames(6000);
    let mut frames = Vec::new();
    for _ in 0..300 {
        rig.send(READ_VENDOR);
        frames.extend(rig.frames(10));
    }
    let heartbeats = frames.iter().filter(|(_, frame)| frame == "720: 7F").count();
    assert!((30..=33).contains(&heartbeats), "{heartbeats} heartbeats");
    let answers = rig.frames(6000).iter().filter(|(_, frame)| frame.starts_with("5A0: ")).count();
    assert_eq!(answers, 32);
}

#[test]
fn a_slow_application_stores() {
    let mut rig = Rig::started("pvea-canopen,cycle-ms=100");
    rig.send("620: 23 10 10 01 73 61 76 65");
    rig.world.flush_all();
    assert!(rig.frames(500).iter().any(|(_, frame)| frame == "5A0: 60 10 10 01 00 00 00 00"));
}

#[test]
fn below_its_limit_a_valve_is_off() {
    let mut rig = Rig::started("pvea-canopen,brown-out-mv=7000,boot-ms=50");
    rig.supply(7_000);
    assert!(rig.world.is_powered(rig.device));
    rig.supply(6_999);
    assert!(!rig.world.is_powered(rig.device));
    assert_eq!(rig.frames(100), []);
    rig.supply(24_000);
    let frames = rig.frames(100);
    assert_eq!(frames.first().map(|(_, frame)| frame.as_str()), Some("720: 00"));
    // A device switched off remains off; a device switched on below the limit waits.
    rig.supply(5_000);
    rig.world.power(rig.device, false);
    rig.supply(24_000);
    assert_eq!(rig.frames(100), []);
    rig.supply(5_000);
    rig.world.power(rig.device, true);
    assert_eq!(rig.frames(100), []);
    rig.supply(12_000);
    assert!(!rig.frames(100).is_empty());
}

/// Plant words have the same effects on a running device as the keys of a device text.
#[test]
fn the_words_change_a_running_device() {
    let mut rig = Rig::started("pvea-canopen");
    rig.set(&[Change::AnswerMs(20, 20)]);
    let asked = rig.send(READ_VENDOR);
    assert_eq!(rig.frames(100)[0].0, asked + 20_000);
    rig.set(&[Change::AnswerMs(0, 0), Change::CycleMs(10)]);
    rig.frames(3);
    let asked = rig.send(READ_VENDOR);
    assert_eq!(rig.frames(100)[0].0, asked.next_multiple_of(10_000));
    rig.set(&[Change::CycleMs(0)]);
    let asked = rig.send(READ_VENDOR);
    assert!(rig.frames(100)[0].0 < asked + 1_000);
    // The start delay acts from the next start, also from the restart after low supply.
    rig.set(&[Change::BootMs(50), Change::BrownOutMv(Some(7_000))]);
    assert!(rig.world.is_powered(rig.device));
    rig.supply(6_000);
    rig.supply(24_000);
    assert_eq!(rig.frames(50), []);
    assert_eq!(rig.frames(10).len(), 2, "boot-up and EMCY");
}

/// If supply and limit change at the same instant, the new supply is compared with the new limit.
#[test]
fn supply_and_limit_change_together() {
    let mut rig = Rig::started("pvea-canopen,brown-out-mv=7000");
    rig.set(&[Change::SupplyMv(6_000), Change::BrownOutMv(Some(5_000))]);
    assert!(rig.world.is_powered(rig.device));
    rig.set(&[Change::BrownOutMv(Some(20_000)), Change::SupplyMv(24_000)]);
    assert!(rig.world.is_powered(rig.device));
    assert_eq!(rig.frames(50), [], "the valve did not boot");
    rig.set(&[Change::BrownOutMv(Some(24_001))]);
    assert!(!rig.world.is_powered(rig.device));
    rig.set(&[Change::BrownOutMv(None)]);
    assert!(rig.world.is_powered(rig.device), "without a limit the valve is never off");
}

#[test]
fn by_default_nothing_is_slow() {
    let mut rig = Rig::started("pvea-canopen");
    assert_eq!(rig.world.electronics(rig.device), Electronics::default());
    rig.supply(0);
    assert!(rig.world.is_powered(rig.device), "(A): a valve without a limit does not switch off");
}

#[test]
fn what_is_no_electronics_is_refused() {
    for (device, reason) in [
        ("pvea-canopen,boot-ms=60001", "'60001' is not a valid time; accepted: 0–60000"),
        ("pvea-canopen,answer-ms=20..5", "'20..5' is not a valid range"),
        ("pvea-canopen,answer-ms=5..", "'' is not a valid time"),
        ("pvea-canopen,cycle-ms=1001", "'1001' is not a valid time; accepted: 0–1000"),
        ("pvea-canopen,cycle-ms", "'cycle-ms' needs a value"),
        ("pvea-canopen,brown-out-mv=0", "'0' is not a valid supply"),
        ("hat1000,brown-out-mv=7000", "'brown-out-mv' applies to a valve's supply"),
    ] {
        let refused = device.parse::<DeviceSpec>().expect_err(device);
        assert!(refused.starts_with(reason), "{device}: {refused}");
    }
}
