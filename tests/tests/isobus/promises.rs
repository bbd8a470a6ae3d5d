//! Whatever happens on a bus that blocks and frees: the last DM1 is true, a BAM is whole or given up, every request is
//! answered or counted, and nothing leaves under an address that was lost (SPEC 5).

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, since};
use tests::isobus::{BLOCK, CANNOT_CLAIM, CLAIM, DM1_REQUEST, EXTEND, HIGHER_NAME, LOWER_NAME};
use tests::{Rig, unanswered};

/// The longest distance of two packets.
const GAP_MAX: Duration = Duration::from_millis(200);
/// The shortest.
const GAP_MIN: Duration = Duration::from_millis(50);

/// What can happen to a valve and its bus.
#[derive(Clone, Copy, Debug)]
enum Event {
    Advance(u64),
    /// The same with a command every 100 ms.
    Commanded(u64, &'static str),
    HoldBus(bool),
    BusOff(bool),
    Internal(bool),
    Temperature(bool),
    SupplyLow(bool),
    /// The internal fault comes and goes so many times.
    Toggle(usize),
    Send(&'static str),
    /// The same frame so many times.
    Burst(usize, &'static str),
    WriteTime(u64),
    WritesFail(bool),
}

fn time() -> impl Strategy<Value = Event> {
    prop_oneof![
        3 => (1..=120_u64).prop_map(Event::Advance),
        1 => (120..=2000_u64).prop_map(Event::Advance),
        3 => (100..=3000_u64, select(&[BLOCK, EXTEND][..])).prop_map(|(ms, command)| Event::Commanded(ms, command)),
    ]
}

fn faults() -> impl Strategy<Value = Event> {
    prop_oneof![
        4 => any::<bool>().prop_map(Event::Internal),
        2 => any::<bool>().prop_map(Event::Temperature),
        1 => any::<bool>().prop_map(Event::SupplyLow),
        1 => (1..30_usize).prop_map(Event::Toggle),
    ]
}

/// Requests for all that the valve sends, and one that it refuses.
fn request() -> impl Strategy<Value = Event> {
    let requests = [
        DM1_REQUEST,
        "18EAFF27: CB FE 00",
        "18EA8327: CC FE 00",
        "18EAFF27: 00 EE 00",
        "18EA8327: 13 FE 00",
        "18EA8327: 00 FF 00",
        "1BC78883: 03 22 F0 10",
        HIGHER_NAME,
    ];
    let requests = select(requests.to_vec());
    prop_oneof![
        6 => requests.clone().prop_map(Event::Send),
        1 => (1..60_usize, requests).prop_map(|(times, request)| Event::Burst(times, request)),
    ]
}

fn blocks() -> impl Strategy<Value = Event> {
    prop_oneof![4 => any::<bool>().prop_map(Event::HoldBus), 1 => any::<bool>().prop_map(Event::BusOff)]
}

fn memory() -> impl Strategy<Value = Event> {
    prop_oneof![(0..=100_u64).prop_map(Event::WriteTime), any::<bool>().prop_map(Event::WritesFail)]
}

fn act(valve: &mut Rig, event: Event) {
    match event {
        Event::Advance(ms) => valve.advance(ms),
        Event::Commanded(ms, command) => valve.advance_cyclic(ms, command),
        Event::HoldBus(held) => valve.hold_bus(held),
        Event::BusOff(off) => {
            valve.sense(|inputs| inputs.bus = if off { BusErrorMode::BusOff } else { BusErrorMode::ErrorActive });
        }
        Event::Internal(there) => valve.sense(|inputs| inputs.internal_fault = there),
        Event::Temperature(there) => valve.sense(|inputs| inputs.temperature_c = if there { 130 } else { 25 }),
        Event::SupplyLow(there) => valve.sense(|inputs| inputs.supply_mv = if there { 8_000 } else { 24_000 }),
        Event::Toggle(times) => {
            for there in [true, false].into_iter().cycle().take(2 * times) {
                valve.sense(|inputs| inputs.internal_fault = there);
            }
        }
        Event::Send(text) => valve.send(text),
        Event::Burst(times, text) => (0..times).for_each(|_| valve.send(text)),
        Event::WriteTime(ms) => valve.write_time = Duration::from_millis(ms),
        Event::WritesFail(fail) => valve.writes_fail = fail,
    }
}

/// Frees the bus for one second, with commands.
fn free_the_bus(valve: &mut Rig) {
    act(valve, Event::BusOff(false));
    valve.hold_bus(false);
    valve.advance_cyclic(1000, BLOCK);
}

/// A receiver of broadcasts in packets.
#[derive(Default)]
struct Receiver {
    /// The number of packets announced, the packets heard, and the instant of the last frame.
    running: Option<(u8, u8, Instant)>,
    whole: usize,
}

impl Receiver {
    /// A frame of the valve: each packet follows the one before it, in time.
    fn hear(&mut self, at: Instant, frame: &Frame) -> Result<(), TestCaseError> {
        let text = frame.to_string();
        let data = frame.data();
        if text.starts_with("1CECFF") {
            prop_assert_eq!(data[0], 0x20, "{}", text);
            self.running = Some((data[3], 0, at));
        } else if text.starts_with("1CEBFF") {
            let (announced, heard, last) = self.running.take().ok_or_else(|| TestCaseError::fail(text.clone()))?;
            prop_assert_eq!(data[0], heard + 1, "{} after {} packets", text, heard);
            let gap = since(at, last);
            prop_assert!(gap >= GAP_MIN && gap <= GAP_MAX, "{} after {} us", text, gap.as_micros());
            self.running = (data[0] < announced).then_some((announced, data[0], at));
            self.whole += usize::from(data[0] == announced);
        }
        Ok(())
    }
}

/// Requests that are answered one by one, and their answers.
const REQUESTS: [(&str, &str); 5] = [
    ("18EA8327: 00 FF 00", "18E8FF83: 01 FF FF FF 27 00 FF 00"),
    ("18EA8328: D8 FE 00", "18E8FF83: 01 FF FF FF 28 D8 FE 00"),
    ("18EA8327: CC FE 00", "18E8FF83: 00 FF FF FF 27 CC FE 00"),
    ("1BC78883: 03 22 F0 10", "1BC418F1: 04 62 F0 10 A5"),
    ("1BC79083: 02 10 03", "1BC418F2: 03 7F 10 11"),
];

#[derive(Clone, Copy, Debug)]
enum Asked {
    Request(usize),
    Other(Event),
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// One second after the bus is free the last DM1 tells the present state.
    #[test]
    fn the_last_dm1_is_true(
        events in vec(prop_oneof![6 => time(), 8 => faults(), 2 => request(), 3 => blocks(), 1 => memory()], 0..80),
        blocked in vec(prop_oneof![2 => time(), 8 => faults(), 1 => request()], 0..40),
    ) {
        let mut valve = Rig::claimed();
        let mut last = None;
        for event in events.into_iter().chain([Event::HoldBus(true)]).chain(blocked) {
            act(&mut valve, event);
            last = valve.take_under("18FECA83").pop().or(last);
        }
        free_the_bus(&mut valve);
        last = valve.take_under("18FECA83").pop().or(last);
        valve.send(DM1_REQUEST);
        let present = valve.take_under("18FECA83").pop();
        prop_assert!(last.is_none() || last == present, "{:?}, in truth {:?}", last, present);
        let is_clear = present.is_some_and(|dm1| dm1.contains(": 00 FF 00 00 00"));
        prop_assert!(last.is_some() || is_clear, "nothing was told");
    }

    /// Every BAM is whole or given up: no packet without the one before it, none out of time.
    #[test]
    fn every_bam_is_whole_or_given_up(events in vec(
        prop_oneof![
            8 => time(),
            4 => Just(Event::Send("18EAFF27: CB FE 00")),
            4 => request(),
            4 => blocks(),
            1 => faults(),
            1 => memory(),
        ],
        1..120,
    )) {
        let mut valve = Rig::with_two_previously_active();
        let mut receiver = Receiver::default();
        for event in events {
            act(&mut valve, event);
            for (at, frame) in valve.take_timed() {
                receiver.hear(at, &frame)?;
            }
        }
        free_the_bus(&mut valve);
        for (at, frame) in valve.take_timed() {
            receiver.hear(at, &frame)?;
        }
    }

    /// However long the bus is blocked, each request is answered or counted as dropped; a claim that was asked for is
    /// sent.
    #[test]
    fn each_request_is_answered_or_counted(events in vec(
        prop_oneof![
            12 => (0..REQUESTS.len()).prop_map(Asked::Request),
            2 => Just(Asked::Other(Event::Burst(30, "18EAFF27: 00 EE 00"))),
            2 => any::<bool>().prop_map(|held| Asked::Other(Event::HoldBus(held))),
            4 => time().prop_map(Asked::Other),
            2 => faults().prop_map(Asked::Other),
            1 => (0..=100_u64).prop_map(|ms| Asked::Other(Event::WriteTime(ms))),
        ],
        1..150,
    )) {
        let mut valve = Rig::claimed();
        let mut asked = [0_usize; REQUESTS.len()];
        let mut sent = Vec::new();
        for event in events {
            match event {
                Asked::Request(number) => {
                    asked[number] += 1;
                    valve.send(REQUESTS[number].0);
                }
                Asked::Other(event) => act(&mut valve, event),
            }
            sent.extend(valve.take());
        }
        free_the_bus(&mut valve);
        valve.advance(1000);
        sent.extend(valve.take());
        let missing = unanswered(&REQUESTS, &asked, &sent);
        let dropped = usize::try_from(valve.device().frames_dropped()).unwrap();
        prop_assert!(missing <= dropped, "{} answers are missing, {} frames dropped", missing, dropped);
        valve.exchange("18EAFF27: 00 EE 00", &[CLAIM]);
    }

    /// From the loss of the address on nothing leaves but the cannot-claim, whatever waited where.
    #[test]
    fn nothing_leaves_under_a_lost_address(
        before in vec(prop_oneof![4 => time(), 3 => faults(), 8 => request(), 4 => blocks(), 1 => memory()], 0..60),
        after in vec(prop_oneof![4 => time(), 3 => faults(), 8 => request(), 4 => blocks(), 1 => memory()], 0..60),
        starting in any::<bool>(),
    ) {
        let mut valve = Rig::with_two_previously_active();
        if starting {
            valve.hold_bus(true);
            valve.power_cycle();
        }
        for event in before {
            act(&mut valve, event);
        }
        valve.take();
        valve.send(LOWER_NAME);
        prop_assert_eq!(valve.node_id(), None);
        for event in after {
            act(&mut valve, event);
            let sent = valve.take();
            prop_assert!(sent.iter().all(|frame| frame == CANNOT_CLAIM), "{:?} after {:?}", sent, event);
        }
        free_the_bus(&mut valve);
        let sent = valve.take();
        prop_assert!(sent.iter().all(|frame| frame == CANNOT_CLAIM), "{:?} after the bus was freed", sent);
        // Asked for, it says once more that it cannot claim.
        valve.send("18EAFF27: 00 EE 00");
        valve.advance(153);
        valve.expect(CANNOT_CLAIM);
    }
}
