//! Whatever happens on a bus that blocks and frees: the last word is true, what goes out is true then, and every
//! request is answered or counted (SPEC 4.2, 4.4).

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use tests::hostile::{Asked, Disturbance, answered_or_counted};
use tests::{Rig, lss};

use super::{CLEARED, SAVE};

fn time() -> impl Strategy<Value = Disturbance> {
    prop_oneof![3 => 1..=60_u64, 2 => 60..=600_u64, 1 => 600..=4000_u64].prop_map(Disturbance::Advance)
}

fn rpdo() -> impl Strategy<Value = Disturbance> {
    let words = ["220: 00 00 00 00", "220: 01 00 00 00", "220: 03 00 00 00", "220: 0B 00 00 00", "220: 0F 00 00 00"];
    select(words.to_vec()).prop_map(Disturbance::Send)
}

const START: &str = "000: 01 20";
const ENTER_PRE_OPERATIONAL: &str = "000: 80 20";

fn orders(orders: &'static [&'static str]) -> impl Strategy<Value = Disturbance> {
    select(orders).prop_map(Disturbance::Send)
}

fn hold_bus() -> impl Strategy<Value = Disturbance> {
    any::<bool>().prop_map(Disturbance::HoldBus)
}

fn write_time() -> impl Strategy<Value = Disturbance> {
    (0..=100_u64).prop_map(Disturbance::WriteTime)
}

/// Frees the bus for one second.
fn free_the_bus(valve: &mut Rig) {
    Disturbance::Bus(BusErrorMode::ErrorActive).act(valve);
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
                10 => Disturbance::faults(),
                2 => hold_bus(),
                1 => Disturbance::bus_off(),
                1 => orders(&[START, ENTER_PRE_OPERATIONAL]),
                1 => orders(&["000: 81 20", "000: 82 20"]),
                2 => rpdo(),
                1 => write_time(),
                1 => any::<bool>().prop_map(Disturbance::WritesFail),
                1 => Just(Disturbance::Send(SAVE)),
            ],
            0..100,
        ),
        block in prop_oneof![Just(Disturbance::HoldBus(true)), Just(Disturbance::Bus(BusErrorMode::BusOff))],
        blocked in vec(prop_oneof![1 => time(), 4 => Disturbance::faults()], 0..40),
    ) {
        let mut valve = Rig::booted();
        let mut last = CLEARED.to_owned();
        for event in events.into_iter().chain([block]).chain(blocked) {
            event.act(&mut valve);
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
            6 => (1..=300_u64).prop_map(Disturbance::Advance),
            3 => hold_bus(),
            3 => orders(&[START, ENTER_PRE_OPERATIONAL]),
            6 => rpdo(),
            1 => any::<bool>().prop_map(Disturbance::Internal),
        ],
        1..100,
    )) {
        let mut valve = Rig::booted();
        prop_assert_eq!(valve.write(0x1017, 0, 2, 50), Ok(()));
        valve.take();
        let mut operational = false;
        let mut just_commanded = false;
        for event in events {
            match &event {
                Disturbance::Send(START) => operational = true,
                Disturbance::Send(ENTER_PRE_OPERATIONAL) => operational = false,
                Disturbance::Send(_) => just_commanded = true,
                Disturbance::Advance(_) | Disturbance::Internal(_) => just_commanded = false,
                _ => {}
            }
            event.act(&mut valve);
            let sent = valve.take();
            for frame in &sent {
                let is_heartbeat = frame.starts_with("720");
                prop_assert!(!is_heartbeat || frame == heartbeat(operational), "{} after {:?}", frame, event);
            }
            let pdos: Vec<_> = sent.iter().filter(|frame| frame.starts_with("1A0")).collect();
            prop_assert!(pdos.is_empty() || operational, "{:?} after {:?}", pdos, event);
            if let (Some(last), Disturbance::HoldBus(false), true) = (pdos.last(), &event, just_commanded) {
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
            2 => hold_bus().prop_map(Asked::Other),
            2 => (1..=300_u64).prop_map(|ms| Asked::Other(Disturbance::Advance(ms))),
            2 => Disturbance::faults().prop_map(Asked::Other),
        ],
        1..150,
    )) {
        let mut valve = Rig::booted();
        valve.exchange(lss::TO_CONFIGURATION, &[]);
        assert_eq!(valve.write(0x1017, 0, 2, 100), Ok(()));
        answered_or_counted(&mut valve, &REQUESTS, &events, free_the_bus);
    }

    /// The node's services survive each other: after all of it the valve is where the last order has put it.
    #[test]
    fn resets_and_stops_on_a_blocked_bus(events in vec(
        prop_oneof![
            4 => time(),
            3 => Disturbance::faults(),
            3 => hold_bus(),
            1 => Disturbance::bus_off(),
            4 => orders(&[START, ENTER_PRE_OPERATIONAL, "000: 81 20", "000: 82 20"]),
            2 => Just(Disturbance::Send("000: 02 20")),
            2 => rpdo(),
            1 => Just(Disturbance::Send(SAVE)),
            1 => write_time(),
        ],
        1..100,
    )) {
        let mut valve = Rig::booted();
        for event in events {
            event.act(&mut valve);
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
