//! Whatever is on the bus, whenever, and whatever a node senses: it does not panic, its states and numbers stay legal,
//! what it sends is well-formed and bounded, and it serves again as soon as it is let.
//!
//! The rig itself looks after every step that nothing is due any more.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::device::{self, ProductInputs};
use protocol_core::encoder::Shaft;
use protocol_core::frame::{Frame, Id, extended, standard};
use tests::hostile::{self, Disturbance, To, anything, check_services, distorted, nmt, sdo};
use tests::lss::{INQUIRE_NODE_ID, TO_CONFIGURATION, TO_WAITING, answer};
use tests::nmt::{ENTER_PRE_OPERATIONAL, START};
use tests::{Inputs, Rig};

use super::kinds::{Kind, kinds};

/// What one frame or one change of the inputs can set free at the most: all that can wait in the node.
const BURST: u64 = 64;

const INDICES: &[u16] = &[
    0x1000, 0x1001, 0x1003, 0x1005, 0x1008, 0x100A, 0x1010, 0x1011, 0x1014, 0x1017, 0x1018, 0x1028, 0x1029, 0x1400,
    0x1600, 0x1800, 0x1A00, 0x1F80, 0x2001, 0x2002, 0x201D, 0x3300, 0x3303, 0x6003, 0x6004, 0x6040, 0x6041, 0x6042,
    0x6052, 0x6053, 0x605F, 0x6300, 0x6301, 0x6503, 0x6509,
];

/// Small numbers, positions, signatures, COB-IDs, and entries of mappings.
const VALUES: &[&[u32]] = &[
    &[0, 1, 2, 3, 7, 8, 0x0C, 0x0F, 240, 0xFE, 0xFF, 0x3FFF, 0x4000, 0x7FFF, 0xC000],
    &[0x6576_6173, 0x6461_6F6C, 0x7364_6B70],
    &[0x80, 0x81, 0xA1, 0x181, 0x1A0, 0x220, 0x8000_0081, 0x8000_0181, 0x8000_01A0, 0x8000_0220],
    &[0x2000_0181, 0x3FFF_FFFF],
    &[0x6040_0010, 0x6041_0010, 0x6300_0110, 0x6301_0110, 0x0007_0020, 0x0001_0001],
    &[0x1001_0008, 0x1002_0020, 0x6004_0020, 0x6503_0010],
];

const LSS: &[u8] = &[0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x47, 0x4B, 0x4C, 0x51, 0x5A, 0x5E];
const LSS_FIRST: &[[u8; 2]] = &[[0, 0], [1, 0], [0x17, 0], [0xFF, 0], [0, 2], [0, 3], [10, 0]];

/// What can happen to a node.
#[derive(Clone, Debug)]
enum Event {
    Frame((To, bool, u8, [u8; 8])),
    /// A UDS request to the node ID, from this source, of this length.
    Uds(u16, u8, [u8; 8]),
    /// What random frames seldom get to: a valve in ACTIVE, a sensor that sends every so many milliseconds.
    Busy(u8),
    /// What a valve senses, and the shaft of a sensor.
    Sense(Inputs, Shaft),
    Around(Disturbance),
    /// Somebody looks whether all is as it may be.
    Look,
}

fn value() -> impl Strategy<Value = u32> {
    prop_oneof![4 => select(VALUES).prop_flat_map(select), 1 => any::<u32>()]
}

fn frame() -> impl Strategy<Value = Event> {
    let rpdo = (select(&[0x00, 0x01, 0x03, 0x0B, 0x0F, 0xFF][..]), value()).prop_map(|(word, value)| {
        let [low, high, ..] = value.to_le_bytes();
        (To::Own(0x200), 4, [word, 0, low, high, 0, 0, 0, 0])
    });
    let emcy = (To::Any(standard(0x0A1).into()), 8, [0x00, 0x10, 1, 1, 0, 0, 0, 0]);
    let known = prop_oneof![
        2 => nmt(&[0, 1, 0x17, 0x20]),
        4 => rpdo,
        2 => Just((To::Any(standard(0x080).into()), 0, [0; 8])),
        1 => Just(emcy),
        7 => sdo(INDICES, value()).prop_map(|data| (To::Own(0x600), 8, data)),
        3 => hostile::lss(LSS, LSS_FIRST).prop_map(|data| (To::Any(standard(0x7E5).into()), 8, data)),
    ];
    distorted(prop_oneof![9 => known, 1 => anything()]).prop_map(Event::Frame)
}

fn uds() -> impl Strategy<Value = Event> {
    let known = (select(&[0x22, 0x2E, 0x10][..]), any::<[u8; 4]>())
        .prop_map(|(service, [a, b, c, d])| (5, [4, service, a, b, c, d, 0, 0]));
    let request = prop_oneof![2 => known, 1 => (0..=8_u8, any::<[u8; 8]>())];
    (any::<u16>(), request).prop_map(|(source, (len, data))| Event::Uds(source & 0x7FF, len, data))
}

fn shaft() -> impl Strategy<Value = Shaft> {
    let speed_rpm = prop_oneof![1 => Just(0), 2 => -3_000..=3_000_i32, 1 => any::<i32>()];
    (any::<u32>(), speed_rpm, any::<bool>()).prop_map(|(angle, speed_rpm, measuring_error)| Shaft {
        speed_rpm,
        measuring_error,
        ..Shaft::at(angle)
    })
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        37 => frame(),
        3 => uds(),
        3 => (1..=20_u8).prop_map(Event::Busy),
        4 => (Inputs::any(), shaft()).prop_map(|(inputs, shaft)| Event::Sense(inputs, shaft)),
        28 => Disturbance::any().prop_map(Event::Around),
        6 => Just(Event::Look),
    ]
}

/// What is sent is well-formed. A valve has no 29-bit identifiers but those of UDS.
fn check_valve(frame: &Frame) {
    check_services(frame);
    if let Id::Extended(id) = frame.id() {
        assert_eq!(id.as_raw() >> 22, 0x6F, "a UDS answer: {frame}");
    }
}

impl Kind {
    fn check(&self) -> fn(&Frame) {
        if self.is_sensor() { check_services } else { check_valve }
    }

    /// How many frames a node can send by itself in this time.
    fn cyclic_in(&self, ms: u64) -> u64 {
        if self.is_sensor() { 2 * ms } else { ms / self.rules.heartbeat_step_ms }
    }

    /// The states are legal and go together, and numbers are in their ranges.
    fn look(&self, rig: &mut Rig) {
        let mut read = |index| hostile::read(rig, index, self.check());
        if self.is_sensor() {
            assert!(read(0x6004).is_none_or(|position| position <= 16_383));
            assert!(read(0x6003).is_none_or(|preset| preset <= 16_383));
            assert!(read(0x6509).is_none_or(|offset| (-8_192..=8_191).contains(&offset.cast_signed())));
            assert!(read(0x6503).is_none_or(|alarms| alarms <= 1));
            assert!(read(0x1001).is_none_or(|register| matches!(register, 0 | 0x11 | 0x81 | 0x91)));
            assert!(read(0x1F80).is_none_or(|startup| matches!(startup, 0x08 | 0x0C)));
            return;
        }
        let Some(status) = read(0x6041) else { return };
        assert!(matches!(status, 0x03 | 0x08 | 0x09 | 0x0B | 0x0F), "status {status:X}");
        if read(0x1001).is_some_and(|register| register != 0) {
            assert_eq!(read(0x6041).unwrap_or(0x03), 0x03, "a fault shuts the device down");
        }
        assert!(read(0x6042).is_none_or(|mode| matches!(mode, 1 | 2)));
        let status = read(0x6041);
        assert!(!rig.outputs().solenoids || status.is_none_or(|status| status == 0x0F));
    }

    fn act(&self, rig: &mut Rig, event: &Event) {
        let mut allowed = BURST;
        let node_id = rig.node_id().unwrap_or(self.node_id);
        match event {
            Event::Frame(frame) => hostile::send(rig, *frame, self.node_id.into()),
            Event::Uds(source, len, data) => {
                let id = extended(0x1BC0_0000 | u32::from(*source) << 11 | u32::from(node_id));
                rig.send_frame(Frame::with_len(id.into(), *data, *len));
            }
            Event::Busy(ms) if self.is_sensor() => {
                for object in
                    ["2F 00 18 02 FE 00 00 00", &format!("2B 00 18 05 {ms:02X} 00 00 00"), "23 00 18 01 81 01 00 00"]
                {
                    rig.send(&format!("{:03X}: {object}", 0x600 + u16::from(node_id)));
                }
                rig.send(START);
            }
            Event::Busy(_) => {
                rig.send(START);
                for _ in 0..3 {
                    rig.send(&format!("{:03X}: 0F 00 00 40", 0x200 + u16::from(node_id)));
                }
            }
            Event::Sense(valve, shaft) => {
                let mut inputs = device::Inputs::from(*valve);
                if self.is_sensor() {
                    inputs.product = ProductInputs::Encoder(Shaft { since: rig.now(), ..*shaft });
                }
                rig.sense_hat(|sensed| *sensed = inputs);
            }
            Event::Around(disturbance) => {
                disturbance.act(rig);
                allowed += self.cyclic_in(disturbance.passes_ms());
            }
            Event::Look => self.look(rig),
        }
        let mut sent = 0;
        while let Some(frame) = rig.take_next() {
            self.check()(&frame);
            sent += 1;
        }
        assert!(sent <= allowed, "{sent} frames after {event:?}");
    }

    /// With nothing in its way any more, the node answers SDO; or LSS, as long as it has no node ID.
    fn assert_serves(&self, rig: &mut Rig) {
        rig.sense_hat(|inputs| *inputs = device::Inputs::healthy(self.setup.kind));
        hostile::let_be(rig);
        rig.send(ENTER_PRE_OPERATIONAL);
        rig.take();
        if rig.node_id().is_some() {
            let device_type = if self.is_sensor() { 0x0001_0196 } else { 0x198 };
            assert_eq!(hostile::read(rig, 0x1000, self.check()), Some(device_type));
            self.look(rig);
        } else {
            rig.send(TO_CONFIGURATION);
            rig.exchange(INQUIRE_NODE_ID, &[&answer("5E FF")]);
            rig.send(TO_WAITING);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_that_happens_brings_it_down(
        number in 0..2_usize,
        has_node_id in prop::bool::weighted(0.9),
        events in vec(event(), 1..150),
    ) {
        // A valve, and a sensor.
        for kind in [&kinds()[number], &kinds()[2 + number]] {
            let mut rig = if has_node_id { Rig::power_on(kind.setup) } else { kind.blank() };
            for event in &events {
                kind.act(&mut rig, event);
            }
            kind.assert_serves(&mut rig);
            // Nor does what it has stored.
            rig.power_cycle();
            if let Some(node_id) = rig.node_id() {
                kind.boot(node_id).iter().for_each(|frame| rig.expect(frame));
            }
            kind.assert_serves(&mut rig);
        }
    }
}
