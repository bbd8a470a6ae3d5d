//! Angle sensors in a world: their shaft as plant, linked to a valve, and their PDOs in time (SPEC 9).

use hal_sim::world::{Change, EventKind, Link, LinkError, PlantError};
use hal_sim::{ClientPortId, Kind, NodeId, Setup, World};
use protocol_core::actuator::Valve;
use protocol_core::controller::BitRate;
use protocol_core::device::pve::PveCanopen;
use protocol_core::time::{Duration, Instant, NEVER, after};
use tests::frame;

const RATE: BitRate = BitRate::Kbit250;

/// A machine: a valve at 0x20, a sensor at 1 and a valve on ISOBUS at 0x83, booted, and a master, at 250 kbit/s.
struct Machine {
    world: World,
    master: ClientPortId,
    valve: NodeId,
    sensor: NodeId,
    other: NodeId,
}

impl Machine {
    fn booted() -> Self {
        let mut world = World::new(RATE, 0);
        let master = world.add_client_port("master");
        let [valve, sensor, other] =
            [("pvea-canopen", 0x20), ("hat1000", 1), ("pvea-isobus", 0x83)].map(|(name, id)| {
                let kind = Kind::from_name(name).expect("a kind");
                let setup = Setup { node_id: Some(id), bit_rate: Some(RATE), ..Setup::new(kind) };
                let node = world.add(name, setup);
                world.power(node, true);
                node
            });
        let mut machine = Self { world, master, valve, sensor, other };
        machine.run_for(50);
        machine.take();
        machine
    }

    /// The same, its sensor linked to the valve on CANopen, both operational.
    fn linked(link: Link) -> Self {
        let mut machine = Self::booted();
        machine.world.link(machine.valve, machine.sensor, link).expect("a valve and a sensor");
        machine.send("000: 01 00");
        for _ in 0..3 {
            machine.open(0);
        }
        machine.run_for(10);
        machine
    }

    fn run_for(&mut self, ms: u64) {
        let end = after(self.world.now(), Duration::from_millis(ms));
        self.world.run_until(end);
    }

    fn send(&mut self, text: &str) {
        self.world.send(self.master, frame(text));
    }

    /// A set-point for the valve.
    fn open(&mut self, set_point: i16) {
        let [low, high] = set_point.to_le_bytes();
        self.send(&format!("220: 0F 00 {low:02X} {high:02X}"));
    }

    /// The same for so many milliseconds, in a cycle of 100 ms.
    fn hold(&mut self, set_point: i16, ms: u64) {
        for _ in 0..ms / 100 {
            self.open(set_point);
            self.run_for(100);
        }
    }

    fn take(&mut self) -> Vec<(Instant, String)> {
        self.world.take_received(self.master).map(|(at, frame)| (at, frame.to_string())).collect()
    }

    fn angle(&self) -> u32 {
        self.world.angle_cdeg(self.sensor).expect("a shaft")
    }

    /// What the sensor answers to a read of its position.
    fn position(&mut self) -> u32 {
        self.take();
        self.send("601: 40 04 60 00 00 00 00 00");
        self.run_for(5);
        let answer = self.take().into_iter().map(|(_, text)| text).find(|text| text.starts_with("581: 43 04 60 00"));
        let data = *frame(&answer.expect("an answer")).bytes();
        u32::from_le_bytes([data[4], data[5], data[6], data[7]])
    }

    /// Sends SDO writes of TPDO 1: by the event timer, of so many milliseconds.
    fn transmit_every(&mut self, ms: u8) {
        for text in ["601: 23 00 18 01 81 01 00 00", &format!("601: 2B 00 18 05 {ms:02X} 00 00 00"), "000: 01 01"] {
            self.send(text);
            self.run_for(5);
        }
        self.take();
    }
}

/// What happens between two events, microsecond by microsecond: the flow in each is that of a trapezoid.
fn turn(angle: &mut i128, valve: &Valve, link: Link, from: Instant, to: Instant) {
    const CDEG: i128 = 2 * Valve::STROKE as i128 * 1_000_000;
    let opening = |at: u64| i128::from(valve.opening(Instant::from_micros(at)));
    let mut before = opening(from.as_micros());
    for at in from.as_micros() + 1..=to.as_micros() {
        let here = opening(at);
        *angle += (before + here) * i128::from(link.rate);
        *angle = (*angle).clamp(i128::from(link.min) * CDEG, i128::from(link.max) * CDEG);
        before = here;
    }
}

#[test]
fn a_linked_shaft_is_the_integral_of_the_spool_in_every_microsecond() {
    const CDEG: i128 = 2 * Valve::STROKE as i128 * 1_000_000;
    for rate in [3_000, -3_333] {
        let link = Link { rate, min: 100, max: 800, ..Link::default() };
        let mut machine = Machine::linked(link);
        let mut reference = i128::from(machine.angle()) * CDEG;
        // To a stop, back through neutral before the spool has come to rest, and a set-point that never is.
        let orders = [
            (0, 16_384_i16),
            (200, 16_384),
            (400, 0),
            (480, -16_384),
            (495, 12_345),
            (700, -7),
            (900, -16_384),
            (1_100, -16_384),
            (1_300, 1),
        ];
        let start = machine.world.now();
        let mut orders = orders.map(|(ms, set_point)| (after(start, Duration::from_millis(ms)), set_point)).into_iter();
        let mut order = orders.next();
        let mut reached = [false; 2];
        loop {
            let now = machine.world.now();
            let next = order.map_or(machine.world.next_event(), |(at, _)| at.min(machine.world.next_event()));
            if next > after(start, Duration::from_millis(1_600)) {
                break;
            }
            let valve = machine.world.device_as::<PveCanopen>(machine.valve).expect("powered").application().valve();
            turn(&mut reference, valve, link, now, next);
            if next < machine.world.next_event() {
                machine.world.run_until(next);
            } else {
                machine.world.step();
            }
            if let Some((_, set_point)) = order.take_if(|(at, _)| *at <= machine.world.now()) {
                machine.open(set_point);
                order = orders.next();
            }
            assert_eq!(i128::from(machine.angle()), reference / CDEG, "{rate} at {:?}", machine.world.now());
            reached[0] |= machine.angle() == link.min;
            reached[1] |= machine.angle() == link.max;
        }
        assert_eq!(reached, [true; 2], "both stops");
    }
}

#[test]
fn looking_at_a_linked_shaft_changes_nothing() {
    let mut seldom = Machine::linked(Link::default());
    let mut often = Machine::linked(Link::default());
    for set_point in [9_999, -3, 16_384, -12_345] {
        seldom.open(set_point);
        often.open(set_point);
        for _ in 0..200 {
            often.world.run_until(after(often.world.now(), Duration::from_micros(997)));
            often.world.set_plant(often.sensor, Change::MeasuringError(false)).expect("a sensor");
        }
        seldom.world.run_until(often.world.now());
        assert_eq!(seldom.angle(), often.angle());
    }
}

#[test]
fn a_valve_moves_the_boom_between_its_stops_beside_a_valve_on_isobus() {
    let mut machine = Machine::linked(Link::default());
    machine.send("0CFE3327: 7D FF 31 FF FF FF FF FF");
    // 250 ms to full stroke make 375, then 3,000 a second, and the first frame takes its time.
    machine.hold(16_384, 1_000);
    let angle = machine.angle();
    assert!((2_600..2_630).contains(&angle), "{angle}");
    assert!(machine.position().abs_diff(machine.angle() * 16_384 / 36_000) <= 8);
    machine.hold(16_384, 4_000);
    assert_eq!((machine.angle(), machine.position()), (9_000, 4_096));
    // Back: the spool goes through neutral, and at the lower stop the shaft stands.
    machine.hold(-16_384, 4_000);
    assert_eq!((machine.angle(), machine.position()), (0, 0));
    let on_isobus = machine.world.port(machine.other).confinement();
    assert_eq!(on_isobus, machine.world.port(machine.valve).confinement(), "nobody disturbs");
    machine.run_for(300);
    assert!(machine.take().iter().any(|(_, text)| text.starts_with("0CFE1383:")), "AVEF goes on");
}

#[test]
fn an_angle_that_is_set_goes_on_from_there() {
    let mut machine = Machine::linked(Link::default());
    machine.world.set_plant(machine.sensor, Change::AngleCdeg(4_500)).expect("a sensor");
    assert_eq!((machine.angle(), machine.position()), (4_500, 2_048));
    machine.hold(-16_384, 500);
    assert!(machine.angle() < 3_800, "{}", machine.angle());
    // Lifted beyond a stop: no further, but back.
    machine.hold(0, 300);
    machine.world.set_plant(machine.sensor, Change::AngleCdeg(9_500)).expect("a sensor");
    machine.hold(16_384, 500);
    assert_eq!(machine.angle(), 9_500);
    machine.hold(-16_384, 700);
    assert!(machine.angle() < 9_000, "{}", machine.angle());
}

/// The springs close the valve: 150 ms of half the flow are 225/100 degree.
#[test]
fn without_power_the_valve_closes_and_the_sensor_finds_the_angle_at_its_start() {
    let mut machine = Machine::linked(Link::default());
    machine.world.power(machine.sensor, false);
    machine.hold(16_384, 1_000);
    machine.world.power(machine.valve, false);
    let angle = machine.angle() + 225;
    assert!(angle > 2_500);
    machine.run_for(1_000);
    machine.world.power(machine.sensor, true);
    machine.run_for(50);
    assert_eq!(machine.angle(), angle);
    assert_eq!(machine.position(), angle * 16_384 / 36_000);
}

#[test]
fn a_link_at_rest_costs_no_event() {
    let mut machine = Machine::booted();
    machine.world.power(machine.other, false);
    machine.world.link(machine.valve, machine.sensor, Link::default()).expect("a valve and a sensor");
    machine.run_for(1_000);
    assert_eq!(machine.world.next_event(), NEVER);
    // A lever holds the valve open: the shaft turns, and nothing has to happen for it.
    machine.world.set_plant(machine.valve, Change::Lever(Some(8_192))).expect("a valve");
    machine.run_for(1_000);
    assert_eq!(machine.world.next_event(), NEVER);
    machine.run_for(1_000);
    assert_eq!(machine.angle(), 3_000);
}

#[test]
fn what_cannot_be_linked_or_changed_is_refused() {
    let mut machine = Machine::booted();
    let Machine { world, valve, sensor, .. } = &mut machine;
    let (valve, sensor) = (*valve, *sensor);
    assert_eq!(world.link(sensor, sensor, Link::default()), Err(LinkError::NoValve));
    assert_eq!(world.link(valve, valve, Link::default()), Err(LinkError::NoSensor));
    for (min, max) in [(1, 0), (0, 36_000)] {
        assert_eq!(world.link(valve, sensor, Link { rate: 1, min, max, ..Link::default() }), Err(LinkError::Stops));
    }
    assert_eq!(world.link(valve, sensor, Link::default()), Ok(()));
    assert_eq!(world.link(valve, sensor, Link::default()), Err(LinkError::Linked));

    let before = *world.inputs(sensor);
    for plant in [Change::SupplyMv(1), Change::TemperatureC(1), Change::Lever(None)] {
        assert_eq!(world.set_plant(sensor, plant), Err(PlantError::OtherProduct(plant)));
    }
    for plant in [Change::AngleCdeg(0), Change::SpeedRpm(0), Change::MeasuringError(true)] {
        assert_eq!(world.set_plant(valve, plant), Err(PlantError::OtherProduct(plant)));
    }
    let beyond = Change::AngleCdeg(36_000);
    assert_eq!(world.set_plant(sensor, beyond), Err(PlantError::OutOfRange(beyond)));
    let speed = Change::SpeedRpm(1);
    assert_eq!(world.set_plant(sensor, speed), Err(PlantError::Linked(speed)));
    assert_eq!(*world.inputs(sensor), before);
    assert_eq!(world.set_plant(sensor, Change::SpeedRpm(0)), Ok(()));
}

#[test]
fn a_shaft_turns_in_virtual_time() {
    let mut machine = Machine::booted();
    machine.world.set_plant(machine.sensor, Change::AngleCdeg(35_000)).expect("a sensor");
    machine.world.set_plant(machine.sensor, Change::SpeedRpm(60)).expect("a sensor");
    machine.run_for(250);
    assert_eq!(machine.angle(), 8_000);
    machine.world.set_plant(machine.sensor, Change::MeasuringError(true)).expect("a sensor");
    machine.world.set_plant(machine.sensor, Change::SpeedRpm(-1)).expect("a sensor");
    machine.run_for(10_000);
    assert_eq!(machine.angle(), 2_000);
    machine.world.set_plant(machine.sensor, Change::SpeedRpm(0)).expect("a sensor");
    assert_eq!(machine.position(), 2_000 * 16_384 / 36_000);
}

/// The ends of the PDOs in microseconds.
fn ends(frames: &[(Instant, String)]) -> Vec<u64> {
    frames.iter().filter(|(_, text)| text.starts_with("181:")).map(|(at, _)| at.as_micros()).collect()
}

#[test]
fn a_pdo_every_millisecond_within_20_us_on_an_idle_bus() {
    let mut machine = Machine::booted();
    machine.world.power(machine.other, false);
    machine.world.set_plant(machine.sensor, Change::SpeedRpm(77)).expect("a sensor");
    machine.transmit_every(1);
    machine.run_for(10_000);
    let ends = ends(&machine.take());
    assert!((9_999..=10_001).contains(&ends.len()), "{} PDOs", ends.len());
    for (number, end) in (0_u64..).zip(&ends) {
        // The position fills the frame with more or fewer stuff bits.
        let grid = ends[0] + number * 1_000;
        assert!(end.abs_diff(grid) <= 20, "number {number}: {end}, not {grid}");
    }
}

#[test]
fn a_pdo_of_a_linked_sensor_tells_the_angle_at_which_it_is_due() {
    let mut machine = Machine::linked(Link::default());
    machine.world.record_events(true);
    machine.transmit_every(10);
    machine.open(16_384);
    let (start, mut angles, mut compared) = (machine.world.now(), Vec::new(), 0);
    while machine.world.now() < after(start, Duration::from_millis(200)) {
        machine.world.step();
        angles.push((machine.world.now(), machine.angle()));
    }
    for event in machine.world.take_events() {
        let EventKind::Frame { frame, start } = event.what else { continue };
        if let Some((_, angle)) = angles.iter().find(|(at, _)| frame.to_string().starts_with("181:") && *at == start) {
            let position = angle * 16_384 / 36_000;
            assert_eq!(frame.bytes()[..4], position.to_le_bytes(), "{frame} at {start:?}: {angle}");
            compared += 1;
        }
    }
    assert!(compared >= 18 && machine.angle() > 100, "{compared} PDOs");
}

#[test]
fn no_drift_in_an_hour() {
    let mut machine = Machine::booted();
    machine.world.power(machine.other, false);
    machine.transmit_every(1);
    machine.run_for(100);
    let first = *ends(&machine.take()).last().expect("a PDO");
    let (mut count, mut last) = (0, first);
    for _ in 0..360 {
        machine.run_for(10_000);
        for (at, _) in machine.world.take_received(machine.master) {
            count += 1;
            last = at.as_micros();
        }
    }
    assert_eq!((count, last - first), (3_600_000, 3_600_000_000));
}
