//! Whatever happens to a valve, its EMCYs tell the whole story (SPEC 4.2): each activation once, counted without a gap,
//! and the end.

use std::collections::BTreeMap;

use proptest::prelude::*;
use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::controller::BusErrorMode;
use tests::{Inputs, Rig};

const CODES: [(u16, u16); 7] = [
    (0x8305, 0x201D),
    (0x1000, 0x2024),
    (0x8140, 0x2019),
    (0x8301, 0x200F),
    (0x3411, 0x2001),
    (0x3412, 0x2002),
    (0x8003, 0x2023),
];

/// One event in the life of a valve.
#[derive(Clone, Copy, Debug)]
enum Event {
    Supply(u32),
    Temperature(i16),
    Internal(bool),
    BusOff(bool),
    Spool(SpoolFault),
    Lever(Option<i16>),
    /// An RPDO with this control word and set-point.
    Rpdo(u8, i16),
    ResetCommunication,
    Pass(u64),
    Leap(u64),
}

fn event() -> impl Strategy<Value = Event> {
    use SpoolFault::{Drifting, NoFloat, None, Slow, Stuck};
    let times = || prop::sample::select(vec![1, 50, 249, 250, 500, 1000, 2000, 10_000]);
    prop_oneof![
        2 => prop::sample::select(vec![0, 8_000, 10_000, 24_000, 34_000, 40_000]).prop_map(Event::Supply),
        2 => prop::sample::select(vec![-50, -37, 25, 117, 130]).prop_map(Event::Temperature),
        1 => any::<bool>().prop_map(Event::Internal),
        1 => any::<bool>().prop_map(Event::BusOff),
        1 => prop::sample::select(vec![None, Stuck, Slow, Drifting, NoFloat]).prop_map(Event::Spool),
        1 => prop::sample::select(vec![Option::None, Some(0), Some(16384), Some(-3000)]).prop_map(Event::Lever),
        6 => (prop::sample::select(vec![0x0F, 0x0F, 0x03, 0x0B]), prop::sample::select(vec![0, 16384, -16384, 32767, 20000]))
            .prop_map(|(word, set_point)| Event::Rpdo(word, set_point)),
        1 => Just(Event::ResetCommunication),
        4 => times().prop_map(Event::Pass),
        1 => times().prop_map(Event::Leap),
    ]
}

impl Event {
    fn happen(self, valve: &mut Rig) {
        let sense = |valve: &mut Rig, change: &dyn Fn(&mut Inputs)| valve.sense(change);
        match self {
            Self::Supply(supply_mv) => sense(valve, &|inputs| inputs.supply_mv = supply_mv),
            Self::Temperature(temperature_c) => sense(valve, &|inputs| inputs.temperature_c = temperature_c),
            Self::Internal(fault) => sense(valve, &|inputs| inputs.internal_fault = fault),
            Self::BusOff(off) => {
                let bus = if off { BusErrorMode::BusOff } else { BusErrorMode::ErrorActive };
                sense(valve, &|inputs| inputs.bus = bus);
            }
            Self::Spool(fault) => sense(valve, &|inputs| inputs.spool.fault = fault),
            Self::Lever(lever) => sense(valve, &|inputs| inputs.spool.lever = lever.and_then(Position::new)),
            Self::Rpdo(word, set_point) => {
                let [low, high] = set_point.to_le_bytes();
                valve.send(&format!("220: {word:02X} 00 {low:02X} {high:02X}"));
            }
            Self::ResetCommunication => {
                valve.send_all(&["000: 82 00", "000: 01 00"]);
            }
            Self::Pass(ms) => valve.advance(ms),
            Self::Leap(ms) => valve.leap(protocol_core::time::Duration::from_millis(ms)),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn tells_the_whole_story(events in prop::collection::vec(event(), 1..80)) {
        let mut valve = Rig::booted();
        valve.send("000: 01 00");
        for _ in 0..3 {
            valve.send("220: 0F 00 00 00");
        }
        valve.take();
        let mut counts = BTreeMap::new();
        let mut newest = None;
        let (mut over, mut bus_off) = (true, false);
        for event in events.into_iter().chain([Event::BusOff(false)]) {
            // nobody reaches a valve that is bus-off
            match event {
                Event::BusOff(off) => bus_off = off,
                Event::Rpdo(..) | Event::ResetCommunication if bus_off => continue,
                _ => {}
            }
            event.happen(&mut valve);
            // after a reset of the communication the active ones are told again, with the counts that they have
            let repeats = matches!(event, Event::ResetCommunication);
            while let Some(frame) = valve.take_next() {
                if !frame.to_string().starts_with("0A0:") {
                    continue;
                }
                let bytes = frame.data();
                let code = u16::from_le_bytes([bytes[0], bytes[1]]);
                over = code == 0;
                if over {
                    prop_assert_eq!(bytes, [0; 8]);
                    continue;
                }
                prop_assert_ne!(bytes[2], 0, "{}", frame);
                prop_assert_eq!(&bytes[4..], [0; 4]);
                let count = counts.entry(code).or_insert(0);
                if !repeats {
                    *count += 1;
                    newest = Some(u32::from(*count) << 16 | u32::from(code));
                }
                prop_assert_eq!(bytes[3], *count, "{}", frame);
            }
        }
        prop_assert_eq!(over, valve.read(0x1001, 0) == 0, "the end is told");
        for (code, index) in CODES {
            prop_assert_eq!(valve.read(index, 0), u32::from(counts.get(&code).copied().unwrap_or(0_u8)));
        }
        if let Some(newest) = newest {
            prop_assert_eq!(valve.read(0x1003, 1), newest);
        }
        prop_assert_eq!(valve.device().frames_dropped(), 0);
    }
}
