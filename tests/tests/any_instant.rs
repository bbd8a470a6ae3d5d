//! No instant hangs a device or brings it down: a platform's clock can start anywhere, jump, run back, and end.

use std::convert::Infallible;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::{BusErrorMode, Controller, Filter, Filters};
use protocol_core::device::{AnyDevice, Device, Effect, Inputs, Kind, ProductInputs, Protocol, StartCause};
use protocol_core::frame::Frame;
use protocol_core::memory::Image;
use protocol_core::pump::pump;
use protocol_core::time::{Duration, Instant, after};

/// The most frames and effects that one event leads to.
const STEPS: u32 = 100;

/// The first instant that no clock comes to.
const END: u64 = 1 << 63;

/// A controller on a free bus, which takes every frame at once. The device takes so many steps until it is content.
#[derive(Default)]
struct FreeBus {
    received: Option<Frame>,
    sent: Vec<Frame>,
    steps: u32,
}

impl FreeBus {
    fn step(&mut self) {
        self.steps += 1;
        assert!(self.steps <= STEPS, "it does not come to rest; it sent {:?}", self.sent);
    }
}

impl embedded_can::nb::Can for FreeBus {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        self.step();
        self.sent.push(*frame);
        Ok(None)
    }

    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        self.received.take().ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for FreeBus {
    fn holds(&self, _: Filter) -> bool {
        false
    }

    fn abort(&mut self, _: Filter) {
        self.step();
    }

    fn set_filters(&mut self, _: &Filters) {
        self.step();
    }
}

/// What happens at an instant.
#[derive(Clone, Copy, Debug)]
enum Event {
    Poll,
    /// One of the frames for the kind.
    Frame(usize),
    /// The inputs of a healthy device, with this supply and state of the bus.
    Sense(u32, BusErrorMode),
    Flush,
}

/// Frames that start timers: heartbeat, TPDO, a transfer in segments, set-points, the delays of LSS, claims, diagnostics.
fn frames(kind: Kind) -> Vec<Frame> {
    let id = kind.default_node_id();
    let texts = match kind.protocol() {
        Protocol::Canopen => vec![
            "000: 01 00".to_owned(),
            "000: 81 00".to_owned(),
            format!("{:03X}: 2B 17 10 00 0A 00 00 00", 0x600 + u16::from(id)),
            format!("{:03X}: 2B 00 18 05 0A 00 00 00", 0x600 + u16::from(id)),
            format!("{:03X}: 2B 00 18 03 05 00 00 00", 0x600 + u16::from(id)),
            format!("{:03X}: 40 08 10 00 00 00 00 00", 0x600 + u16::from(id)),
            format!("{:03X}: 23 10 10 01 73 61 76 65", 0x600 + u16::from(id)),
            format!("{:03X}: 0F 00 00 40", 0x200 + u16::from(id)),
            "080:".to_owned(),
            "7E5: 04 01 00 00 00 00 00 00".to_owned(),
            "7E5: 13 00 02 00 00 00 00 00".to_owned(),
            "7E5: 15 0A 00 00 00 00 00 00".to_owned(),
            "7E5: 17 00 00 00 00 00 00 00".to_owned(),
            "7E5: 04 00 00 00 00 00 00 00".to_owned(),
        ],
        Protocol::Isobus => vec![
            format!("0CFE3{:X}26: 40 FF 31 FF FF FF FF FF", id & 0xF),
            "18EAFF26: 00 EE 00".to_owned(),
            format!("18EA{id:02X}26: CA FE 00"),
            format!("18EA{id:02X}26: CB FE 00"),
            format!("18EA{id:02X}26: CC FE 00"),
            format!("18EEFF{id:02X}: 00 00 00 00 00 00 00 00"),
            format!("18EEFF{id:02X}: FF FF FF FF FF FF FF FF"),
        ],
    };
    texts.iter().map(|text| tests::frame(text)).collect()
}

/// What the platform's clock does.
#[derive(Clone, Copy, Debug)]
enum Time {
    /// So many microseconds after the last instant.
    Later(u64),
    /// It stands at so many microseconds.
    At(u64),
}

/// Goes on as a clock does, seldom to anywhere, and to the ends of the count.
fn time() -> impl Strategy<Value = Time> {
    prop_oneof![
        8 => (0..20_000_000_u64).prop_map(Time::Later),
        1 => any::<u64>().prop_map(Time::Later),
        2 => any::<u64>().prop_map(Time::At),
        2 => (0..20_000_000_u64).prop_map(|before| Time::At(u64::MAX - before)),
        1 => (0..20_000_000_u64).prop_map(|before| Time::At(END - 10_000_000 + before)),
        1 => select(&[0, END - 1, END, u64::MAX][..]).prop_map(Time::At),
    ]
}

fn event() -> impl Strategy<Value = Event> {
    let bus = select(&[BusErrorMode::ErrorActive, BusErrorMode::ErrorActive, BusErrorMode::BusOff][..]);
    prop_oneof![
        4 => Just(Event::Poll),
        6 => any::<usize>().prop_map(Event::Frame),
        2 => (select(&[24_000, 8_000][..]), bus).prop_map(|(supply, bus)| Event::Sense(supply, bus)),
        1 => Just(Event::Flush),
    ]
}

/// Pumps until there is nothing left to do at this instant.
fn pump_all(device: &mut dyn Device, bus: &mut FreeBus, now: Instant) {
    loop {
        bus.step();
        match pump(device, bus, now) {
            None => return,
            Some(Effect::Store(key, _)) => device.stored(key, Ok(()), now),
            Some(Effect::SetBitRate(_)) => {}
            Some(Effect::Restart(scope)) => device.restart(scope, &Image::empty(), now),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_device_comes_to_rest_at_any_instant(
        kind in select(&Kind::ALL[..]),
        start in time(),
        events in vec((time(), event()), 1..100),
    ) {
        let at = |time, last| match time {
            Time::Later(by) => after(last, Duration::from_ticks(by)),
            Time::At(ticks) => Instant::from_ticks(ticks),
        };
        let (mut can, frames) = (FreeBus::default(), frames(kind));
        let mut now = at(start, Instant::MIN);
        let mut device = AnyDevice::power_on(kind.into(), &Image::empty(), StartCause::PowerOn, now);
        let device = device.as_dyn_mut();
        pump_all(device, &mut can, now);
        for (time, event) in events {
            now = at(time, now);
            can = FreeBus::default();
            match event {
                Event::Poll => {}
                Event::Frame(which) => can.received = frames.get(which % frames.len()).copied(),
                Event::Sense(supply_mv, bus) => {
                    let mut inputs = Inputs { bus, ..Inputs::healthy(kind) };
                    if let ProductInputs::Valve(valve) = &mut inputs.product {
                        valve.supply_mv = supply_mv;
                    }
                    device.sense(&inputs, now);
                }
                Event::Flush => device.flush(now),
            }
            pump_all(device, &mut can, now);
            prop_assert!(now.as_ticks() >= END || device.deadline() > now, "what was due by {now:?} is due still");
        }
    }
}
