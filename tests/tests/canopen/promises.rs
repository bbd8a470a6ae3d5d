//! Whatever happens on a bus that blocks and frees: the last word is true, what goes out is true then, and every
//! request is answered or counted (SPEC 4.2, 4.4).

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::time::Duration;
use tests::lss;
use tests::{Rig, unanswered};

use super::{CLEARED, SAVE};

/// What can happen to a valve and its bus.
#[derive(Clone, Copy, Debug)]
enum Event {
    Advance(u64),
    HoldBus(bool),
    BusOff(bool),
    Internal(bool),
    /// The internal fault comes and goes so many times.
    Toggle(usize),
    Temperature(bool),
    SupplyLow(bool),
    /// "Start" or "pre-operational".
    Operational(bool),
    /// Of the communication or of the application.
    Reset(&'static str),
    Stop,
    Rpdo(u8),
    WriteTime(u64),
    WritesFail(bool),
    Save,
}

fn time() -> impl Strategy<Value = Event> {
    prop_oneof![3 => 1..=60_u64, 2 => 60..=600_u64, 1 => 600..=4000_u64].prop_map(Event::Advance)
}

fn faults() -> impl Strategy<Value = Event> {
    prop_oneof![
        4 => any::<bool>().prop_map(Event::Internal),
        1 => (1..30_usize).prop_map(Event::Toggle),
        2 => any::<bool>().prop_map(Event::Temperature),
        1 => any::<bool>().prop_map(Event::SupplyLow),
    ]
}

fn rpdo() -> impl Strategy<Value = Event> {
    select(&[0x00, 0x01, 0x03, 0x0B, 0x0F][..]).prop_map(Event::Rpdo)
}

fn act(valve: &mut Rig, event: Event) {
    match event {
        Event::Advance(ms) => valve.advance(ms),
        Event::HoldBus(held) => valve.hold_bus(held),
        Event::BusOff(off) => {
            valve.sense(|inputs| inputs.bus = if off { BusErrorMode::BusOff } else { BusErrorMode::ErrorActive })
        }
        Event::Internal(there) => valve.sense(|inputs| inputs.internal_fault = there),
        Event::Toggle(times) => {
            for there in [true, false].into_iter().cycle().take(2 * times) {
                valve.sense(|inputs| inputs.internal_fault = there);
            }
        }
        Event::Temperature(there) => valve.sense(|inputs| inputs.temperature_c = if there { 130 } else { 25 }),
        Event::SupplyLow(there) => valve.sense(|inputs| inputs.supply_mv = if there { 8_000 } else { 24_000 }),
        Event::Operational(true) => valve.send("000: 01 20"),
        Event::Operational(false) => valve.send("000: 80 20"),
        Event::Reset(order) => valve.send(&format!("000: {order} 20")),
        Event::Stop => valve.send("000: 02 20"),
        Event::Rpdo(word) => valve.send(&format!("220: {word:02X} 00 00 00")),
        Event::WriteTime(ms) => valve.write_time = Duration::from_millis(ms),
        Event::WritesFail(fail) => valve.writes_fail = fail,
        Event::Save => valve.send(SAVE),
    }
}

/// Frees the bus for one second.
fn free_the_bus(valve: &mut Rig) {
    act(valve, Event::BusOff(false));
    valve.hold_bus(false);
    valve.advance(1000);
}

/// A request, and its answer.
const REQUESTS: [(&str, &str); 5] = [
    ("620: 40 00 10 00 00 00 00 00", "5A0: 43 00 10 00 98 01 00 00"),
    ("620: 40 99 99 00 00 00 00 00", "5A0: 80 99 99 00 00 00 02 06"),
    (lss::INQUIRE_NODE_ID, "7E4: 5E 20 00 00 00 00 00 00"),
    ("1BC78820: 03 22 F0 10", "1BC100F1: 04 62 F0 10 A5"),
    ("1BC79020: 02 10 03", "1BC100F2: 03 7F 10 11"),
];

#[derive(Clone, Copy, Debug)]
enum Asked {
    Request(usize),
    Other(Event),
}

/// How the NMT state is told by a heartbeat.
const fn heartbeat(operational: bool) -> &'static str {
    if operational { "720: 05" } else { "720: 7F" }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// One second after the bus is free the last EMCY tells whether there is an error.
    #[test]
    fn the_last_emcy_is_true(
        events in vec(
            prop_oneof![
                6 => time(),
                10 => faults(),
                2 => any::<bool>().prop_map(Event::HoldBus),
                1 => any::<bool>().prop_map(Event::BusOff),
                1 => any::<bool>().prop_map(Event::Operational),
                1 => select(&["81", "82"][..]).prop_map(Event::Reset),
                2 => rpdo(),
                1 => (0..=100_u64).prop_map(Event::WriteTime),
                1 => any::<bool>().prop_map(Event::WritesFail),
                1 => Just(Event::Save),
            ],
            0..100,
        ),
        block in prop_oneof![Just(Event::HoldBus(true)), Just(Event::BusOff(true))],
        blocked in vec(prop_oneof![1 => time(), 4 => faults()], 0..40),
    ) {
        let mut valve = Rig::booted();
        let mut last = CLEARED.to_owned();
        for event in events.into_iter().chain([block]).chain(blocked) {
            act(&mut valve, event);
            last = valve.take_under("0A0").pop().unwrap_or(last);
        }
        free_the_bus(&mut valve);
        last = valve.take_under("0A0").pop().unwrap_or(last);
        let register = valve.read(0x1001, 0);
        prop_assert_eq!(register == 0, last == CLEARED, "register {:02X}, last {}", register, last);
    }

    /// What goes out on a bus that blocks and frees is true when it goes out; PDOs only in operational. A TPDO tells
    /// the state after the last RPDO, which time and faults may have changed since.
    #[test]
    fn what_goes_out_is_true_then(events in vec(
        prop_oneof![
            6 => (1..=300_u64).prop_map(Event::Advance),
            3 => any::<bool>().prop_map(Event::HoldBus),
            3 => any::<bool>().prop_map(Event::Operational),
            6 => rpdo(),
            1 => any::<bool>().prop_map(Event::Internal),
        ],
        1..100,
    )) {
        let mut valve = Rig::booted();
        prop_assert_eq!(valve.write(0x1017, 0, 2, 50), Ok(()));
        valve.take();
        let mut operational = false;
        let mut just_commanded = false;
        for event in events {
            just_commanded = match event {
                Event::Rpdo(_) => true,
                Event::Advance(_) | Event::Internal(_) => false,
                _ => just_commanded,
            };
            if let Event::Operational(to) = event {
                operational = to;
            }
            act(&mut valve, event);
            let sent = valve.take();
            for frame in &sent {
                let is_heartbeat = frame.starts_with("720");
                prop_assert!(!is_heartbeat || frame == heartbeat(operational), "{} after {:?}", frame, event);
            }
            let pdos: Vec<_> = sent.iter().filter(|frame| frame.starts_with("1A0")).collect();
            prop_assert!(pdos.is_empty() || operational, "{:?} after {:?}", pdos, event);
            if let (Some(last), Event::HoldBus(false), true) = (pdos.last(), event, just_commanded) {
                let status = format!("1A0: {:02X} 00 00 00", valve.status());
                prop_assert_eq!(&pdos, &[&status], "the last of them is {}", last);
                valve.take();
            }
        }
    }

    /// However long the bus is blocked, each request is answered or counted as dropped.
    #[test]
    fn each_request_is_answered_or_counted(events in vec(
        prop_oneof![
            12 => (0..REQUESTS.len()).prop_map(Asked::Request),
            2 => any::<bool>().prop_map(|held| Asked::Other(Event::HoldBus(held))),
            2 => (1..=300_u64).prop_map(|ms| Asked::Other(Event::Advance(ms))),
            2 => faults().prop_map(Asked::Other),
        ],
        1..150,
    )) {
        let mut valve = Rig::booted();
        valve.exchange(lss::TO_CONFIGURATION, &[]);
        assert_eq!(valve.write(0x1017, 0, 2, 100), Ok(()));
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
        sent.extend(valve.take());
        let missing = unanswered(&REQUESTS, &asked, &sent);
        let dropped = usize::try_from(valve.device().frames_dropped()).unwrap();
        prop_assert!(missing <= dropped, "{} answers are missing, {} frames dropped", missing, dropped);
    }

    /// The node's services survive each other: after all of it the valve is where the last order has put it.
    #[test]
    fn resets_and_stops_on_a_blocked_bus(events in vec(
        prop_oneof![
            4 => time(),
            3 => faults(),
            3 => any::<bool>().prop_map(Event::HoldBus),
            1 => any::<bool>().prop_map(Event::BusOff),
            2 => any::<bool>().prop_map(Event::Operational),
            2 => select(&["81", "82"][..]).prop_map(Event::Reset),
            2 => Just(Event::Stop),
            2 => rpdo(),
            1 => Just(Event::Save),
            1 => (0..=100_u64).prop_map(Event::WriteTime),
        ],
        1..100,
    )) {
        let mut valve = Rig::booted();
        for event in events {
            act(&mut valve, event);
            valve.take();
        }
        free_the_bus(&mut valve);
        valve.take();
        // No answer of the blocked time is left: the first frame is the answer to this request, or the boot-up.
        valve.send("000: 80 20");
        valve.exchange(REQUESTS[0].0, &[REQUESTS[0].1]);
        valve.send("000: 81 20");
        valve.advance(1000);
        prop_assert_eq!(&valve.take()[..2], &["720: 00", CLEARED]);
    }
}
