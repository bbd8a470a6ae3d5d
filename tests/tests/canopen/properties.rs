//! Whatever is on the bus, whenever, and whatever the valve senses: it does not panic, its states stay legal, what it sends
//! is well-formed and bounded, and it serves again as soon as it is let.
//!
//! The rig itself looks after every step that nothing is due any more.

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::frame::{ExtendedId, Frame, Id, StandardId, extended, standard};
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::{Rig, Senses};

/// The shortest heartbeat period: nothing that the valve sends by itself comes more often.
const SHORTEST_PERIOD_MS: u64 = 10;

/// What one frame or one change of the senses can set free at the most: all that can wait in the valve.
const BURST: u64 = 64;

/// LSS keeps the valve silent for two delays of up to this.
const LSS_DELAY_MAX: Duration = Duration::from_millis(0xFFFF);

/// Whom a frame is for.
#[derive(Clone, Copy, Debug)]
enum To {
    /// A function of the predefined connection set plus the valve's own node ID.
    Own(u16),
    /// UDS to the valve's own node ID, from this source.
    Uds(u16),
    /// An identifier.
    Any(Id),
}

/// What can happen to a valve.
#[derive(Clone, Debug)]
enum Event {
    Frame {
        to: To,
        remote: bool,
        len: u8,
        data: [u8; 8],
    },
    /// Use case 1: what random frames seldom get to.
    Activate,
    Advance(u64),
    Leap(u64),
    TurnBack(u64),
    Sense(Senses),
    HoldBus(bool),
    WritesFail(bool),
    WriteTime(u64),
    Flush,
    PowerCycle,
    WatchdogReset,
    MemoryDamaged(bool),
    /// A bit of a record rots.
    Rot(RecordKey, usize, u8),
    /// Somebody looks whether all is as it may be.
    Look,
}

fn index() -> impl Strategy<Value = u16> {
    let known = [
        0x1000, 0x1001, 0x1003, 0x1005, 0x100A, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1028, 0x1400, 0x1600, 0x1800,
        0x1A00, 0x2001, 0x201D, 0x3300, 0x3303, 0x6040, 0x6041, 0x6042, 0x6052, 0x6053, 0x605F, 0x6300, 0x6301,
    ];
    prop_oneof![9 => select(known.to_vec()), 1 => any::<u16>()]
}

fn value() -> impl Strategy<Value = u32> {
    let known = [
        0,
        1,
        2,
        3,
        7,
        0x0F,
        240,
        0xFF,
        0x4000,
        0xC000,
        0x7FFF,
        0x6576_6173,
        0x6461_6F6C,
        0x7364_6B70,
        0x80,
        0xA1,
        0x8000_0220,
        0x220,
        0x8000_01A0,
        0x1A0,
        0x6040_0010,
        0x6300_0110,
        0x6041_0010,
        0x6301_0110,
        0x0007_0020,
        0x0001_0001,
    ];
    prop_oneof![4 => select(known.to_vec()), 1 => any::<u32>()]
}

fn sdo() -> impl Strategy<Value = [u8; 8]> {
    let commands =
        [0x40, 0x22, 0x23, 0x27, 0x2B, 0x2F, 0x21, 0x20, 0x60, 0x70, 0x00, 0x10, 0x0B, 0x1D, 0x80, 0xA0, 0xC0];
    let command = prop_oneof![9 => select(commands.to_vec()), 1 => any::<u8>()];
    let sub = prop_oneof![9 => 0..=8_u8, 1 => any::<u8>()];
    (command, index(), sub, value()).prop_map(|(command, index, sub, value)| {
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        [command, low, high, sub, a, b, c, d]
    })
}

fn lss() -> impl Strategy<Value = [u8; 8]> {
    let commands = [0x04, 0x40, 0x41, 0x42, 0x43, 0x11, 0x13, 0x15, 0x17, 0x5A, 0x5E, 0x4C, 0x51];
    let command = prop_oneof![9 => select(commands.to_vec()), 1 => any::<u8>()];
    let rest = prop_oneof![
        4 => prop_oneof![Just([0, 0]), Just([1, 0]), Just([0x17, 0]), Just([0, 2]), Just([10, 0])]
            .prop_map(|[a, b]| [a, b, 0, 0, 0, 0, 0]),
        1 => any::<[u8; 7]>(),
    ];
    (command, rest).prop_map(|(command, [a, b, c, d, e, f, g])| [command, a, b, c, d, e, f, g])
}

fn frame() -> impl Strategy<Value = Event> {
    let nmt = (select(&[0x01, 0x02, 0x80, 0x81, 0x82, 0x03][..]), select(&[0, 0x20, 0x17][..]))
        .prop_map(|(command, node)| (To::Any(standard(0).into()), 2, [command, node, 0, 0, 0, 0, 0, 0]));
    let rpdo = (select(&[0x00, 0x01, 0x03, 0x0B, 0x0F, 0xFF][..]), value()).prop_map(|(word, value)| {
        let [low, high, ..] = value.to_le_bytes();
        (To::Own(0x200), 4, [word, 0, low, high, 0, 0, 0, 0])
    });
    let short =
        select(&[0x080, 0x0A1][..]).prop_map(|id| (To::Any(standard(id).into()), 8, [0x00, 0x10, 1, 1, 0, 0, 0, 0]));
    let uds = (any::<u16>(), select(&[0x22, 0x2E, 0x10][..]), any::<[u8; 4]>())
        .prop_map(|(source, service, [a, b, c, d])| (To::Uds(source & 0x7FF), 5, [4, service, a, b, c, d, 0, 0]));
    let known = prop_oneof![
        2 => nmt,
        4 => rpdo,
        2 => short,
        1 => uds,
        6 => sdo().prop_map(|data| (To::Own(0x600), 8, data)),
        3 => lss().prop_map(|data| (To::Any(standard(0x7E5).into()), 8, data)),
    ];
    let anyone = prop_oneof![
        (0..=0x7FF_u16).prop_map(|id| To::Any(standard(id).into())),
        (0..=0x1FFF_FFFF_u32).prop_map(|id| To::Any(extended(id).into())),
        select(&[0x080, 0x180, 0x200, 0x580, 0x600, 0x700][..]).prop_map(To::Own),
        any::<u16>().prop_map(|source| To::Uds(source & 0x7FF)),
    ];
    let anything = (anyone, 0..=8_u8, any::<[u8; 8]>());
    let any_length = prop_oneof![9 => Just(None), 1 => (0..=8_u8).prop_map(Some)];
    (prop_oneof![9 => known, 1 => anything], any_length, prop::bool::weighted(0.03)).prop_map(
        |((to, len, data), other_len, remote)| Event::Frame { to, remote, len: other_len.unwrap_or(len), data },
    )
}

fn senses() -> impl Strategy<Value = Senses> {
    let supply_mv = prop_oneof![4 => Just(24_000), 1 => any::<u32>(), 1 => select(&[8_999, 9_000, 36_000, 36_001][..])];
    let temperature_c = prop_oneof![4 => Just(25), 1 => any::<i16>(), 1 => select(&[-41, -40, 120, 121][..])];
    let bus = prop_oneof![
        6 => Just(BusErrorMode::ErrorActive),
        1 => Just(BusErrorMode::ErrorPassive),
        1 => Just(BusErrorMode::BusOff)
    ];
    let fault = prop_oneof![
        4 => Just(SpoolFault::None),
        1 => select(&[SpoolFault::Stuck, SpoolFault::Slow, SpoolFault::Drifting, SpoolFault::NoFloat][..])
    ];
    let position = || option::weighted(0.1, (-16384..=16384_i16).prop_map(|raw| Position::new(raw).unwrap()));
    (supply_mv, temperature_c, prop::bool::weighted(0.1), bus, fault, position(), position()).prop_map(
        |(supply_mv, temperature_c, internal_fault, bus, fault, lever, measured)| {
            let mut senses = Senses { supply_mv, temperature_c, internal_fault, bus, ..Senses::default() };
            senses.spool.fault = fault;
            senses.spool.lever = lever;
            senses.spool.measured = measured;
            senses
        },
    )
}

fn event() -> impl Strategy<Value = Event> {
    let ms = || prop_oneof![4 => 0..=60_u64, 2 => 0..=600_u64, 1 => 0..=6000_u64];
    prop_oneof![
        40 => frame(),
        2 => Just(Event::Activate),
        12 => ms().prop_map(Event::Advance),
        4 => prop_oneof![4 => ms().prop_map(|ms| ms * 1000), 1 => 0..=1_u64 << 40].prop_map(Event::Leap),
        1 => ms().prop_map(Event::TurnBack),
        4 => senses().prop_map(Event::Sense),
        2 => any::<bool>().prop_map(Event::HoldBus),
        2 => any::<bool>().prop_map(Event::WritesFail),
        2 => ms().prop_map(Event::WriteTime),
        1 => Just(Event::Flush),
        1 => Just(Event::PowerCycle),
        1 => Just(Event::WatchdogReset),
        1 => prop::bool::weighted(0.2).prop_map(Event::MemoryDamaged),
        1 => (select(&RecordKey::ALL[..]), any::<usize>(), 0..8_u8).prop_map(|(key, at, bit)| Event::Rot(key, at, bit)),
        6 => Just(Event::Look),
    ]
}

fn setup() -> impl Strategy<Value = Setup> {
    (select(&[Kind::PveaCanopen, Kind::PveoCanopen][..]), prop::bool::weighted(0.9)).prop_map(|(kind, has_node_id)| {
        let setup = Setup::new(kind);
        Setup { node_id: setup.node_id.filter(|_| has_node_id), ..setup }
    })
}

/// What is sent is well-formed. A TPDO can have any identifier that is not another service's.
fn check_frame(frame: &Frame) {
    assert!(!frame.is_remote(), "{frame}");
    let data = frame.data();
    match frame.id() {
        Id::Standard(id) => match id.as_raw() {
            0x701..=0x77F => assert!(matches!(data, [0x00 | 0x04 | 0x05 | 0x7F]), "an NMT state: {frame}"),
            0x581..=0x5FF => assert!(data.len() == 8 && matches!(data[0] >> 5, 0..=4), "an SDO answer: {frame}"),
            0x7E4 => assert_eq!(data.len(), 8, "an LSS answer: {frame}"),
            0x000..=0x07F | 0x601..=0x67F | 0x6E0..=0x6FF | 0x780..=0x7FF => panic!("not a valve's: {frame}"),
            _ => {}
        },
        Id::Extended(id) => assert_eq!(id.as_raw() >> 22, 0x6F, "a UDS answer: {frame}"),
    }
}

/// Reads a number, when the valve answers.
fn read(rig: &mut Rig, index: u16) -> Option<u32> {
    let node_id = u16::from(rig.node_id()?);
    let [low, high] = index.to_le_bytes();
    rig.send_frame(Frame::full(standard(0x600 | node_id).into(), [0x40, low, high, 0, 0, 0, 0, 0]));
    let mut number = None;
    while let Some(frame) = rig.take_next() {
        check_frame(&frame);
        let &[command, answered_low, answered_high, 0, a, b, c, d] = frame.bytes() else { continue };
        let answers = frame.id() == standard(0x580 | node_id).into() && (answered_low, answered_high) == (low, high);
        if answers && matches!(command, 0x43 | 0x4B | 0x4F) {
            number = Some(u32::from_le_bytes([a, b, c, d]));
        }
    }
    number
}

/// The states are legal, and go together.
fn look(rig: &mut Rig) {
    let Some(status) = read(rig, 0x6041) else { return };
    assert!(matches!(status, 0x03 | 0x08 | 0x09 | 0x0B | 0x0F), "status {status:X}");
    if let Some(register) = read(rig, 0x1001)
        && register != 0
    {
        assert_eq!(read(rig, 0x6041).unwrap_or(0x03), 0x03, "a fault shuts the device down");
    }
    assert!(!rig.outputs().solenoids || read(rig, 0x6041).is_none_or(|status| status == 0x0F));
    assert!(read(rig, 0x6042).is_none_or(|mode| matches!(mode, 1 | 2)));
}

fn act(rig: &mut Rig, event: &Event) {
    let mut allowed = BURST;
    match event {
        Event::Frame { to, remote, len, data } => {
            let node_id = u16::from(rig.node_id().unwrap_or(0x20));
            let id: Id = match *to {
                To::Own(function) => StandardId::new(function + node_id).unwrap().into(),
                To::Uds(source) => {
                    ExtendedId::new(0x1BC0_0000 | u32::from(source) << 11 | u32::from(node_id)).unwrap().into()
                }
                To::Any(id) => id,
            };
            rig.send_frame(if *remote { Frame::remote(id, *len) } else { Frame::with_len(id, *data, *len) });
        }
        Event::Activate => {
            rig.send("000: 01 00");
            let node_id = u16::from(rig.node_id().unwrap_or(0x20));
            for _ in 0..3 {
                rig.send(&format!("{:03X}: 0F 00 00 40", 0x200 + node_id));
            }
        }
        Event::Advance(ms) => {
            rig.advance(*ms);
            allowed += ms / SHORTEST_PERIOD_MS;
        }
        Event::Leap(us) => rig.leap(Duration::from_micros(*us)),
        Event::TurnBack(ms) => rig.turn_back(Duration::from_millis(*ms)),
        Event::Sense(senses) => rig.sense(|sensed| *sensed = *senses),
        Event::HoldBus(held) => rig.hold_bus(*held),
        Event::WritesFail(fail) => rig.writes_fail = *fail,
        Event::WriteTime(ms) => rig.write_time = Duration::from_millis(*ms),
        Event::Flush => rig.flush(),
        Event::PowerCycle => rig.power_cycle(),
        Event::WatchdogReset => rig.watchdog_reset(),
        Event::MemoryDamaged(damaged) => rig.memory_damaged = *damaged,
        Event::Rot(key, at, bit) => {
            if let Some(record) = rig.records.get_mut(key).filter(|record| !record.is_empty()) {
                let at = at % record.len();
                record[at] ^= 1 << bit;
            }
        }
        Event::Look => look(rig),
    }
    let mut sent = 0;
    while let Some(frame) = rig.take_next() {
        check_frame(&frame);
        sent += 1;
    }
    assert!(sent <= allowed, "{sent} frames after {event:?}");
}

/// With nothing in its way any more, the valve answers SDO; or LSS, as long as it has no node ID.
fn assert_serves(rig: &mut Rig) {
    rig.writes_fail = false;
    rig.write_time = Duration::from_ticks(0);
    rig.memory_damaged = false;
    rig.hold_bus(false);
    rig.sense(|senses| *senses = Senses::default());
    // What is being written, and the delays of LSS, come to an end.
    for _ in 0..3 {
        rig.leap(LSS_DELAY_MAX);
    }
    rig.send("000: 80 00");
    rig.take();
    if rig.node_id().is_some() {
        assert_eq!(read(rig, 0x1000), Some(0x198));
        look(rig);
    } else {
        rig.send("7E5: 04 01 00 00 00 00 00 00");
        rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E FF 00 00 00 00 00 00"]);
        rig.send("7E5: 04 00 00 00 00 00 00 00");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_that_happens_brings_it_down(setup in setup(), events in vec(event(), 1..150)) {
        let mut rig = Rig::power_on(setup);
        for event in &events {
            act(&mut rig, event);
        }
        assert_serves(&mut rig);
        // Nor does what it has stored.
        rig.power_cycle();
        if let Some(node_id) = rig.node_id() {
            rig.expect(&format!("{:03X}: 00", 0x700 + u16::from(node_id)));
            rig.expect(&format!("{:03X}: 00 00 00 00 00 00 00 00", 0x080 + u16::from(node_id)));
        }
        assert_serves(&mut rig);
    }
}
