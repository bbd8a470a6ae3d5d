//! The silence of LSS "activate bit timing" against everything else: nothing goes out in it, whatever falls due, is
//! stored, reset or asked for meanwhile; and after it the valve is there again (SPEC 4.4).

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::time::{Duration, Instant, after};
use tests::lss;
use tests::{Rig, unanswered};

use super::{CLEAR, SAVE, SAVED};

/// The delay of the activation, in ms, which runs twice.
const DELAY_MS: u64 = 50;

/// A request, and its answer.
const REQUESTS: [(&str, &str); 4] = [
    ("620: 40 00 10 00 00 00 00 00", "5A0: 43 00 10 00 98 01 00 00"),
    (SAVE, SAVED),
    (lss::INQUIRE_NODE_ID, "7E4: 5E 20 00 00 00 00 00 00"),
    ("1BC78820: 03 22 F0 10", "1BC100F1: 04 62 F0 10 A5"),
];

#[derive(Clone, Copy, Debug)]
enum Event {
    Advance(u64),
    Request(usize),
    Other(&'static str),
    Activate,
    HoldBus(bool),
    BusOff(bool),
    Internal(bool),
}

fn event() -> impl Strategy<Value = Event> {
    let others = [
        "000: 80 20",
        "000: 81 20",
        "000: 82 20",
        "000: 02 20",
        "000: 01 20",
        "220: 0F 00 00 00",
        lss::TO_CONFIGURATION,
        "7E5: 13 00 02 00 00 00 00 00",
        lss::STORE,
        CLEAR,
        "620: 2B 17 10 00 14 00 00 00",
    ];
    prop_oneof![
        6 => (0..=30_u64).prop_map(Event::Advance),
        4 => (0..REQUESTS.len()).prop_map(Event::Request),
        6 => select(others.to_vec()).prop_map(Event::Other),
        2 => Just(Event::Activate),
        2 => any::<bool>().prop_map(Event::HoldBus),
        1 => any::<bool>().prop_map(Event::BusOff),
        2 => any::<bool>().prop_map(Event::Internal),
    ]
}

fn act(valve: &mut Rig, event: Event) {
    match event {
        Event::Advance(ms) => valve.advance(ms),
        Event::Request(number) => valve.send(REQUESTS[number].0),
        Event::Other(frame) => valve.send(frame),
        Event::Activate => {
            valve.send_all(&[lss::TO_CONFIGURATION, &format!("7E5: 15 {DELAY_MS:02X} 00 00 00 00 00 00")]);
        }
        Event::HoldBus(held) => valve.hold_bus(held),
        Event::BusOff(off) => {
            valve.sense(|inputs| inputs.bus = if off { BusErrorMode::BusOff } else { BusErrorMode::ErrorActive });
        }
        Event::Internal(there) => valve.sense(|inputs| inputs.internal_fault = there),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_goes_out_in_it(
        before in vec(event(), 0..20),
        during in vec(event(), 0..20),
        write_ms in 0..=200_u64,
    ) {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(write_ms);
        for event in before {
            act(&mut valve, event);
        }
        // Whatever is under way comes to its end, and the valve is brought to pre-operational.
        act(&mut valve, Event::BusOff(false));
        valve.hold_bus(false);
        valve.advance(5000);
        valve.send("000: 80 20");
        valve.take();
        act(&mut valve, Event::Activate);
        let end = after(valve.now(), Duration::from_millis(2 * DELAY_MS));
        for event in during {
            act(&mut valve, event);
            let early: Vec<(Instant, _)> = valve.take_timed().into_iter().filter(|(at, _)| *at < end).collect();
            prop_assert!(early.is_empty(), "{:?} after {:?}", early, event);
        }
        act(&mut valve, Event::BusOff(false));
        valve.hold_bus(false);
        valve.advance(5000);
        valve.send("000: 80 20");
        valve.take();
        valve.exchange(REQUESTS[0].0, &[REQUESTS[0].1]);
    }

    /// Without a reset or a stop each request is answered once, or counted as dropped.
    #[test]
    fn each_request_is_answered_or_counted(events in vec(event(), 1..80), write_ms in 0..=60_u64) {
        let mut valve = Rig::booted();
        valve.send(lss::TO_CONFIGURATION);
        valve.write_time = Duration::from_millis(write_ms);
        let mut asked = [0_usize; REQUESTS.len()];
        let mut sent = Vec::new();
        for event in events {
            match event {
                // A second request of one SDO client gives the first one up.
                Event::Request(1) | Event::Other(_) => continue,
                // LSS takes no request in the silence: it is the master's that breaks it.
                Event::Activate => {
                    act(&mut valve, event);
                    valve.advance(2 * DELAY_MS);
                }
                Event::Request(number) => {
                    asked[number] += 1;
                    act(&mut valve, event);
                }
                _ => act(&mut valve, event),
            }
            sent.extend(valve.take());
        }
        act(&mut valve, Event::BusOff(false));
        valve.hold_bus(false);
        valve.advance(5000);
        sent.extend(valve.take());
        let missing = unanswered(&REQUESTS, &asked, &sent);
        let dropped = usize::try_from(valve.device().frames_dropped()).unwrap();
        prop_assert!(missing <= dropped, "{} answers are missing, {} frames dropped", missing, dropped);
        for ((_, answer), asked) in REQUESTS.iter().zip(asked) {
            prop_assert!(sent.iter().filter(|frame| frame == answer).count() <= asked, "more than one answer {}", answer);
        }
    }
}
