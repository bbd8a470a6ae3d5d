//! The silence of LSS "activate bit timing" against everything else: nothing goes out in it, whatever falls due, is
//! stored, reset or asked for meanwhile; and after it the valve is there again (SPEC 4.4).

use std::ops::Range;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use protocol_core::time::{Duration, Instant, after};
use tests::hostile::{Asked, Disturbance, answered_or_counted};
use tests::{Rig, lss};

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

/// Twice 50 ms.
const ACTIVATE: &str = "7E5: 15 32 00 00 00 00 00 00";

fn around() -> impl Strategy<Value = Disturbance> {
    prop_oneof![
        6 => (0..=30_u64).prop_map(Disturbance::Advance),
        2 => any::<bool>().prop_map(Disturbance::HoldBus),
        1 => Disturbance::bus_off(),
        2 => any::<bool>().prop_map(Disturbance::Internal),
    ]
}

/// Events in a row.
fn events(count: Range<usize>) -> impl Strategy<Value = Vec<Disturbance>> {
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
    let request = select(&REQUESTS[..]).prop_map(|(request, _)| request);
    let frames = prop_oneof![4 => request, 6 => select(others.to_vec())].prop_map(Disturbance::Send);
    let event = prop_oneof![
        11 => around().prop_map(|event| vec![event]),
        10 => frames.prop_map(|event| vec![event]),
        2 => Just([lss::TO_CONFIGURATION, ACTIVATE].map(Disturbance::Send).to_vec()),
    ];
    vec(event, count).prop_map(|events| events.concat())
}

/// Whatever is under way comes to its end.
fn free_the_bus(valve: &mut Rig) {
    Disturbance::Bus(BusErrorMode::ErrorActive).act(valve);
    valve.hold_bus(false);
    valve.advance(5000);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_goes_out_in_it(
        before in events(0..20),
        during in events(0..20),
        write_ms in 0..=200_u64,
    ) {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(write_ms);
        before.iter().for_each(|event| event.act(&mut valve));
        free_the_bus(&mut valve);
        valve.send("000: 80 20");
        valve.take();
        valve.send_all(&[lss::TO_CONFIGURATION, ACTIVATE]);
        let end = after(valve.now(), Duration::from_millis(2 * DELAY_MS));
        for event in during {
            event.act(&mut valve);
            let early: Vec<(Instant, _)> = valve.take_timed().into_iter().filter(|(at, _)| *at < end).collect();
            prop_assert!(early.is_empty(), "{:?} after {:?}", early, event);
        }
        free_the_bus(&mut valve);
        valve.send("000: 80 20");
        valve.take();
        valve.exchange(REQUESTS[0].0, &[REQUESTS[0].1]);
    }

    /// Without a reset or a stop each request is answered once, or counted as dropped. A second request of one SDO client
    /// gives the first one up: there is one sort.
    #[test]
    fn each_request_is_answered_or_counted(
        events in vec(
            prop_oneof![
                11 => around().prop_map(|event| vec![Asked::Other(event)]),
                3 => select(&[0, 2, 3][..]).prop_map(|number| vec![Asked::Request(number)]),
                // LSS takes no request in the silence: it is the master's that breaks it.
                2 => Just([Disturbance::Send(ACTIVATE), Disturbance::Advance(2 * DELAY_MS)].map(Asked::Other).to_vec()),
            ],
            1..80,
        ),
        write_ms in 0..=60_u64,
    ) {
        let mut valve = Rig::booted();
        valve.send(lss::TO_CONFIGURATION);
        valve.write_time = Duration::from_millis(write_ms);
        answered_or_counted(&mut valve, &REQUESTS, &events.concat(), free_the_bus);
    }
}
