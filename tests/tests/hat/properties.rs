//! Whatever is on the bus, whenever, and whatever the sensor senses: it does not panic, what it reads stays in its range,
//! what it sends is well-formed and bounded, and it serves again as soon as it is let.
//!
//! The rig itself looks after every step that nothing is due any more.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::hat::{Kind, Setup};
use protocol_core::device::{ProductSenses, Senses};
use protocol_core::encoder::Shaft;
use protocol_core::frame::{Frame, Id, extended, standard};
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::Rig;

/// What one frame or one change of the senses can set free at the most: all that can wait in the sensor.
const BURST: u64 = 64;

/// Heartbeat and PDO come as often as every millisecond.
const CYCLIC_PER_MS: u64 = 2;

/// LSS keeps the sensor silent for two delays of up to this.
const LSS_DELAY_MAX: Duration = Duration::from_millis(0xFFFF);

/// Whom a frame is for.
#[derive(Clone, Copy, Debug)]
enum To {
    /// A function of the predefined connection set plus the sensor's own node ID.
    Own(u16),
    /// An identifier.
    Any(Id),
}

/// What can happen to a sensor.
#[derive(Clone, Debug)]
enum Event {
    Frame {
        to: To,
        remote: bool,
        len: u8,
        data: [u8; 8],
    },
    /// The event timer every so many ms, in operational: what random frames seldom get to.
    Cyclic(u8),
    Advance(u64),
    Leap(u64),
    TurnBack(u64),
    Sense(BusErrorMode, bool, Shaft),
    HoldBus(bool),
    WritesFail(bool),
    WriteTime(u64),
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
        0x1000, 0x1001, 0x1003, 0x1005, 0x1008, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1029, 0x1800, 0x1A00, 0x1F80,
        0x2001, 0x2002, 0x6003, 0x6004, 0x6503, 0x6509,
    ];
    prop_oneof![9 => select(known.to_vec()), 1 => any::<u16>()]
}

fn value() -> impl Strategy<Value = u32> {
    let known = [
        0,
        1,
        2,
        3,
        8,
        0x0C,
        16_383,
        0xFE,
        0xFF,
        0x6576_6173,
        0x6461_6F6C,
        0x80,
        0x81,
        0x181,
        0x8000_0081,
        0x8000_0181,
        0x2000_0181,
        0x3FFF_FFFF,
        0x1001_0008,
        0x1002_0020,
        0x6004_0020,
        0x6503_0010,
    ];
    prop_oneof![4 => select(known.to_vec()), 1 => any::<u32>()]
}

fn sdo() -> impl Strategy<Value = [u8; 8]> {
    let commands = [0x40, 0x22, 0x23, 0x2B, 0x2F, 0x21, 0x60, 0x70, 0x00, 0x80, 0xA0, 0xC0];
    let command = prop_oneof![9 => select(commands.to_vec()), 1 => any::<u8>()];
    let sub = prop_oneof![9 => 0..=8_u8, 1 => any::<u8>()];
    (command, index(), sub, value()).prop_map(|(command, index, sub, value)| {
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        [command, low, high, sub, a, b, c, d]
    })
}

fn lss() -> impl Strategy<Value = [u8; 8]> {
    let commands = [0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x43, 0x46, 0x47, 0x4B, 0x4C, 0x51, 0x5A, 0x5E];
    let command = prop_oneof![9 => select(commands.to_vec()), 1 => any::<u8>()];
    let rest = prop_oneof![
        4 => prop_oneof![Just([0, 0]), Just([1, 0]), Just([0x17, 0]), Just([0xFF, 0]), Just([0, 3]), Just([10, 0])]
            .prop_map(|[a, b]| [a, b, 0, 0, 0, 0, 0]),
        1 => any::<[u8; 7]>(),
    ];
    (command, rest).prop_map(|(command, [a, b, c, d, e, f, g])| [command, a, b, c, d, e, f, g])
}

fn frame() -> impl Strategy<Value = Event> {
    let nmt = (select(&[0x01, 0x02, 0x80, 0x81, 0x82, 0x03][..]), select(&[0, 1, 0x17][..]))
        .prop_map(|(command, node)| (To::Any(standard(0).into()), 2, [command, node, 0, 0, 0, 0, 0, 0]));
    let known = prop_oneof![
        2 => nmt,
        3 => Just((To::Any(standard(0x080).into()), 0, [0; 8])),
        7 => sdo().prop_map(|data| (To::Own(0x600), 8, data)),
        3 => lss().prop_map(|data| (To::Any(standard(0x7E5).into()), 8, data)),
    ];
    let anyone = prop_oneof![
        (0..=0x7FF_u16).prop_map(|id| To::Any(standard(id).into())),
        (0..=0x1FFF_FFFF_u32).prop_map(|id| To::Any(extended(id).into())),
        select(&[0x080, 0x180, 0x200, 0x580, 0x600, 0x700][..]).prop_map(To::Own),
    ];
    let anything = (anyone, 0..=8_u8, any::<[u8; 8]>());
    let any_length = prop_oneof![9 => Just(None), 1 => (0..=8_u8).prop_map(Some)];
    (prop_oneof![9 => known, 1 => anything], any_length, prop::bool::weighted(0.03)).prop_map(
        |((to, len, data), other_len, remote)| Event::Frame { to, remote, len: other_len.unwrap_or(len), data },
    )
}

fn sense() -> impl Strategy<Value = Event> {
    let bus = prop_oneof![
        6 => Just(BusErrorMode::ErrorActive),
        1 => Just(BusErrorMode::ErrorPassive),
        1 => Just(BusErrorMode::BusOff)
    ];
    let speed_rpm = prop_oneof![1 => Just(0), 2 => -3_000..=3_000_i32, 1 => any::<i32>()];
    (bus, prop::bool::weighted(0.1), any::<u32>(), speed_rpm, any::<bool>()).prop_map(
        |(bus, internal_fault, angle_cdeg, speed_rpm, measuring_error)| {
            Event::Sense(bus, internal_fault, Shaft { speed_rpm, measuring_error, ..Shaft::at(angle_cdeg) })
        },
    )
}

fn event() -> impl Strategy<Value = Event> {
    let ms = || prop_oneof![4 => 0..=60_u64, 2 => 0..=600_u64, 1 => 0..=3000_u64];
    prop_oneof![
        40 => frame(),
        3 => (1..=20_u8).prop_map(Event::Cyclic),
        12 => ms().prop_map(Event::Advance),
        4 => prop_oneof![4 => ms().prop_map(|ms| ms * 1000), 1 => 0..=1_u64 << 40].prop_map(Event::Leap),
        1 => ms().prop_map(Event::TurnBack),
        4 => sense(),
        2 => any::<bool>().prop_map(Event::HoldBus),
        2 => any::<bool>().prop_map(Event::WritesFail),
        2 => ms().prop_map(Event::WriteTime),
        1 => Just(Event::PowerCycle),
        1 => Just(Event::WatchdogReset),
        1 => prop::bool::weighted(0.2).prop_map(Event::MemoryDamaged),
        1 => (select(&RecordKey::ALL[..]), any::<usize>(), 0..8_u8).prop_map(|(key, at, bit)| Event::Rot(key, at, bit)),
        6 => Just(Event::Look),
    ]
}

fn setup() -> impl Strategy<Value = Setup> {
    (select(&[Kind::Hat1000, Kind::Hat3000][..]), prop::bool::weighted(0.9)).prop_map(|(kind, has_node_id)| {
        let setup = Setup::new(kind);
        Setup { node_id: setup.node_id.filter(|_| has_node_id), ..setup }
    })
}

/// What is sent is well-formed. A PDO or an EMCY can have any identifier that is not another service's.
fn check_frame(frame: &Frame) {
    assert!(!frame.is_remote(), "{frame}");
    let Id::Standard(id) = frame.id() else { return };
    let data = frame.data();
    match id.as_raw() {
        0x701..=0x77F => assert!(matches!(data, [0x00 | 0x04 | 0x05 | 0x7F]), "an NMT state: {frame}"),
        0x581..=0x5FF => assert!(data.len() == 8 && matches!(data[0] >> 5, 0..=4), "an SDO answer: {frame}"),
        0x7E4 => assert_eq!(data.len(), 8, "an LSS answer: {frame}"),
        0x000..=0x07F | 0x601..=0x67F | 0x6E0..=0x6FF | 0x780..=0x7FF => panic!("not a sensor's: {frame}"),
        _ => {}
    }
}

/// Reads a number, when the sensor answers.
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

/// What is read is in its range.
fn look(rig: &mut Rig) {
    assert!(read(rig, 0x6004).is_none_or(|position| position <= 16_383));
    assert!(read(rig, 0x6003).is_none_or(|preset| preset <= 16_383));
    assert!(read(rig, 0x6509).is_none_or(|offset| (-8_192..=8_191).contains(&offset.cast_signed())));
    assert!(read(rig, 0x6503).is_none_or(|alarms| alarms <= 1));
    assert!(read(rig, 0x1001).is_none_or(|register| matches!(register, 0 | 0x11 | 0x81 | 0x91)));
    assert!(read(rig, 0x1F80).is_none_or(|startup| matches!(startup, 0x08 | 0x0C)));
}

fn act(rig: &mut Rig, event: &Event) {
    let mut allowed = BURST;
    match event {
        Event::Frame { to, remote, len, data } => {
            let node_id = u16::from(rig.node_id().unwrap_or(1));
            let id = match *to {
                To::Own(function) => standard(function + node_id).into(),
                To::Any(id) => id,
            };
            rig.send_frame(if *remote { Frame::remote(id, *len) } else { Frame::with_len(id, *data, *len) });
        }
        Event::Cyclic(ms) => {
            let sdo = 0x600 + rig.node_id().map_or(1, u16::from);
            for request in
                ["2F 00 18 02 FE 00 00 00", &format!("2B 00 18 05 {ms:02X} 00 00 00"), "23 00 18 01 81 01 00 00"]
            {
                rig.send(&format!("{sdo:03X}: {request}"));
            }
            rig.send("000: 01 00");
        }
        Event::Advance(ms) => {
            rig.advance(*ms);
            allowed += ms * CYCLIC_PER_MS;
        }
        Event::Leap(us) => rig.leap(Duration::from_micros(*us)),
        Event::TurnBack(ms) => rig.turn_back(Duration::from_millis(*ms)),
        Event::Sense(bus, internal_fault, shaft) => {
            let shaft = Shaft { since: rig.now(), ..*shaft };
            rig.sense_hat(|senses| {
                (senses.bus, senses.internal_fault) = (*bus, *internal_fault);
                senses.product = ProductSenses::Encoder(shaft);
            });
        }
        Event::HoldBus(held) => rig.hold_bus(*held),
        Event::WritesFail(fail) => rig.writes_fail = *fail,
        Event::WriteTime(ms) => rig.write_time = Duration::from_millis(*ms),
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

/// With nothing in its way any more, the sensor answers SDO; or LSS, as long as it has no node ID.
fn assert_serves(rig: &mut Rig) {
    rig.writes_fail = false;
    rig.write_time = Duration::from_ticks(0);
    rig.memory_damaged = false;
    rig.hold_bus(false);
    rig.sense_hat(|senses| *senses = Senses::encoder(Shaft::at(9_000)));
    // What is being written, and the delays of LSS, come to an end.
    for _ in 0..3 {
        rig.leap(LSS_DELAY_MAX);
    }
    rig.send("000: 80 00");
    rig.take();
    if rig.node_id().is_some() {
        assert_eq!(read(rig, 0x1000), Some(0x0001_0196));
        look(rig);
    } else {
        rig.send("7E5: 04 01 00 00 00 00 00 00");
        rig.exchange("7E5: 5E 00 00 00 00 00 00 00", &["7E4: 5E FF 00 00 00 00 00 00"]);
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
        }
        assert_serves(&mut rig);
    }
}
