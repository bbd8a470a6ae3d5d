//! Whatever is on the bus, whenever, and whatever the valve senses: it does not panic, its states stay legal, what it
//! sends is well-formed and bounded, and it serves again as soon as it is let.
//!
//! The rig itself looks after every step that nothing is due any more.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::frame::{Frame, Id, extended, standard};
use tests::hostile::{self, Disturbance, To, anything, check_services, distorted, lss, nmt, sdo};
use tests::{Inputs, Rig};

/// The shortest heartbeat period: nothing that the valve sends by itself comes more often.
const SHORTEST_PERIOD_MS: u64 = 10;

/// What one frame or one change of the inputs can set free at the most: all that can wait in the valve.
const BURST: u64 = 64;

const INDICES: &[u16] = &[
    0x1000, 0x1001, 0x1003, 0x1005, 0x100A, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1028, 0x1400, 0x1600, 0x1800,
    0x1A00, 0x2001, 0x201D, 0x3300, 0x3303, 0x6040, 0x6041, 0x6042, 0x6052, 0x6053, 0x605F, 0x6300, 0x6301,
];

const VALUES: &[u32] = &[
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

const LSS: &[u8] = &[0x04, 0x40, 0x41, 0x42, 0x43, 0x11, 0x13, 0x15, 0x17, 0x5A, 0x5E, 0x4C, 0x51];
const LSS_FIRST: &[[u8; 2]] = &[[0, 0], [1, 0], [0x17, 0], [0, 2], [10, 0]];

/// What can happen to a valve.
#[derive(Clone, Debug)]
enum Event {
    Frame((To, bool, u8, [u8; 8])),
    /// A UDS request to the valve's own node ID, from this source, of this length.
    Uds(u16, u8, [u8; 8]),
    /// Use case 1: what random frames seldom get to.
    Activate,
    Sense(Inputs),
    Around(Disturbance),
    /// Somebody looks whether all is as it may be.
    Look,
}

fn value() -> impl Strategy<Value = u32> {
    prop_oneof![4 => select(VALUES), 1 => any::<u32>()]
}

fn frame() -> impl Strategy<Value = Event> {
    let rpdo = (select(&[0x00, 0x01, 0x03, 0x0B, 0x0F, 0xFF][..]), value()).prop_map(|(word, value)| {
        let [low, high, ..] = value.to_le_bytes();
        (To::Own(0x200), 4, [word, 0, low, high, 0, 0, 0, 0])
    });
    let short =
        select(&[0x080, 0x0A1][..]).prop_map(|id| (To::Any(standard(id).into()), 8, [0x00, 0x10, 1, 1, 0, 0, 0, 0]));
    let known = prop_oneof![
        2 => nmt(&[0, 0x20, 0x17]),
        4 => rpdo,
        2 => short,
        6 => sdo(INDICES, VALUES).prop_map(|data| (To::Own(0x600), 8, data)),
        3 => lss(LSS, LSS_FIRST).prop_map(|data| (To::Any(standard(0x7E5).into()), 8, data)),
    ];
    distorted(prop_oneof![9 => known, 1 => anything()]).prop_map(Event::Frame)
}

fn uds() -> impl Strategy<Value = Event> {
    let known = (select(&[0x22, 0x2E, 0x10][..]), any::<[u8; 4]>())
        .prop_map(|(service, [a, b, c, d])| (5, [4, service, a, b, c, d, 0, 0]));
    let request = prop_oneof![2 => known, 1 => (0..=8_u8, any::<[u8; 8]>())];
    (any::<u16>(), request).prop_map(|(source, (len, data))| Event::Uds(source & 0x7FF, len, data))
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        37 => frame(),
        3 => uds(),
        2 => Just(Event::Activate),
        4 => Inputs::any().prop_map(Event::Sense),
        28 => Disturbance::any().prop_map(Event::Around),
        6 => Just(Event::Look),
    ]
}

fn setup() -> impl Strategy<Value = Setup> {
    (select(&[Kind::PveaCanopen, Kind::PveoCanopen][..]), prop::bool::weighted(0.9)).prop_map(|(kind, has_node_id)| {
        let setup = Setup::new(kind);
        Setup { node_id: setup.node_id.filter(|_| has_node_id), ..setup }
    })
}

/// What is sent is well-formed. A valve has no 29-bit identifiers but those of UDS.
fn check_frame(frame: &Frame) {
    check_services(frame);
    if let Id::Extended(id) = frame.id() {
        assert_eq!(id.as_raw() >> 22, 0x6F, "a UDS answer: {frame}");
    }
}

/// Reads a number, when the valve answers.
fn read(rig: &mut Rig, index: u16) -> Option<u32> {
    hostile::read(rig, index, check_frame)
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
        Event::Frame(frame) => hostile::send(rig, *frame, 0x20),
        Event::Uds(source, len, data) => {
            let node_id = u32::from(rig.node_id().unwrap_or(0x20));
            let id = extended(0x1BC0_0000 | u32::from(*source) << 11 | node_id);
            rig.send_frame(Frame::with_len(id.into(), *data, *len));
        }
        Event::Activate => {
            rig.send("000: 01 00");
            let node_id = u16::from(rig.node_id().unwrap_or(0x20));
            for _ in 0..3 {
                rig.send(&format!("{:03X}: 0F 00 00 40", 0x200 + node_id));
            }
        }
        Event::Sense(inputs) => rig.sense(|sensed| *sensed = *inputs),
        Event::Around(disturbance) => {
            disturbance.act(rig);
            allowed += disturbance.passes_ms() / SHORTEST_PERIOD_MS;
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
    rig.sense(|inputs| *inputs = Inputs::default());
    hostile::let_be(rig);
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
