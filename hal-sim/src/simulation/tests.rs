//! The state of a device agrees with its frames at the same virtual time, and reading the state changes nothing.

use proptest::prelude::*;
use protocol_core::actuator::{Position, Scale};
use protocol_core::device::Setup;
use protocol_core::encoder::STEPS;
use protocol_core::wire::valve::{EstimatedFlow, State};

use super::*;
use crate::state::{FaultRequest, FloatWord, PlantChange, SetPointValue, StateCondition, raw};
use crate::world::{ClientPortId, Link};

/// An action on a device.
#[derive(Clone, Debug)]
enum Act {
    /// A frame.
    Send(String),
    /// A plant change.
    Change(String),
    /// A power cut, followed by a power-up.
    Cycle,
}

/// A world with devices and a master.
struct Rig {
    world: World,
    devices: Vec<(NodeId, Kind)>,
    master: ClientPortId,
    /// True if the states are read throughout the run.
    reads: bool,
}

impl Rig {
    fn new(kinds: &[&str], link: Option<Link>, reads: bool) -> Self {
        let mut world = World::new(BitRate::Kbit250, 1);
        world.record_events(true);
        let master = world.add_gateway("master");
        let devices: Vec<(NodeId, Kind)> = kinds
            .iter()
            .map(|name| (Kind::from_name(name).expect("a kind"), *name))
            .map(|(kind, name)| {
                let setup = Setup { bit_rate: Some(BitRate::Kbit250), ..Setup::<Kind>::new(kind) };
                (world.add(name, setup), kind)
            })
            .collect();
        if let Some(link) = link {
            world.link(devices[0].0, devices[1].0, link).expect("a valve and a sensor");
        }
        devices.iter().for_each(|(node, _)| world.power(*node, true));
        let mut rig = Self { world, devices, master, reads };
        rig.pass(Duration::from_millis(10));
        rig
    }

    fn state(&mut self, device: usize) -> DeviceState {
        let (node, kind) = self.devices[device];
        DeviceState::of(node, kind, &self.world)
    }

    fn read(&mut self) {
        if self.reads {
            (0..self.devices.len()).for_each(|device| drop(self.state(device)));
        }
    }

    /// Advances time, event by event.
    fn pass(&mut self, span: Duration) {
        let end = after(self.world.now(), span);
        while self.world.next_event() <= end {
            self.world.step();
            self.read();
        }
        self.world.run_until(end);
        self.read();
    }

    fn act(&mut self, act: &Act) {
        let (node, _) = self.devices[0];
        match act {
            Act::Send(frame) => self.world.send(self.master, frame.parse().expect("a frame")),
            Act::Change(change) => {
                let change: PlantChange = serde_json::from_str(change).expect("a change");
                change.make(node, &mut self.world).expect("a change that can be");
            }
            Act::Cycle => {
                self.world.power(node, false);
                self.pass(Duration::from_millis(100));
                self.world.power(node, true);
            }
        }
        self.read();
    }

    /// Sends a frame, and advances to its end. Returns whether the frame was sent.
    fn sent(&mut self, frame: &str) -> bool {
        self.world.send(self.master, frame.parse().expect("a frame"));
        let end = after(self.world.now(), Duration::from_millis(50));
        while self.world.pending(self.master) > 0 && self.world.next_event() <= end {
            self.world.step();
        }
        self.world.pending(self.master) == 0
    }

    /// Reads an object of the first device by SDO. Returns the value, and the state at the time of the request.
    fn read_object(&mut self, node_id: u8, index: u16, sub: u8) -> Option<(u32, DeviceState)> {
        let [low, high] = index.to_le_bytes();
        let request = format!("{:03X}: 40 {low:02X} {high:02X} {sub:02X} 00 00 00 00", 0x600 + u16::from(node_id));
        if !self.sent(&request) {
            return None;
        }
        let state = self.state(0);
        self.world.take_events();
        self.pass(Duration::from_millis(20));
        let id = 0x580 + u32::from(node_id);
        let events: Vec<Event> = self.world.take_events().collect();
        let answer = events.iter().filter_map(Event::frame).find(|frame| raw(frame.id()) == (id, false))?;
        let [command, _, _, _, value @ ..] = *answer.bytes();
        (command != 0x80).then_some((u32::from_le_bytes(value), state))
    }
}

fn valve_act() -> impl Strategy<Value = Act> {
    let set_point = (0_u16..16, any::<i16>()).prop_map(|(word, set_point)| {
        let ([low, _], [first, second]) = (word.to_le_bytes(), set_point.to_le_bytes());
        Act::Send(format!("220: {low:02X} 00 {first:02X} {second:02X}"))
    });
    let active = prop::sample::select(vec!["0F 00 00 20", "0F 00 00 C0", "0F 00 FF 7F", "03 00 00 00", "0B 00 00 00"]);
    prop_oneof![
        3 => set_point,
        6 => active.prop_map(|data| Act::Send(format!("220: {data}"))),
        1 => prop::sample::select(vec!["000: 01 00", "000: 02 00", "000: 80 00", "000: 81 00", "000: 82 00"])
            .prop_map(|frame| Act::Send(frame.to_owned())),
        3 => change(),
        1 => Just(Act::Cycle),
    ]
}

fn change() -> impl Strategy<Value = Act> {
    let changes = vec![
        r#"{"supply_mv": 8000}"#,
        r#"{"supply_mv": 24000}"#,
        r#"{"temperature_c": 130}"#,
        r#"{"temperature_c": 25}"#,
        r#"{"spool": {"fault": "stuck"}}"#,
        r#"{"spool": {"fault": "drifting"}}"#,
        r#"{"spool": {"fault": null}}"#,
        r#"{"lever": 9000}"#,
        r#"{"lever": null}"#,
        r#"{"internal_fault": true}"#,
        r#"{"internal_fault": false}"#,
        r#"{"bus_off": true}"#,
        r#"{"bus_off": false, "memory": "damaged"}"#,
    ];
    prop::sample::select(changes).prop_map(|change| Act::Change(change.to_owned()))
}

fn avc() -> impl Strategy<Value = Act> {
    (0_u8..=250, prop::sample::select(vec![0_u8, 1, 1, 2, 2, 3, 10, 14]))
        .prop_map(|(flow, state)| Act::Send(format!("0CFE3027: {flow:02X} FF {:02X} FF FF FF FF FF", 0x30 | state)))
}

/// Returns the status word for a state of the device state machine.
fn status_word(state: &DeviceState) -> Option<u32> {
    use crate::state::DeviceStateMachine::{Active, Disabled, FaultHold, Hold, Init};
    state.dsm.map(|dsm| match dsm {
        Init => 0x08,
        Disabled => 0x09,
        Hold => 0x0B,
        Active => 0x0F,
        FaultHold => 0x03,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases.div_ceil(10)))]

    /// The SDO responses of a CANopen valve agree with the state at the time of the request.
    #[test]
    fn a_valve_on_canopen(acts in prop::collection::vec((valve_act(), 0_u64..200_000), 1..30)) {
        let mut rig = Rig::new(&["pvea-canopen"], None, false);
        rig.act(&Act::Send("000: 01 00".to_owned()));
        let mut compared = 0;
        for (act, span) in acts {
            rig.act(&act);
            rig.pass(Duration::from_micros(span));
            if let Some((word, state)) = rig.read_object(0x20, 0x6041, 0) {
                prop_assert_eq!(Some(word), status_word(&state));
                compared += 1;
            }
            if let Some((set_point, state)) = rig.read_object(0x20, 0x6300, 1) {
                let expected = match state.set_point {
                    Some(SetPointValue::Position(position)) => position,
                    Some(SetPointValue::Float(FloatWord::Float)) => 32767,
                    None => return Err(TestCaseError::fail("no set-point")),
                };
                prop_assert_eq!(set_point as i16, expected);
            }
            if let Some((actual, state)) = rig.read_object(0x20, 0x6301, 1) {
                let floats = actual as i16 == 32767 && state.set_point == Some(SetPointValue::Float(FloatWord::Float));
                prop_assert!(floats || state.position == Some(actual as i16), "{} {:?}", actual as i16, state);
            }
            if let Some((register, state)) = rig.read_object(0x20, 0x1001, 0) {
                prop_assert_eq!(register != 0, state.faults.iter().any(|fault| fault.active), "{:?}", state);
            }
        }
        let state = rig.state(0);
        prop_assert!(compared > 0 || state.nmt != Some(crate::state::Nmt::Operational), "{:?}", state);
    }

    /// The AVEF of an ISOBUS valve agrees with the state at the start of the frame, on an otherwise idle bus.
    #[test]
    fn a_valve_on_isobus(acts in prop::collection::vec(prop_oneof![4 => avc(), 1 => change()], 1..30)) {
        let mut rig = Rig::new(&["pvea-isobus"], None, false);
        rig.pass(Duration::from_millis(500));
        // Starts midway between two AVEFs.
        let phase = rig.world.take_events().rfind(|event| event.frame().is_some()).expect("an AVEF").at;
        rig.world.run_until(after(phase, Duration::from_millis(50)));
        let (cycles, mut compared) = (acts.len(), 0);
        for act in acts {
            rig.act(&act);
            let end = after(rig.world.now(), Duration::from_millis(100));
            // The AVEF starts 100 ms after the previous one.
            let mut states: Vec<(Instant, DeviceState)> = Vec::new();
            while rig.world.next_event() <= end {
                rig.world.step();
                states.push((rig.world.now(), rig.state(0)));
            }
            rig.world.run_until(end);
            let events: Vec<Event> = rig.world.take_events().collect();
            for event in events {
                let crate::world::EventKind::Frame { frame, start } = event.what else { continue };
                if raw(frame.id()) != (0x0CFE_1080, true) {
                    continue;
                }
                let Some((_, state)) = states.iter().find(|(at, _)| *at == start) else { continue };
                let position = state.position.and_then(Position::new).expect("it has power");
                let percent = Scale::Percent.of_position(position);
                let (extend, retract) = (percent.max(0) as u8, percent.min(0).unsigned_abs() as u8);
                let expected = EstimatedFlow { extend, retract, state: command(state) }.emit();
                prop_assert_eq!(*frame.bytes(), expected, "{:?}", state);
                compared += 1;
            }
        }
        prop_assert!(compared > 0 || cycles < 3 || state_is_bus_off(&mut rig), "{:?}", rig.state(0));
    }

    /// The SDO responses of an angle sensor with a turning shaft agree with the state.
    #[test]
    fn an_angle_sensor(turns in prop::collection::vec((-3000_i32..3000, 0_u32..36_000, 0_u64..100_000), 1..20)) {
        let mut rig = Rig::new(&["hat1000"], None, false);
        for (speed_rpm, angle_cdeg, span) in turns {
            rig.act(&Act::Change(format!(r#"{{"speed_rpm": {speed_rpm}, "angle_cdeg": {angle_cdeg}}}"#)));
            rig.pass(Duration::from_micros(span));
            let (position, state) = rig.read_object(1, 0x6004, 0).expect("an answer");
            prop_assert_eq!(state.position, i16::try_from(position).ok());
            prop_assert!(position < STEPS);
        }
    }

    /// Reading changes nothing: each frame is sent at the same time as without reading.
    #[test]
    fn reading_changes_nothing(acts in prop::collection::vec((valve_act(), 0_u64..50_000), 1..20), rate in -9000_i32..9000) {
        let run = |reads: bool| {
            let link = Link { rate, min: 0, max: 35_999, ..Link::default() };
            let mut rig = Rig::new(&["pvea-canopen", "hat3000"], Some(link), reads);
            for frame in ["000: 01 00", "601: 2F 00 18 02 FE 00 00 00", "601: 2B 00 18 05 0A 00 00 00", "601: 23 00 18 01 81 01 00 00"] {
                rig.act(&Act::Send(frame.to_owned()));
                rig.pass(Duration::from_millis(5));
            }
            for (act, span) in &acts {
                rig.act(act);
                rig.pass(Duration::from_micros(*span));
            }
            rig.pass(Duration::from_millis(300));
            rig.world.take_events().collect::<Vec<Event>>()
        };
        prop_assert_eq!(run(true), run(false));
    }
}

fn state_is_bus_off(rig: &mut Rig) -> bool {
    rig.state(0).faults.iter().any(|fault| fault.fault == "can-bus" && fault.count != Some(0))
}

/// Returns the AVEF state for the command in a device state.
fn command(state: &DeviceState) -> State {
    use crate::state::Command::{Blocked, EmergencyStop, Extend, Float, Hand, Retract};
    match state.command.expect("a valve on ISOBUS") {
        Blocked => State::Blocked,
        Extend => State::Extend,
        Retract => State::Retract,
        Float => State::Float,
        Hand => State::HandOperation,
        EmergencyStop => State::EmergencyStop,
    }
}

/// The next position is found to the microsecond, and no position in between is missed.
#[test]
fn the_next_position_of_a_spool_and_of_shafts() {
    let mut rig = Rig::new(
        &["pvea-canopen", "hat1000"],
        Some(Link { rate: 36_000, min: 0, max: 35_999, ..Link::default() }),
        false,
    );
    for frame in ["000: 01 00", "220: 0F 00 00 40", "220: 0F 00 00 40", "220: 0F 00 00 40", "220: 0F 00 00 40"] {
        assert!(rig.sent(frame));
    }
    for device in [0, 1] {
        let (node, _) = rig.devices[device];
        for _ in 0..50 {
            let now = rig.world.now();
            let limit = after(now, Duration::from_millis(50)).min(rig.world.next_event());
            let before = rig.state(device).position;
            let next = rig.world.next_position(node, limit);
            assert!(next > now && next <= limit);
            rig.world.run_until(Instant::from_ticks(next.as_ticks() - 1));
            assert_eq!(rig.state(device).position, before);
            rig.world.run_until(next);
            assert!(next == limit || rig.state(device).position != before || rig.world.next_event() <= next);
        }
    }
    // A spool at rest keeps its position, and so does its shaft. A linked shaft is followed in small steps.
    rig.act(&Act::Cycle);
    rig.pass(Duration::from_millis(500));
    for ((node, _), seconds) in rig.devices.clone().into_iter().zip([3600, 1]) {
        let limit = after(rig.world.now(), Duration::from_secs(seconds));
        assert_eq!(rig.world.next_position(node, limit), limit);
    }
}

/// A wait for a position of a turning shaft completes at the first possible time, with few checks per turn.
#[test]
fn a_wait_for_a_position_of_a_turning_shaft_costs_little() {
    for (speed_rpm, wanted) in [(60, "{\"min\": 9000, \"max\": 9001}"), (-3000, "16383"), (3_500, "1"), (-1, "16380")] {
        let mut rig = Rig::new(&["hat1000"], None, false);
        rig.act(&Act::Change(format!(r#"{{"speed_rpm": {speed_rpm}}}"#)));
        rig.pass(Duration::from_micros(777));
        let (node, kind) = rig.devices[0];
        let condition: StateCondition = serde_json::from_str(&format!(r#"{{"position": {wanted}}}"#)).expect("one");
        let (mut waits, mut completed) = (Waits::default(), Completed::new());
        let start = rig.world.now();
        let shaft = *rig.world.inputs(node).shaft().expect("a shaft");
        let is_there = |at: &Instant| {
            let position = shaft.position_at(*at);
            condition.position == Some(serde_json::from_str(&position.to_string()).ok())
                || (wanted.starts_with('{') && (9000..=9001).contains(&position))
        };
        let first = (0..).map(|ticks| after(start, Duration::from_ticks(ticks))).find(is_there).expect("an instant");
        let watch = StateWatch::new((node, kind), Box::new(condition));
        waits.begin(Awaited::State(watch), after(start, Duration::from_secs(100)), Ticket(1));
        waits.poll(&mut rig.world, &mut completed);
        let mut looks = 0;
        while !waits.is_empty() {
            let due = waits.due(&rig.world);
            assert!(due > rig.world.now());
            rig.world.run_until(due);
            waits.poll(&mut rig.world, &mut completed);
            looks += 1;
        }
        let [(Ticket(1), Ok(Reply::Device(state)))] = completed.as_slice() else { panic!("no answer at {speed_rpm}") };
        assert_eq!(Instant::from_micros(state.t_us), first, "{speed_rpm}");
        assert!(looks < 50, "{looks} looks at {speed_rpm}");
    }
}

/// While the shaft is at rest, the search for the next position does not run to the end of the wait.
#[test]
fn a_wait_without_end_for_a_linked_shaft_that_stands_costs_little() {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    for (name, kind) in [("boom", "pvea-canopen"), ("angle", "hat1000")] {
        simulation.add(&NamedDevice::new(name, Kind::from_name(kind).expect("a kind")), Memory::in_ram());
    }
    simulation.link(&[NamedLink { valve: "boom".to_owned(), sensor: "angle".to_owned(), link: Link::default() }]);
    for _ in 0..2 {
        let condition = serde_json::from_str(r#"{"position": 5000}"#).expect("a condition");
        let wait = Command::Wait(Condition::State("angle".to_owned(), condition), Duration::MAX);
        assert!(matches!(simulation.execute(wait), Ok(Executed::Pending(_))));
        let end = after(simulation.now(), Duration::from_secs(10));
        simulation.run_until(end);
        assert!(simulation.is_busy() && simulation.now() == end);
        simulation.power_up(Duration::from_ticks(0));
    }
}

/// A wait is not checked while its condition cannot hold, and ends at the last representable time.
#[test]
fn a_wait_to_the_end_of_time_ends() {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    simulation.add(&NamedDevice::new("boom", Kind::from_name("pvea-canopen").expect("a kind")), Memory::in_ram());
    simulation.send_as("master");
    let state = |text: &str| Condition::State("boom".to_owned(), serde_json::from_str(text).expect("a condition"));
    let frame = Condition::Frame("7FF#00".parse().expect("a frame"));
    for (condition, span) in [
        (state(r#"{"nmt": "stopped"}"#), Duration::from_secs(1_000_000_000)),
        (frame, Duration::MAX),
        (state(r#"{"dsm": "active"}"#), Duration::MAX),
    ] {
        let refused = simulation.clone().run(Command::Wait(condition, span));
        assert!(matches!(refused, Err(Refusal::TimedOut(_))), "{refused:?}");
    }
    assert!(simulation.clone().run(Command::Advance(Duration::MAX)).is_ok());
    simulation.run_until(Instant::from_ticks(u64::MAX - 1000));
    let frame = "100: 01".parse().expect("a frame");
    let _ = simulation.run(Command::Send(frame, Some(Duration::from_millis(1))));
    simulation.run_until(NEVER);
    assert_eq!(simulation.now(), NEVER);
}

/// A run to a time takes the events at that time.
#[test]
fn running_to_now_takes_what_has_happened() {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    simulation.add(&NamedDevice::new("boom", Kind::from_name("pvea-canopen").expect("a kind")), Memory::in_ram());
    simulation.power_up(Duration::from_ticks(0));
    simulation.run_until(Instant::from_millis(100));
    let (before, change) = (simulation.history().next(), serde_json::from_str(r#"{"bus_off": true}"#).expect("one"));
    assert!(simulation.execute(Command::Plant("boom".to_owned(), change)).is_ok());
    simulation.run_until(simulation.now());
    assert!(simulation.history().next() > before && simulation.take_event().is_none());
}

/// A wait for a position of a shaft that follows a valve completes at the first possible time, with few checks.
#[test]
fn a_wait_for_a_position_of_a_linked_shaft_costs_little() {
    for (rate, wanted) in [(3_000, 60..=60), (36_000, 700..=701), (-3_000, 16_000..=16_323), (100, 2..=2)] {
        let moving = || {
            let link = Link { rate, min: 0, max: 35_999, ..Link::default() };
            let mut rig = Rig::new(&["pvea-canopen", "hat1000"], Some(link), false);
            let angle = if rate < 0 { 35_999 } else { 0 };
            rig.world.set_plant(rig.devices[1].0, crate::world::Change::AngleCdeg(angle)).expect("an angle");
            for frame in ["000: 01 00", "220: 0F 00 00 40", "220: 0F 00 00 40", "220: 0F 00 00 40", "220: 0F 00 00 40"]
            {
                assert!(rig.sent(frame));
            }
            rig
        };
        let mut rig = moving();
        let (node, _) = rig.devices[1];
        let first = loop {
            if rig.state(1).position.is_some_and(|position| wanted.contains(&position)) {
                break rig.world.now();
            }
            let limit = rig.world.next_event();
            assert!(limit < Instant::from_secs(1), "the valve still moves");
            let next = rig.world.next_position(node, limit);
            rig.world.run_until(next);
        };
        let mut rig = moving();
        let (min, max) = (wanted.start(), wanted.end());
        let condition =
            serde_json::from_str(&format!(r#"{{"position": {{"min": {min}, "max": {max}}}}}"#)).expect("one");
        let mut watch = StateWatch::new(rig.devices[1], condition);
        let mut looks = 0;
        while !watch.look(&rig.world).1 {
            let event = rig.world.next_event();
            let due = watch.due(event, &rig.world);
            assert!(due > rig.world.now());
            rig.world.run_until(due);
            looks += u32::from(due < event);
        }
        assert_eq!(rig.world.now(), first, "{rate}");
        assert!(looks < 100, "{looks} looks at {rate}");
    }
}

/// On a bus with real devices, communication faults may only lose frames for simulated devices.
#[test]
fn a_bus_with_real_devices_is_protected_from_faults() {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    let device = NamedDevice::new("boom", Kind::from_name("pvea-canopen").expect("a kind"));
    simulation.add(&device, Memory::in_ram());
    simulation.world_mut().add_gateway("others");
    simulation.protect_bus("--an-option");
    let lose =
        |receivers: &[&str]| FaultKind::Lose { receivers: receivers.iter().map(|name| (*name).into()).collect() };
    let mut add = |kind| simulation.run(Command::Fault(Fault::new("", kind)));
    for kind in
        [lose(&[]), lose(&["boom", "others"]), FaultKind::Destroy, FaultKind::Omit { receivers: vec!["boom".into()] }]
    {
        let Err(Refusal::Conflict(reason)) = add(kind.clone()) else { panic!("{kind:?} is permitted") };
        assert!(reason.ends_with(" without --an-option"), "{reason}");
    }
    assert!(add(lose(&["boom"])).is_ok());
    assert_eq!(simulation.faults().count(), 1);
}

/// Each received frame counts once, including a frame that ended before the wait. The controller's own frames and
/// frames that a fault loses do not count.
#[test]
fn a_controller_receives_each_frame_once() {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    simulation.add(&NamedDevice::new("boom", Kind::from_name("pvea-canopen").expect("a kind")), Memory::in_ram());
    simulation.send_as("master");
    simulation.power_up(Duration::from_millis(1));
    simulation.run(Command::Advance(Duration::from_millis(50))).expect("time passes");
    let lose = |simulation: &mut Simulation, fault: &str| {
        let lose = serde_json::from_str::<FaultRequest>(fault);
        simulation.run(Command::Fault(lose.expect("JSON").fault().expect("a fault"))).expect("a fault");
    };
    lose(&mut simulation, r#"{"lose": "5A0", "receivers": ["boom"]}"#);
    let ask = |simulation: &mut Simulation| {
        simulation.run(Command::Send("620: 40 18 10 01 00 00 00 00".parse().expect("a frame"), None)).expect("sent");
        simulation.run(Command::Advance(Duration::from_millis(5))).expect("time passes");
    };
    ask(&mut simulation);
    lose(&mut simulation, r#"{"lose": "5A0"}"#);
    ask(&mut simulation);
    let received =
        std::iter::from_fn(|| match simulation.run(Command::Wait(Condition::Received, Duration::from_millis(5))) {
            Ok(Reply::Frame(frame)) => Some(frame.id),
            _ => None,
        });
    assert_eq!(received.collect::<Vec<_>>(), [0x720, 0x0A0, 0x5A0]);
    simulation.run(Command::EndFaults(None)).expect("they end");
    simulation.run(Command::Send("620: 40 18 10 01 00 00 00 00".parse().expect("a frame"), None)).expect("sent");
    // The answer comes during the wait.
    let waited = simulation.run(Command::Wait(Condition::Received, Duration::from_millis(5)));
    assert!(matches!(&waited, Ok(Reply::Frame(frame)) if frame.id == 0x5A0), "{waited:?}");
}

/// The first frame is destroyed again and again, until its cycle is stopped.
#[test]
fn a_send_whose_cyclic_frame_is_stopped_says_so() {
    // On the wire, in an error frame, and between two attempts.
    for (waits, micros) in (0..2000).step_by(50).flat_map(|micros| [(false, micros), (true, micros)]) {
        let mut simulation = Simulation::new(BitRate::Kbit250, 1);
        let device = NamedDevice::new("boom", Kind::from_name("pvea-canopen").expect("a kind"));
        simulation.add(&device, Memory::in_ram());
        simulation.send_as("http");
        simulation.power_up(Duration::from_ticks(0));
        simulation.run_until(Instant::from_secs(1));
        simulation
            .execute(Command::Disturb(crate::bus::Disturbance { frames: 1_000_000, id: None }))
            .expect("it disturbs");
        if waits {
            // The cyclic frame waits behind another frame.
            simulation.execute(Command::Send("100: 00".parse().expect("a frame"), None)).expect("it is sent");
        }
        let send = Command::Send("101: 01".parse().expect("a frame"), Some(Duration::from_millis(10)));
        let Ok(Executed::Pending(ticket)) = simulation.execute(send) else { panic!("it waits for the frame") };
        simulation.run_until(Instant::from_micros(1_000_000 + micros));
        assert!(simulation.execute(Command::Stop(None)).is_ok());
        simulation.run_until(Instant::from_secs(4));
        let stopped = Refusal::Conflict("the cyclic frame was stopped".to_owned());
        assert_eq!(simulation.take_result(ticket), Some(Err(stopped)), "{waits} {micros}");
    }
}
