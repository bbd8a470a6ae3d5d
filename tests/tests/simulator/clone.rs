//! The clone of a world: the same calls come to the same in both, whatever was under way.

use embedded_can::nb::Can as _;
use hal_sim::bus::{
    ALWAYS, BitErrors, Corruption, Delay, DestroyNext, Disturbance, Fault, FaultKind, FrameFilter, Masks,
};
use hal_sim::memory::TornErase;
use hal_sim::world::{Change, Link, SUPPLY_JITTER};
use hal_sim::{Client, ClientPortId, ControllerId, Event, NodeId, WireEvent, World};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::actuator::SpoolFault;
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::device::{Inputs, Kind, Outputs, Protocol, Setup, View};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant};
use tests::frame;

/// A world, and who is in it.
#[derive(Clone)]
struct Cast {
    world: World,
    devices: Vec<(Kind, NodeId)>,
    port: ClientPortId,
    controller: ControllerId,
}

/// A world with a client that the test owns, until it is dropped.
struct Run {
    cast: Cast,
    client: Option<Client>,
}

/// Something done to a world. Devices are counted round.
#[derive(Clone, Debug)]
enum Call {
    RunFor(Duration),
    Step,
    PowerAll,
    Power(usize, bool),
    /// One of the frames for a device, from the client that the world owns, from the one that the test owns, or from
    /// the controller that lives elsewhere.
    Send(usize, usize),
    Transmit(usize, usize),
    Offer(usize, usize),
    Detach,
    DropClient,
    Plant(usize, Change),
    Noise(u64, u64),
    Destroy(u32),
    Disturb(u32),
    CutPowerAfter(usize, u64, TornErase),
    Spoil(usize),
    Fault(Fault),
    EndFault(&'static str),
    SetBitRate(BitRate),
    Flush,
}

/// The frames that set something going: states, timers, transfers, set-points, stores, claims.
fn frames(kind: Kind, id: u8) -> Vec<Frame> {
    let to = |base: u16, data: &str| frame(&format!("{:03X}: {data}", base + u16::from(id)));
    match kind.protocol() {
        Protocol::Canopen => vec![
            frame("000: 01 00"),
            frame("000: 81 00"),
            frame("080:"),
            to(0x600, "2B 17 10 00 0A 00 00 00"),
            to(0x600, "2F 00 18 02 01 00 00 00"),
            to(0x600, "40 08 10 00 00 00 00 00"),
            to(0x600, "60 00 00 00 00 00 00 00"),
            to(0x600, "23 10 10 01 73 61 76 65"),
            to(0x600, "23 11 10 01 6C 6F 61 64"),
            to(0x200, "0F 00 00 20"),
            to(0x200, "0F 00 00 C0"),
            frame("7E5: 04 01 00 00 00 00 00 00"),
            frame("7E5: 11 33 00 00 00 00 00 00"),
            frame("7E5: 17 00 00 00 00 00 00 00"),
            frame("7E5: 04 00 00 00 00 00 00 00"),
        ],
        Protocol::Isobus => vec![
            frame(&format!("0CFE3{:X}26: 40 FF 31 FF FF FF FF FF", id & 0xF)),
            frame(&format!("0CFE3{:X}26: A0 FF 32 FF FF FF FF FF", id & 0xF)),
            frame("18EAFF26: 00 EE 00"),
            frame(&format!("18EA{id:02X}26: CB FE 00")),
            frame(&format!("18EA{id:02X}26: CC FE 00")),
            frame(&format!("18EEFF{id:02X}: 00 00 00 00 00 00 00 00")),
        ],
    }
}

fn plant() -> impl Strategy<Value = Change> {
    prop_oneof![
        select(&[24_000, 8_000, 40_000][..]).prop_map(Change::SupplyMv),
        select(&[SpoolFault::None, SpoolFault::Stuck, SpoolFault::Drifting][..]).prop_map(Change::Spool),
        (0..36_000_u32).prop_map(Change::AngleCdeg),
        (-60..60_i32).prop_map(Change::SpeedRpm),
        any::<bool>().prop_map(Change::InternalFault),
        any::<bool>().prop_map(Change::MemoryFails),
        any::<bool>().prop_map(Change::BusOff),
        select(&[None, Some(7_000), Some(30_000)][..]).prop_map(Change::BrownOutMv),
        any::<bool>().prop_map(Change::Oil),
        (0..300_u16).prop_map(Change::BootMs),
        (0..100_u16).prop_map(|ms| Change::AnswerMs(ms, 2 * ms)),
        (0..30_u16).prop_map(Change::CycleMs),
    ]
}

const FAULTS: [&str; 3] = ["one", "two", "three"];

pub(super) fn fault() -> impl Strategy<Value = Fault> {
    let millis = Duration::from_millis;
    let receivers = || vec(select(&["device-0", "tap", "client", "controller"][..]).prop_map(Into::into), 0..3);
    let toggle = any::<[u8; 8]>().prop_map(|toggle| Masks { toggle, ..Masks::default() });
    let delay = prop_oneof![
        (0..300_u64).prop_map(move |ms| Delay::Constant(millis(ms))),
        (0..300_u64).prop_map(move |ms| Delay::Uniform(millis(ms), millis(2 * ms))),
        (1..300_u64).prop_map(move |ms| Delay::Burst(millis(ms))),
    ];
    let kind = prop_oneof![
        receivers().prop_map(|receivers| FaultKind::Lose { receivers }),
        (delay, any::<bool>()).prop_map(|(delay, overtake)| FaultKind::Delay { delay, overtake }),
        (1..5_u32, 0..50_u64).prop_map(move |(times, ms)| FaultKind::Repeat { times, after: millis(ms) }),
        (0..1000_u64).prop_map(move |ms| FaultKind::Swap { within: millis(ms) }),
        (any::<u32>(), any::<u8>(), toggle).prop_map(|(id, dlc, data)| {
            let id = Masks { toggle: id, ..Masks::default() };
            FaultKind::Corrupt(Corruption { id, dlc: Masks { toggle: dlc, ..Masks::default() }, data })
        }),
        (0..30_usize, proptest::option::of(1..100_u64)).prop_map(move |(which, ms)| {
            let frames = frames(Kind::ALL[0], 0x20);
            FaultKind::Insert { frame: frames[which % frames.len()], every: ms.map(millis) }
        }),
        Just(FaultKind::Destroy),
        receivers().prop_map(|receivers| FaultKind::Omit { receivers }),
    ];
    let sender = proptest::option::of(select(&["device-0", "tap", "client"][..]).prop_map(Into::into));
    let count = proptest::option::of(1..20_u32);
    (select(&FAULTS[..]), kind, sender, count, 0..=ALWAYS, any::<u64>(), 0..500_u64).prop_map(
        move |(name, kind, sender, count, probability, seed, ms)| {
            let sender = sender.filter(|_| !matches!(kind, FaultKind::Insert { .. }));
            let frames = FrameFilter { sender, ..FrameFilter::default() };
            let from = millis(ms / 2);
            Fault { frames, count, probability, seed, from, lasts: Some(millis(ms + 1)), ..Fault::new(name, kind) }
        },
    )
}

fn call() -> impl Strategy<Value = Call> {
    let (device, which) = (0..4_usize, 0..30_usize);
    prop_oneof![
        6 => (0..40_000_u64).prop_map(|micros| Call::RunFor(Duration::from_micros(micros))),
        2 => (0..2_000_u64).prop_map(|millis| Call::RunFor(Duration::from_millis(millis))),
        2 => Just(Call::Step),
        2 => Just(Call::PowerAll),
        2 => (device.clone(), any::<bool>()).prop_map(|(device, on)| Call::Power(device, on)),
        6 => (device.clone(), which.clone()).prop_map(|(device, which)| Call::Send(device, which)),
        4 => (device.clone(), which.clone()).prop_map(|(device, which)| Call::Transmit(device, which)),
        2 => (device.clone(), which).prop_map(|(device, which)| Call::Offer(device, which)),
        1 => prop_oneof![Just(Call::Detach), Just(Call::DropClient), Just(Call::Flush)],
        3 => (device.clone(), plant()).prop_map(|(device, plant)| Call::Plant(device, plant)),
        1 => (500..5_000_u64, any::<u64>()).prop_map(|(one_in, seed)| Call::Noise(one_in, seed)),
        1 => (0..40_u32).prop_map(Call::Destroy),
        1 => (0..40_u32).prop_map(Call::Disturb),
        1 => (device.clone(), 0..12_u64, select(&TornErase::ALL[..]))
            .prop_map(|(device, words, torn)| Call::CutPowerAfter(device, words, torn)),
        1 => device.prop_map(Call::Spoil),
        3 => fault().prop_map(Call::Fault),
        1 => select(&FAULTS[..]).prop_map(Call::EndFault),
        1 => select(&[BitRate::Kbit125, BitRate::Kbit250, BitRate::Kbit250][..]).prop_map(Call::SetBitRate),
    ]
}

/// Everything that a caller can see of a world after a call.
#[derive(Debug, PartialEq)]
struct Seen {
    now: Instant,
    next: Instant,
    events: Vec<Event>,
    heard: Vec<(Instant, Frame)>,
    received: Vec<Frame>,
    wire: Vec<(Instant, WireEvent)>,
    pending: usize,
    load: u8,
    disturbance: Disturbance,
    devices: Vec<DeviceSeen>,
}

#[derive(Debug, PartialEq)]
struct DeviceSeen {
    view: Option<View>,
    spool: Option<i16>,
    outputs: Option<Outputs>,
    inputs: Inputs,
    plant: Vec<Change>,
    mode: BusErrorMode,
    pending: usize,
    word_writes: u64,
}

impl Run {
    fn new(kinds: &[Kind], seed: u64) -> Self {
        let mut world = World::new(BitRate::Kbit250, seed);
        world.record_events(true);
        let devices = (0..).zip(kinds).map(|(number, kind)| {
            let node_id = Some(kind.default_node_id() + number);
            let setup = Setup { node_id, serial: Some(number.into()), ..Setup::from(*kind) };
            (*kind, world.add(&format!("device-{number}"), setup))
        });
        let devices: Vec<_> = devices.collect();
        let find = |wanted: fn(Kind) -> bool| devices.iter().find(|(kind, _)| wanted(*kind)).map(|(_, node)| *node);
        let valve = find(|kind| matches!(kind, Kind::Pve(_)));
        if let (Some(valve), Some(sensor)) = (valve, find(|kind| matches!(kind, Kind::Hat(_)))) {
            world.link(valve, sensor, Link::default()).expect("a valve and a sensor");
        }
        let (port, client) = (world.add_client_port("client port"), world.client("client"));
        let controller = world.add_controller("controller");
        world.attach(controller, BitRate::Kbit250, false);
        world.power_all(SUPPLY_JITTER);
        Self { cast: Cast { world, devices, port, controller }, client: Some(client) }
    }

    /// The same world once more, with a client in the place of the one that this has.
    fn fork(&self) -> Self {
        let mut cast = self.cast.clone();
        let client = self.client.as_ref().map(|_| cast.world.take_client("client").expect("a client"));
        Self { cast, client }
    }

    fn make_all(&mut self, calls: &[Call]) -> Vec<Seen> {
        calls.iter().map(|call| self.make(call)).collect()
    }

    fn make(&mut self, call: &Call) -> Seen {
        let Self { cast: Cast { world, devices, port, controller }, client } = self;
        let at = |device: usize| devices[device % devices.len()];
        let node = |device: usize| at(device).1;
        let frame = |device: usize, which: usize| {
            let (kind, number) = (at(device).0, u8::try_from(device % devices.len()).expect("a few"));
            let frames = frames(kind, kind.default_node_id() + number);
            frames[which % frames.len()]
        };
        match call {
            Call::RunFor(time) => world.run_for(*time),
            Call::Step => world.step(),
            Call::PowerAll => world.power_all(SUPPLY_JITTER),
            Call::Power(device, on) => world.power(node(*device), *on),
            Call::Send(device, which) => world.send(*port, frame(*device, *which)),
            Call::Transmit(device, which) => {
                if let Some(client) = client {
                    client.transmit(&frame(*device, *which)).expect("a world");
                }
            }
            Call::Offer(device, which) => world.offer(*controller, Some(frame(*device, *which))),
            Call::Detach => world.detach(*controller),
            Call::DropClient => *client = None,
            Call::Plant(device, plant) => {
                // A word that the device has not, or not while it is linked, changes nothing.
                let _ = world.set_plant(node(*device), *plant);
            }
            Call::Noise(one_in, seed) => world.inject(BitErrors::one_in(*one_in, *seed).expect("not zero")),
            Call::Destroy(frames) => world.inject(DestroyNext::frames(*frames)),
            Call::Disturb(frames) => world.disturb(Disturbance { frames: *frames, id: None }),
            Call::CutPowerAfter(device, words, torn) => {
                let flash = world.memory_mut(node(*device)).flash_mut();
                flash.set_torn_erase(*torn);
                flash.cut_power_after(*words);
            }
            Call::Spoil(device) => world.memory_mut(node(*device)).set_spoilt(true),
            Call::Fault(fault) => {
                // One that is active under this name, or cannot be, changes nothing.
                let _ = world.fault(fault.clone());
            }
            Call::EndFault(name) => drop(world.end_fault(name)),
            Call::SetBitRate(rate) => world.set_bit_rate(*rate),
            Call::Flush => world.flush_all(),
        }
        self.look()
    }

    fn look(&mut self) -> Seen {
        let Self { cast: Cast { world, devices, port, controller }, client } = self;
        let received = client.iter_mut().flat_map(|client| std::iter::from_fn(|| client.receive().ok())).collect();
        let devices = devices.iter().map(|(_, node)| DeviceSeen {
            view: world.view(*node),
            spool: world.spool_position(*node),
            outputs: world.outputs(*node),
            inputs: *world.inputs(*node),
            plant: world.plant(*node).collect(),
            mode: world.port(*node).mode(),
            pending: world.port(*node).pending(),
            word_writes: world.memory(*node).flash().word_writes(),
        });
        Seen {
            devices: devices.collect(),
            now: world.now(),
            next: world.next_event(),
            events: world.take_events().collect(),
            heard: world.take_received(*port).collect(),
            received,
            wire: world.take_wire_events(*controller).into_iter().flatten().collect(),
            pending: world.pending(*port),
            load: world.load(),
            disturbance: world.disturbance(),
        }
    }

    /// What the memories hold, with the traces of torn writes.
    fn memories(&self) -> Vec<Vec<u8>> {
        self.cast.devices.iter().map(|(_, node)| self.cast.world.memory(*node).flash().image()).collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// The clone goes first: what it shared with the original would show there.
    #[test]
    fn a_clone_goes_on_as_the_original_does(
        kinds in vec(select(&Kind::ALL[..]), 1..4),
        seed in any::<u64>(),
        before in vec(call(), 0..25),
        further in vec(call(), 1..20),
    ) {
        let mut original = Run::new(&kinds, seed);
        original.make_all(&before);
        let mut clone = original.fork();
        let of_clone = clone.make_all(&further);
        for ((call, seen), of_clone) in further.iter().zip(original.make_all(&further)).zip(of_clone) {
            prop_assert_eq!(&seen, &of_clone, "after {:?}", call);
        }
        prop_assert!(original.memories() == clone.memories(), "the memories differ");
        // Nor does a clone disturb what it was made of.
        let mut alone = Run::new(&kinds, seed);
        alone.make_all(&before);
        alone.make_all(&further);
        prop_assert!(original.memories() == alone.memories() && original.look() == alone.look());
    }
}

/// A campaign gives its worlds to threads.
#[test]
fn a_world_and_its_client_can_move_to_another_thread() {
    fn is_send<T: Send + 'static>() {}
    is_send::<World>();
    is_send::<Client>();
}
