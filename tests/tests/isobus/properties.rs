//! Whatever is on the bus of an ISOBUS valve, whenever, and whatever it senses: it does not panic, is silent when it
//! must be, what it sends is well-formed, and it serves again as soon as it is let (SPEC 5).
//!
//! The rig itself looks after every step that nothing is due any more. Rules that can be told in a few lines are told
//! again here, as models that the valve must agree with at every step.

use std::collections::BTreeMap;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::frame::{Frame, Id, extended, standard};
use protocol_core::time::Duration;
use tests::hostile::Disturbance;
use tests::isobus::{BLOCK, CANNOT_CLAIM, CLAIM, DM1_CLEAR, HAND, LOWER_NAME, STOP};
use tests::{Inputs, Rig};

/// What can be set free by one event: all that can wait in the valve, and what it sends in the time that passes.
const BURST: u64 = 40;

/// What can happen to a valve.
#[derive(Clone, Debug)]
enum Event {
    Frame(Frame),
    Sense(Inputs),
    Around(Disturbance),
}

/// Eight bytes under an identifier, sometimes of another length, sometimes a remote frame.
fn under(id: u32, data: [u8; 8]) -> impl Strategy<Value = Frame> {
    under_len(id, data, 8)
}

fn under_len(id: u32, data: [u8; 8], len: u8) -> impl Strategy<Value = Frame> {
    let len = prop_oneof![12 => Just(len), 1 => 0..=8_u8];
    (len, prop::bool::weighted(0.02)).prop_map(move |(len, remote)| {
        let id = extended(id).into();
        if remote { Frame::remote(id, len) } else { Frame::with_len(id, data, len) }
    })
}

fn command_frame() -> impl Strategy<Value = Frame> {
    let state = prop_oneof![9 => select(&[0x30, 0x31, 0x32, 0x33, 0x3A, 0x3E][..]), 1 => any::<u8>()];
    let flow = prop_oneof![3 => select(&[0, 1, 125, 250][..]), 1 => any::<u8>()];
    let number = prop_oneof![9 => Just(3), 1 => 0..16_u32];
    (number, flow, state, any::<u8>()).prop_flat_map(|(number, flow, state, source)| {
        under(0x0CFE_3000 | number << 8 | u32::from(source), [flow, 0xFF, state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF])
    })
}

fn request_frame() -> impl Strategy<Value = Frame> {
    let groups = [0xEE00, 0xFECA, 0xFECB, 0xFECC, 0xFE13, 0xFE14, 0xFF00];
    let group = prop_oneof![9 => select(groups.to_vec()), 1 => any::<u32>()];
    let destination = prop_oneof![6 => Just(0x83), 3 => Just(0xFF), 1 => any::<u8>()];
    (group, destination, any::<u8>()).prop_flat_map(|(group, destination, source)| {
        let [a, b, c, _] = group.to_le_bytes();
        let id = 0x18EA_0000 | u32::from(destination) << 8 | u32::from(source);
        under_len(id, [a, b, c, 0, 0, 0, 0, 0], 3)
    })
}

/// The valve's NAME, and those around it.
fn name() -> impl Strategy<Value = u64> {
    const OWN: u64 = 0x2002_FF08_0720_0001;
    prop_oneof![4 => select(&[OWN, OWN - 1, OWN + 1][..]), 2 => any::<u64>(), 4 => OWN + 1..]
}

fn claim_frame() -> impl Strategy<Value = Frame> {
    let source = prop_oneof![9 => Just(0x83), 1 => any::<u8>()];
    (source, name()).prop_flat_map(|(source, name)| under(0x18EE_FF00 | u32::from(source), name.to_le_bytes()))
}

/// Frames of the transport protocol, of 16 senders. Address 0x83 alone is commanded.
fn transport_frame() -> impl Strategy<Value = Frame> {
    let payloads = [
        (0x1CEC_FF00, [0x20, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]),
        (0x1CEC_FF00, [0x20, 18, 0, 3, 0xFF, 0xCB, 0xFE, 0]),
        (0x1CEC_FF00, [0x20, 9, 0, 3, 0xFF, 0xD8, 0xFE, 0]),
        (0x1CEC_FF00, [0xFF, 1, 0xFF, 0xFF, 0xFF, 0xD8, 0xFE, 0]),
        (0x1CEB_FF00, [1, 0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02]),
        (0x1CEB_FF00, [2, 0x20, 0x83, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]),
        (0x1CEB_FF00, [2, 0x20, 0x90, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]),
        (0x1CEB_FF00, [3, 0x20, 0x83, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]),
        (0x1CEB_8300, [1, 0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02]),
    ];
    (select(payloads.to_vec()), 0..16_u32).prop_flat_map(|((id, data), source)| under(id | source, data))
}

fn uds_frame() -> impl Strategy<Value = Frame> {
    let requests =
        [[3, 0x22, 0xF0, 0x10, 0, 0, 0, 0], [4, 0x2E, 0x10, 0x01, 0x83, 0, 0, 0], [4, 0x2E, 0x10, 0x01, 0x7F, 0, 0, 0]];
    (select(requests.to_vec()), 0..=0x7FF_u32)
        .prop_flat_map(|(request, source)| under_len(0x1BC0_0083 | source << 11, request, request[0] + 1))
}

/// Anything but the end of a commanded address.
fn noise() -> impl Strategy<Value = Frame> {
    (any::<bool>(), any::<u32>(), any::<[u8; 8]>(), 0..=8_u8).prop_map(|(long, id, data, len)| {
        let id: Id = if long { extended(id & 0x1FFF_FFFF).into() } else { standard((id & 0x7FF) as u16).into() };
        Frame::with_len(id, data, len)
    })
}

/// Frames of everything but the transport protocol.
fn plain_frame() -> impl Strategy<Value = Frame> {
    prop_oneof![
        4 => command_frame(),
        3 => request_frame(),
        1 => claim_frame(),
        1 => uds_frame(),
        1 => noise(),
    ]
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        40 => plain_frame().prop_map(Event::Frame),
        20 => transport_frame().prop_map(Event::Frame),
        6 => Inputs::any().prop_map(Event::Sense),
        32 => Disturbance::any().prop_map(Event::Around),
    ]
}

fn act(rig: &mut Rig, event: &Event) {
    match event {
        Event::Frame(frame) => rig.send_frame(*frame),
        Event::Sense(inputs) => rig.sense(|sensed| *sensed = *inputs),
        Event::Around(disturbance) => disturbance.act(rig),
    }
}

fn setup() -> impl Strategy<Value = Setup> {
    select(&[Kind::PveaIsobus, Kind::PveoIsobus][..]).prop_map(|kind| Setup { node_id: Some(0x83), ..Setup::new(kind) })
}

/// The trouble codes of SPEC 3, with their lamps.
const CODES: [([u8; 3], u8); 8] = [
    ([0xEC, 0x8F, 0x87], 0x10),
    ([0xEE, 0x8F, 0x87], 0x10),
    ([0xFA, 0x8F, 0x8B], 0x10),
    ([0xD7, 0x8F, 0x93], 0x04),
    ([0xF1, 0x8F, 0x90], 0x04),
    ([0x73, 0x02, 0x03], 0x04),
    ([0x73, 0x02, 0x04], 0x04),
    ([0xE9, 0x8F, 0x93], 0x04),
];

/// What is sent is one of the valve's messages, well-formed, under the address 0x83 or, with a damaged memory, 0x80.
fn check_frame(frame: &Frame) {
    let Id::Extended(id) = frame.id() else { panic!("11 bits: {frame}") };
    assert!(!frame.is_remote(), "{frame}");
    let (id, data) = (id.as_raw(), frame.data());
    if id >> 22 == 0x6F {
        assert!((3..=8).contains(&data.len()) && usize::from(data[0]) + 1 == data.len(), "a UDS answer: {frame}");
        return;
    }
    assert!(frame.to_string() == CANNOT_CLAIM || matches!(id & 0xFF, 0x80 | 0x83), "{frame}");
    match (id >> 8, data) {
        (0x18_EEFF, name) => assert_eq!(name[5..], [0xFF, 0x02, 0x20], "{frame}"),
        (0x0C_FE13 | 0x0C_FE10, &[extend, retract, state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]) => {
            assert!(extend == 125 && (125..=225).contains(&retract) || retract == 125 && (125..=225).contains(&extend));
            assert!(matches!(state, 0x30..=0x33 | 0x3A | 0x3E), "{frame}");
        }
        (0x18_FECA | 0x18_FECB, &[0, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF]) => {}
        (0x18_FECA | 0x18_FECB, &[lamp, 0xFF, a, b, c, 1..=127, 0xFF, 0xFF]) => {
            assert!(CODES.contains(&([a, b, c], lamp)), "{frame}");
        }
        (0x18_E8FF, &[0, 0xFF, 0xFF, 0xFF, _, 0xCC, 0xFE, 0]) | (0x18_E8FF, &[1, 0xFF, 0xFF, 0xFF, ..]) => {}
        (0x1C_ECFF, &[0x20, size, 0, packets, 0xFF, 0xCB, 0xFE, 0]) => {
            assert!((10..=34).contains(&size) && size % 4 == 2 && packets == size.div_ceil(7), "{frame}");
        }
        (0x1C_EBFF, &[1..=5, _, _, _, _, _, _, _]) => {}
        _ => panic!("not a valve's: {frame}"),
    }
}

/// With nothing in its way any more, the valve claims, is led out of its shutdown, moves, and tells so.
fn assert_serves(rig: &mut Rig) {
    rig.writes_fail = false;
    rig.write_time = Duration::from_ticks(0);
    rig.memory_damaged = false;
    rig.records.clear();
    rig.sense(|inputs| *inputs = Inputs::default());
    rig.hold_bus(false);
    rig.restart();
    assert_eq!(rig.node_id(), Some(0x83));
    rig.recover();
    rig.take();
    let extend = "0CFE3327: FA FF 31 FF FF FF FF FF";
    rig.send(extend);
    rig.advance_cyclic(400, extend);
    assert_eq!(rig.take(), ["A5", "CD", "E1", "E1"].map(|flow| format!("0CFE1383: {flow} 7D 31 FF FF FF FF FF")));
    rig.exchange("18EA8327: 00 EE 00", &[CLAIM]);
    rig.exchange("18EAFF27: CA FE 00", &[DM1_CLEAR]);
}

/// What the valve makes of its fault 8 and of recovery, told again.
#[derive(Default)]
struct Guarded {
    running: bool,
    ms_since: u64,
    active: bool,
    count: u8,
    shut_down: bool,
    neutral: u8,
    state: u8,
}

impl Guarded {
    fn pass(&mut self, ms: u64) {
        self.ms_since += ms;
        if self.running && !self.active && self.ms_since >= 250 {
            *self = Self { active: true, count: self.count + 1, shut_down: true, neutral: 0, ..*self };
        }
    }

    fn command(&mut self, state: u8, neutral: bool) {
        *self = Self { running: true, ms_since: 0, active: false, state, ..*self };
        self.neutral = if neutral { self.neutral + 1 } else { 0 };
        if self.shut_down && self.neutral == 2 {
            *self = Self { shut_down: false, state: 0, ..*self };
        }
        if !self.shut_down {
            self.neutral = 0;
        }
    }

    fn state(&self) -> u8 {
        if self.shut_down { 0x30 } else { 0x30 | self.state }
    }

    fn dm1(&self) -> String {
        if self.active { format!("18FECA83: 04 FF E9 8F 93 {:02X} FF FF", self.count) } else { DM1_CLEAR.into() }
    }
}

/// Commands that leave the spool in neutral: what they do, in state bits and neutrality; `None` for those to be
/// ignored.
const IN_NEUTRAL: [(&str, Option<(u8, bool)>); 8] = [
    (BLOCK, Some((0, true))),
    ("0CFE3327: 00 FF 31 FF FF FF FF FF", Some((1, true))),
    ("0CFE3327: 00 FF 32 FF FF FF FF FF", Some((2, true))),
    ("0CFE3327: 02 FF 32 FF FF FF FF FF", Some((2, false))),
    (HAND, Some((10, false))),
    (STOP, Some((14, false))),
    ("0CFE3327: FF FF 31 FF FF FF FF FF", None),
    ("0CFE3427: 00 FF 30 FF FF FF FF FF", None),
];

/// What one of 16 senders does, and what the valve should have of it.
#[derive(Clone, Copy, Debug)]
enum Train {
    Announce,
    AnnounceOther,
    /// A packet: its number, and whether its part of the NAME is the valve's.
    Packet(u8, bool),
    Pause(u64),
}

/// A receiver of commanded addresses, told again: for each sender its next packet, whether the NAME fits so far, and
/// when it was heard.
#[derive(Default)]
struct Receiver {
    now: u64,
    senders: BTreeMap<u8, (u8, bool, u64)>,
}

impl Receiver {
    /// Whether the address of this sender has been commanded with it.
    fn take(&mut self, source: u8, train: Train) -> bool {
        match train {
            Train::Pause(ms) => self.now += ms,
            Train::Announce => _ = self.senders.insert(source, (1, true, self.now)),
            Train::AnnounceOther => _ = self.senders.remove(&source),
            Train::Packet(number, fits) => {
                let Some((next, so_far, heard)) = self.senders.remove(&source) else { return false };
                if number == next && self.now - heard <= 750 {
                    if number == 2 {
                        return so_far && fits;
                    }
                    self.senders.insert(source, (2, so_far && fits, self.now));
                }
            }
        }
        false
    }
}

fn train() -> impl Strategy<Value = Train> {
    prop_oneof![
        6 => Just(Train::Announce),
        1 => Just(Train::AnnounceOther),
        6 => (1..=2_u8, prop::bool::weighted(0.9)).prop_map(|(number, fits)| Train::Packet(number, fits)),
        1 => (0..=3_u8).prop_map(|number| Train::Packet(number, true)),
        1 => select(&[0, 100, 249, 250, 400, 750, 751][..]).prop_map(Train::Pause),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_that_happens_brings_it_down(setup in setup(), events in vec(event(), 1..150)) {
        let mut rig = Rig::power_on(setup);
        for event in &events {
            // What is in the mailboxes when the address is lost is the business of another property.
            let lost = rig.node_id().is_none() && rig.pending() == 0;
            act(&mut rig, event);
            let mut sent = 0;
            while let Some(frame) = rig.take_next() {
                check_frame(&frame);
                let restarted = rig.node_id().is_some();
                prop_assert!(!lost || restarted || frame.to_string() == CANNOT_CLAIM, "{} of a lost valve", frame);
                sent += 1;
            }
            let passed = if let Event::Around(disturbance) = event { disturbance.passes_ms() } else { 0 };
            prop_assert!(sent <= BURST + passed / 30, "{} frames after {:?}", sent, event);
        }
        assert_serves(&mut rig);
    }

    /// Nobody but a commanded address gives a voice back to a valve that has lost its address.
    #[test]
    fn a_lost_valve_is_silent(setup in setup(), events in vec(
        prop_oneof![6 => plain_frame().prop_map(Event::Frame), 1 => Inputs::any().prop_map(Event::Sense), 3 => (0..400_u64).prop_map(|ms| Event::Around(Disturbance::Advance(ms)))],
        1..150,
    )) {
        let mut rig = Rig::claimed_as(setup);
        rig.send(LOWER_NAME);
        for event in &events {
            act(&mut rig, event);
            prop_assert_eq!(rig.node_id(), None);
            prop_assert!(rig.take().iter().all(|frame| frame == CANNOT_CLAIM), "after {:?}", event);
        }
        assert_serves(&mut rig);
    }

    /// Nothing but claims for 250 ms from the claim on the bus, then estimated flow, unless the address is lost.
    #[test]
    fn the_wait_is_kept(setup in setup(), held in 0..600_u64, events in vec((plain_frame(), 0..20_u64), 0..30)) {
        let mut rig = Rig::claimed_as(setup);
        rig.hold_bus(true);
        rig.power_cycle();
        rig.advance(held);
        rig.hold_bus(false);
        rig.expect(CLAIM);
        let mut left = 250;
        for (frame, ms) in events {
            rig.send_frame(frame);
            let ms = ms.min(left - 1);
            rig.advance(ms);
            left -= ms;
            let mut sent = rig.take();
            sent.retain(|frame| frame != CLAIM && frame != CANNOT_CLAIM);
            prop_assert!(sent.is_empty(), "{:?} {} ms before the end", sent, left);
        }
        rig.advance_by(Duration::from_micros(left * 1000 - 1));
        prop_assert!(rig.take().iter().all(|frame| frame == CANNOT_CLAIM));
        rig.advance_by(Duration::from_micros(1));
        let flows = rig.take_under("0CFE1383").len();
        prop_assert_eq!(flows, usize::from(rig.node_id().is_some()));
    }

    /// A storm of claims: each higher NAME is answered, its own is not, the first lower one ends it.
    #[test]
    fn claim_storms(names in vec((name(), 0..300_u64), 1..100)) {
        let mut rig = Rig::claimed();
        let own = 0x2002_FF08_0720_0001_u64;
        for (name, ms) in names {
            rig.send_frame(Frame::full(extended(0x18EE_FF83).into(), name.to_le_bytes()));
            if name < own {
                prop_assert_eq!(rig.node_id(), None);
                rig.advance_sends(153, &[CANNOT_CLAIM]);
                return Ok(());
            }
            let answers = rig.take_news();
            prop_assert_eq!(answers, if name > own { vec![CLAIM] } else { vec![] });
            rig.advance_news(ms, &[]);
        }
        prop_assert_eq!(rig.node_id(), Some(0x83));
    }

    /// Sixteen senders of commanded addresses, each with an address of its own to give, in order and out of it.
    #[test]
    fn sixteen_senders(events in vec((0..16_u8, train()), 1..400)) {
        let mut rig = Rig::claimed();
        let mut model = Receiver::default();
        let mut address = 0x83;
        for (source, train) in events {
            let commanded = model.take(source, train);
            match train {
                Train::Pause(ms) => rig.advance(ms),
                Train::Announce => rig.send(&format!("1CECFF{source:02X}: 20 09 00 02 FF D8 FE 00")),
                Train::AnnounceOther => rig.send(&format!("1CECFF{source:02X}: 20 09 00 02 FF D0 FE 00")),
                Train::Packet(1, fits) => {
                    rig.send(&format!("1CEBFF{source:02X}: 01 {:02X} 00 20 07 08 FF 02", u8::from(fits)));
                }
                Train::Packet(number, fits) => {
                    let last = if fits { 0x20 } else { 0xA0 };
                    rig.send(&format!("1CEBFF{source:02X}: {number:02X} {last:02X} {:02X} FF FF FF FF FF", 0x80 | source));
                }
            }
            if commanded {
                address = 0x80 | source;
                // a restart has heard nothing yet
                model.senders.clear();
                let claim = rig.take().pop();
                prop_assert_eq!(claim, Some(format!("18EEFF{address:02X}: 01 00 20 07 08 FF 02 20")));
            }
            prop_assert_eq!(rig.node_id(), Some(address));
        }
    }

    /// Time guarding and recovery, at every step as the model says.
    #[test]
    fn time_guarding_and_recovery(steps in vec((0..320_u64, select(&IN_NEUTRAL[..])), 1..120)) {
        let mut rig = Rig::claimed();
        let mut model = Guarded::default();
        for (ms, (command, meaning)) in steps {
            rig.advance(ms);
            model.pass(ms);
            rig.take();
            prop_assert_eq!(rig.flow()[2], model.state(), "before {}", command);
            rig.exchange("18EA8327: CA FE 00", &[&model.dm1()]);
            rig.send(command);
            if let Some((state, neutral)) = meaning {
                model.command(state, neutral);
            }
            rig.take();
            prop_assert_eq!(rig.flow()[2], model.state(), "after {}", command);
            rig.exchange("18EA8327: CA FE 00", &[&model.dm1()]);
        }
    }

    /// Of the causes that are there, after their delays, the most important shows, with its own count.
    #[test]
    fn the_most_important_fault_shows(steps in vec((0..4_usize, any::<bool>()), 1..60)) {
        let mut rig = Rig::claimed();
        // internal error, temperature, supply too high, supply too low
        let codes = ["10 FF FA 8F 8B", "04 FF F1 8F 90", "04 FF 73 02 03", "04 FF 73 02 04"];
        let (mut active, mut counts) = ([false; 4], [0_u8; 4]);
        for (which, there) in steps {
            match which {
                0 => rig.sense(|inputs| inputs.internal_fault = there),
                1 => rig.sense(|inputs| inputs.temperature_c = if there { 121 } else { 25 }),
                2 => rig.sense(|inputs| inputs.supply_mv = if there { 36_001 } else { 24_000 }),
                _ => rig.sense(|inputs| inputs.supply_mv = if there { 8_999 } else { 24_000 }),
            }
            if which >= 2 {
                // one supply
                active[5 - which] = false;
            }
            counts[which] += u8::from(there && !active[which]);
            active[which] = there;
            rig.advance(2000);
            rig.take();
            let dm1 = match active.iter().position(|active| *active) {
                Some(shown) => format!("18FECA83: {} {:02X} FF FF", codes[shown], counts[shown]),
                None => DM1_CLEAR.into(),
            };
            rig.exchange("18EA8327: CA FE 00", &[&dm1]);
        }
    }
}
