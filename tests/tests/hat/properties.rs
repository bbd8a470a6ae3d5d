//! Whatever is on the bus, whenever, and whatever the sensor senses: it does not panic, what it reads stays in its
//! range, what it sends is well-formed and bounded, and it serves again as soon as it is let.
//!
//! The rig itself looks after every step that nothing is due any more.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::hat::{Kind, Setup};
use protocol_core::device::{Inputs, ProductInputs};
use protocol_core::encoder::Shaft;
use protocol_core::frame::standard;
use tests::Rig;
use tests::hostile::{self, Disturbance, To, anything, check_services, distorted, lss, nmt, sdo};

/// What one frame or one change of the inputs can set free at the most: all that can wait in the sensor.
const BURST: u64 = 64;

/// Heartbeat and PDO come as often as every millisecond.
const CYCLIC_PER_MS: u64 = 2;

const INDICES: &[u16] = &[
    0x1000, 0x1001, 0x1003, 0x1005, 0x1008, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1029, 0x1800, 0x1A00, 0x1F80,
    0x2001, 0x2002, 0x6003, 0x6004, 0x6503, 0x6509,
];

const VALUES: &[u32] = &[
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

const LSS: &[u8] = &[0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x43, 0x46, 0x47, 0x4B, 0x4C, 0x51, 0x5A, 0x5E];
const LSS_FIRST: &[[u8; 2]] = &[[0, 0], [1, 0], [0x17, 0], [0xFF, 0], [0, 3], [10, 0]];

/// What can happen to a sensor.
#[derive(Clone, Debug)]
enum Event {
    Frame((To, bool, u8, [u8; 8])),
    /// The event timer every so many ms, in operational: what random frames seldom get to.
    Cyclic(u8),
    Sense(BusErrorMode, bool, Shaft),
    Around(Disturbance),
    /// Somebody looks whether all is as it may be.
    Look,
}

fn frame() -> impl Strategy<Value = Event> {
    let known = prop_oneof![
        2 => nmt(&[0, 1, 0x17]),
        3 => Just((To::Any(standard(0x080).into()), 0, [0; 8])),
        7 => sdo(INDICES, VALUES).prop_map(|data| (To::Own(0x600), 8, data)),
        3 => lss(LSS, LSS_FIRST).prop_map(|data| (To::Any(standard(0x7E5).into()), 8, data)),
    ];
    distorted(prop_oneof![9 => known, 1 => anything()]).prop_map(Event::Frame)
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
    prop_oneof![
        40 => frame(),
        3 => (1..=20_u8).prop_map(Event::Cyclic),
        4 => sense(),
        28 => Disturbance::any().prop_map(Event::Around),
        6 => Just(Event::Look),
    ]
}

fn setup() -> impl Strategy<Value = Setup> {
    (select(&[Kind::Hat1000, Kind::Hat3000][..]), prop::bool::weighted(0.9)).prop_map(|(kind, has_node_id)| {
        let setup = Setup::new(kind);
        Setup { node_id: setup.node_id.filter(|_| has_node_id), ..setup }
    })
}

/// Reads a number, when the sensor answers.
fn read(rig: &mut Rig, index: u16) -> Option<u32> {
    hostile::read(rig, index, check_services)
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
        Event::Frame(frame) => hostile::send(rig, *frame, 1),
        Event::Cyclic(ms) => {
            let sdo = 0x600 + rig.node_id().map_or(1, u16::from);
            for request in
                ["2F 00 18 02 FE 00 00 00", &format!("2B 00 18 05 {ms:02X} 00 00 00"), "23 00 18 01 81 01 00 00"]
            {
                rig.send(&format!("{sdo:03X}: {request}"));
            }
            rig.send("000: 01 00");
        }
        Event::Sense(bus, internal_fault, shaft) => {
            let shaft = Shaft { since: rig.now(), ..*shaft };
            rig.sense_hat(|inputs| {
                (inputs.bus, inputs.internal_fault) = (*bus, *internal_fault);
                inputs.product = ProductInputs::Encoder(shaft);
            });
        }
        Event::Around(disturbance) => {
            disturbance.act(rig);
            allowed += disturbance.passes_ms() * CYCLIC_PER_MS;
        }
        Event::Look => look(rig),
    }
    let mut sent = 0;
    while let Some(frame) = rig.take_next() {
        check_services(&frame);
        sent += 1;
    }
    assert!(sent <= allowed, "{sent} frames after {event:?}");
}

/// With nothing in its way any more, the sensor answers SDO; or LSS, as long as it has no node ID.
fn assert_serves(rig: &mut Rig) {
    rig.sense_hat(|inputs| *inputs = Inputs::encoder(Shaft::at(9_000)));
    hostile::let_be(rig);
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
