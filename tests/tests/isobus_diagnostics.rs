//! DM1, DM2 and DM3: what is told of the faults, when, in which order, and what is cleared (SPEC 2, 3, 5).

use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::Senses;
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, DM1_CLEAR, EXTEND, FLOAT};

const ONE: Duration = Duration::from_micros(1);

const DM1_REQUEST: &str = "18EA8327: CA FE 00";
const DM2_REQUEST: &str = "18EA8327: CB FE 00";
const DM2_NONE: &str = "18FECB83: 00 FF 00 00 00 00 FF FF";
const DM3_REQUEST: &str = "18EA8327: CC FE 00";
const DM3_DONE: &str = "18E8FF83: 00 FF FF FF 27 CC FE 00";

const INTERNAL: &str = "18FECA83: 10 FF FA 8F 8B 01 FF FF";
const TEMPERATURE: &str = "18FECA83: 04 FF F1 8F 90 01 FF FF";
const SUPPLY_HIGH: &str = "18FECA83: 04 FF 73 02 03 01 FF FF";
const SUPPLY_LOW: &str = "18FECA83: 04 FF 73 02 04 01 FF FF";
const TIME_GUARDING: &str = "18FECA83: 04 FF E9 8F 93 01 FF FF";

/// A change of the senses that causes a fault, and the fault's delay in milliseconds.
type Cause = (fn(&mut Senses), u64);

const CAUSES_INTERNAL: Cause = (|senses| senses.internal_fault = true, 0);
const CAUSES_TEMPERATURE: Cause = (|senses| senses.temperature_c = 121, 250);
const CAUSES_SUPPLY_HIGH: Cause = (|senses| senses.supply_mv = 36_001, 2000);
const CAUSES_SUPPLY_LOW: Cause = (|senses| senses.supply_mv = 8_999, 2000);

/// The faults that come from outside, and their DM1.
const SENSED: [(Cause, &str); 4] = [
    (CAUSES_INTERNAL, INTERNAL),
    (CAUSES_TEMPERATURE, TEMPERATURE),
    (CAUSES_SUPPLY_HIGH, SUPPLY_HIGH),
    (CAUSES_SUPPLY_LOW, SUPPLY_LOW),
];

/// Brings a fault about, and ends it and its shutdown; what was sent is taken.
fn undergo(valve: &mut Rig, (change, delay): Cause) {
    valve.sense(change);
    valve.advance_cyclic(delay, BLOCK);
    valve.sense(|senses| *senses = Senses::default());
    valve.recover();
    valve.take();
}

/// Has this answer to a request for DM2, packets included.
#[track_caller]
fn expect_dm2(valve: &mut Rig, frames: &[&str]) {
    valve.take();
    valve.send(DM2_REQUEST);
    valve.advance_cyclic(1000, BLOCK);
    valve.expect_news(frames);
}

#[test]
fn every_fault_in_its_bytes() {
    for ((change, delay), dm1) in SENSED {
        let mut valve = Rig::claimed();
        valve.sense(change);
        if let Some(almost) = delay.checked_sub(1) {
            valve.advance(almost);
            valve.expect_news(&[]);
            valve.advance_by(Duration::from_micros(999));
            valve.expect_news(&[]);
            valve.advance_by(ONE);
        }
        valve.expect_news(&[dm1]);
        valve.sense(|senses| *senses = Senses::default());
        valve.expect_news(&[DM1_CLEAR]);
        valve.advance(5000);
        valve.expect_news(&[]);
    }
}

/// No lower limit of the temperature on ISOBUS; the limits themselves are no fault; hysteresis.
#[test]
fn limits() {
    for change in [
        (|senses| senses.temperature_c = -50) as fn(&mut Senses),
        |senses| senses.temperature_c = i16::MIN,
        |senses| senses.temperature_c = 120,
        |senses| senses.supply_mv = 36_000,
        |senses| senses.supply_mv = 9_000,
    ] {
        let mut valve = Rig::claimed();
        valve.sense(change);
        valve.advance(10_000);
        valve.expect_news(&[]);
    }
    type Change = fn(&mut Senses);
    let hysteresis: [(Cause, Change, Change); 3] = [
        (CAUSES_TEMPERATURE, |senses| senses.temperature_c = 116, |senses| senses.temperature_c = 114),
        (CAUSES_SUPPLY_HIGH, |senses| senses.supply_mv = 32_000, |senses| senses.supply_mv = 31_999),
        (CAUSES_SUPPLY_LOW, |senses| senses.supply_mv = 11_000, |senses| senses.supply_mv = 11_001),
    ];
    for ((change, delay), stays, clears) in hysteresis {
        let mut valve = Rig::claimed();
        valve.sense(change);
        valve.advance(delay);
        valve.take();
        valve.sense(stays);
        valve.expect_news(&[]);
        valve.sense(clears);
        valve.expect_news(&[DM1_CLEAR]);
    }
}

/// In DM1, DM2, the counters and the memory.
#[test]
fn a_fault_that_comes_and_goes_within_its_delay_leaves_no_trace() {
    for ((change, delay), dm1) in SENSED.into_iter().filter(|((_, delay), _)| *delay > 0) {
        let mut valve = Rig::claimed();
        let writes = valve.writes.len();
        for _ in 0..5 {
            valve.sense(change);
            valve.advance_by(Duration::from_micros(delay * 1000 - 1));
            valve.sense(|senses| *senses = Senses::default());
            valve.advance(10);
        }
        valve.send(EXTEND);
        assert_eq!(valve.flow()[2], 0x31, "not shut down");
        valve.expect_news(&[]);
        expect_dm2(&mut valve, &[DM2_NONE]);
        valve.advance_cyclic(20_000, BLOCK);
        assert_eq!(valve.writes.len(), writes, "nothing to be stored");
        valve.take();
        // the first real one is the first
        valve.sense(change);
        valve.advance_cyclic(delay, BLOCK);
        valve.expect_news(&[dm1]);
    }
}

/// One at a time, the most important; a less important one neither shows nor restarts the second.
#[test]
fn the_highest_priority_alone() {
    let mut valve = Rig::claimed();
    valve.sense(|senses| senses.supply_mv = 8_000);
    valve.advance(2000);
    valve.expect_news(&[SUPPLY_LOW]);
    valve.sense(|senses| senses.temperature_c = 130);
    valve.advance(250);
    valve.expect_news(&[TEMPERATURE]);
    valve.sense(|senses| senses.internal_fault = true);
    valve.expect_news(&[INTERNAL]);
    // going in another order: those that do not show make no difference
    valve.sense(|senses| senses.temperature_c = 25);
    valve.expect_news(&[]);
    valve.sense(|senses| senses.internal_fault = false);
    valve.expect_news(&[SUPPLY_LOW]);
    valve.sense(|senses| senses.supply_mv = 24_000);
    valve.expect_news(&[DM1_CLEAR]);

    let mut valve = Rig::claimed();
    valve.sense(|senses| senses.internal_fault = true);
    valve.expect_news(&[INTERNAL]);
    valve.advance(400);
    valve.sense(|senses| senses.temperature_c = 130);
    valve.advance(300);
    valve.expect_news(&[]);
    valve.advance_by(Duration::from_micros(299_999));
    valve.expect_news(&[]);
    valve.advance_by(ONE);
    valve.expect_news(&[INTERNAL]);
    // it was counted all the same, once
    valve.sense(|senses| senses.internal_fault = false);
    valve.expect_news(&[TEMPERATURE]);
}

#[test]
fn every_second_while_active() {
    let mut valve = Rig::claimed();
    valve.advance_by(Duration::from_micros(33_333));
    valve.sense(|senses| senses.internal_fault = true);
    valve.expect_news(&[INTERNAL]);
    for _ in 0..20 {
        valve.advance_by(Duration::from_micros(999_999));
        valve.expect_news(&[]);
        valve.advance_by(ONE);
        valve.expect_news(&[INTERNAL]);
    }
    valve.sense(|senses| senses.internal_fault = false);
    valve.expect_news(&[DM1_CLEAR]);
    valve.advance(10_000);
    valve.expect_news(&[]);
}

/// A change restarts the second; a request is answered and does not.
#[test]
fn what_restarts_the_second() {
    let mut valve = Rig::claimed();
    valve.sense(|senses| senses.temperature_c = 130);
    valve.advance(250);
    valve.expect_news(&[TEMPERATURE]);
    valve.advance(700);
    valve.exchange_news(DM1_REQUEST, &[TEMPERATURE]);
    valve.exchange_news("18EAFF27: CA FE 00", &[TEMPERATURE]);
    valve.advance(299);
    valve.expect_news(&[]);
    valve.advance(1);
    valve.expect_news(&[TEMPERATURE]);
    valve.advance(700);
    valve.sense(|senses| senses.internal_fault = true);
    valve.expect_news(&[INTERNAL]);
    valve.advance(999);
    valve.expect_news(&[]);
    valve.advance(1);
    valve.expect_news(&[INTERNAL]);
    valve.advance(300);
    valve.sense(|senses| senses.internal_fault = false);
    valve.expect_news(&[TEMPERATURE]);
    valve.advance(999);
    valve.expect_news(&[]);
    valve.advance(1);
    valve.expect_news(&[TEMPERATURE]);
}

/// Asked for when nothing is active, and when something was.
#[test]
fn dm1_without_a_fault() {
    let mut valve = Rig::claimed();
    valve.exchange_news(DM1_REQUEST, &[DM1_CLEAR]);
    undergo(&mut valve, CAUSES_INTERNAL);
    valve.exchange_news(DM1_REQUEST, &[DM1_CLEAR]);
    valve.advance(5000);
    valve.expect_news(&[TIME_GUARDING; 5]);
}

/// Bus-off outshines what is below it, is told only in the counters, and ends with its recovery.
#[test]
fn bus_off() {
    let mut valve = Rig::claimed();
    valve.send(EXTEND);
    valve.advance_cyclic(300, EXTEND);
    valve.take();
    valve.sense(|senses| senses.bus = BusErrorMode::BusOff);
    assert!(!valve.device().outputs().solenoids);
    valve.sense(|senses| senses.internal_fault = true);
    valve.sense(|senses| senses.internal_fault = false);
    valve.advance(10_050);
    valve.expect_nothing();
    valve.sense(|senses| senses.bus = BusErrorMode::ErrorActive);
    // time guarding has been active for long: with bus-off gone, that is what shows
    valve.expect(TIME_GUARDING);
    valve.expect_nothing();
    valve.advance(50);
    valve.expect("0CFE1383: 7D 7D 30 FF FF FF FF FF");
    valve.expect_nothing();
    valve.recover();
    expect_dm2(
        &mut valve,
        &[
            "1CECFF83: 20 0E 00 02 FF CB FE 00",
            "1CEBFF83: 01 10 FF FA 8F 8B 01 D7",
            "1CEBFF83: 02 8F 93 01 E9 8F 93 01",
        ],
    );
    // alone, without anybody who commands
    let mut valve = Rig::claimed();
    valve.sense(|senses| senses.bus = BusErrorMode::BusOff);
    valve.advance(10);
    valve.sense(|senses| senses.bus = BusErrorMode::ErrorPassive);
    valve.expect_news(&[DM1_CLEAR]);
}

/// Whatever was on its way when the bus went off is not sent afterwards.
#[test]
fn bus_off_empties_the_queue() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    valve.sense(|senses| senses.internal_fault = true);
    valve.send(DM1_REQUEST);
    valve.send(DM2_REQUEST);
    valve.advance(500);
    valve.sense(|senses| senses.bus = BusErrorMode::BusOff);
    valve.send("18EA8327: 00 EE 00");
    valve.hold_bus(false);
    valve.expect_nothing();
    valve.sense(|senses| senses.internal_fault = false);
    valve.sense(|senses| senses.bus = BusErrorMode::ErrorActive);
    valve.expect_news(&[DM1_CLEAR]);
}

/// A running DM2 is not continued after bus-off: nobody could make sense of its rest.
#[test]
fn bus_off_ends_a_running_bam() {
    let mut valve = four_previously_active();
    valve.send(DM2_REQUEST);
    valve.advance_cyclic(100, BLOCK);
    assert_eq!(valve.take_news().len(), 2);
    valve.sense(|senses| senses.bus = BusErrorMode::BusOff);
    valve.advance_cyclic(100, BLOCK);
    valve.sense(|senses| senses.bus = BusErrorMode::ErrorActive);
    valve.advance_cyclic(1000, BLOCK);
    valve.expect_news(&[DM1_CLEAR]);
}

#[test]
fn dm2_of_none_and_of_one() {
    let mut valve = Rig::claimed();
    expect_dm2(&mut valve, &[DM2_NONE]);
    valve.exchange_news("18EAFF27: CB FE 00", &[DM2_NONE]);
    for (cause, dm1) in SENSED {
        let mut valve = Rig::claimed();
        undergo(&mut valve, cause);
        let dm2 = dm1.replace("FECA", "FECB");
        expect_dm2(&mut valve, &[&dm2]);
        valve.exchange_news("18EAFF27: CB FE 00", &[&dm2]);
    }
}

/// An active fault is not previously active, nor one whose shutdown lasts.
#[test]
fn dm2_before_the_shutdown_is_over() {
    let mut valve = Rig::claimed();
    valve.sense(|senses| senses.internal_fault = true);
    valve.advance_cyclic(100, BLOCK);
    expect_dm2_now(&mut valve, DM2_NONE);
    valve.sense(|senses| senses.internal_fault = false);
    expect_dm2_now(&mut valve, DM2_NONE);
    valve.send(BLOCK);
    expect_dm2_now(&mut valve, DM2_NONE);
    valve.send(BLOCK);
    expect_dm2_now(&mut valve, "18FECB83: 10 FF FA 8F 8B 01 FF FF");
}

#[track_caller]
fn expect_dm2_now(valve: &mut Rig, dm2: &str) {
    valve.take();
    valve.exchange(DM2_REQUEST, &[dm2]);
}

/// Internal error, temperature, supply high and low, brought about in another order.
fn four_previously_active() -> Rig {
    let mut valve = Rig::claimed();
    for cause in [CAUSES_SUPPLY_LOW, CAUSES_INTERNAL, CAUSES_SUPPLY_HIGH, CAUSES_TEMPERATURE] {
        undergo(&mut valve, cause);
    }
    valve
}

/// 18 bytes in three packets, as the manual has them, with the most severe lamp.
const DM2_FOUR: [&str; 4] = [
    "1CECFF83: 20 12 00 03 FF CB FE 00",
    "1CEBFF83: 01 10 FF FA 8F 8B 01 F1",
    "1CEBFF83: 02 8F 90 01 73 02 03 01",
    "1CEBFF83: 03 73 02 04 01 FF FF FF",
];

#[test]
fn dm2_of_four_by_bam() {
    for request in [DM2_REQUEST, "18EAFF27: CB FE 00"] {
        let mut valve = four_previously_active();
        expect_bam(&mut valve, request, &DM2_FOUR);
    }
}

/// Sends the request: the first frame comes at once, the others 50–200 ms after the one before.
#[track_caller]
fn expect_bam(valve: &mut Rig, request: &str, frames: &[&str]) {
    valve.take();
    valve.send(request);
    valve.expect_news(&frames[..1]);
    for frame in &frames[1..] {
        let mut waited = 0;
        while {
            valve.advance(1);
            waited += 1;
            if waited % 50 == 0 {
                valve.send(BLOCK);
            }
            let sent = valve.take_news();
            assert!(sent.is_empty() || sent == [*frame], "{sent:?}");
            sent.is_empty() && waited <= 200
        } {}
        assert!((50..=200).contains(&waited), "{frame}: after {waited} ms");
    }
    valve.advance_cyclic(500, BLOCK);
    valve.expect_news(&[]);
}

/// Without a severe one the lamp is amber. Three faults are 14 bytes: two packets without a rest.
#[test]
fn the_lamp_and_full_packets() {
    let mut valve = Rig::claimed();
    for cause in [CAUSES_SUPPLY_HIGH, CAUSES_TEMPERATURE, CAUSES_SUPPLY_LOW] {
        undergo(&mut valve, cause);
    }
    expect_dm2(
        &mut valve,
        &[
            "1CECFF83: 20 0E 00 02 FF CB FE 00",
            "1CEBFF83: 01 04 FF F1 8F 90 01 73",
            "1CEBFF83: 02 02 03 01 73 02 04 01",
        ],
    );
}

/// Every fault that there is, in one list: 34 bytes in five packets.
#[test]
fn dm2_of_all() {
    let mut valve = four_previously_active();
    valve.sense(|senses| senses.bus = BusErrorMode::BusOff);
    valve.sense(|senses| senses.bus = BusErrorMode::ErrorActive);
    valve.sense(|senses| senses.spool.fault = SpoolFault::Stuck);
    valve.recover();
    valve.send(EXTEND);
    valve.advance_cyclic(500, EXTEND);
    valve.sense(|senses| senses.spool.fault = SpoolFault::NoFloat);
    valve.recover();
    valve.send(FLOAT);
    valve.advance_cyclic(1000, FLOAT);
    valve.advance(300);
    valve.sense(|senses| *senses = Senses::default());
    valve.recover();
    valve.advance_cyclic(200, BLOCK);
    expect_bam(
        &mut valve,
        DM2_REQUEST,
        &[
            "1CECFF83: 20 22 00 05 FF CB FE 00",
            "1CEBFF83: 01 10 FF EC 8F 87 01 EE",
            "1CEBFF83: 02 8F 87 01 FA 8F 8B 01",
            "1CEBFF83: 03 D7 8F 93 01 F1 8F 90",
            "1CEBFF83: 04 01 73 02 03 01 73 02",
            "1CEBFF83: 05 04 01 E9 8F 93 01 FF",
        ],
    );
}

/// Dropped, while other services go on.
#[test]
fn requests_during_a_running_bam() {
    let mut valve = four_previously_active();
    valve.send(DM2_REQUEST);
    valve.expect_news(&DM2_FOUR[..1]);
    for frame in &DM2_FOUR[1..] {
        for request in [DM2_REQUEST, "18EA8328: CB FE 00", "18EAFF27: CB FE 00"] {
            valve.exchange_news(request, &[]);
        }
        valve.exchange_news(DM1_REQUEST, &[DM1_CLEAR]);
        valve.exchange_news("1BC78883: 03 22 F0 10", &["1BC418F1: 04 62 F0 10 A5"]);
        valve.send(BLOCK);
        while valve.take_news() != [*frame] {
            valve.advance(1);
        }
    }
    valve.send(BLOCK);
    valve.send(DM2_REQUEST);
    valve.expect_news(&DM2_FOUR[..1]);
}

/// The list is cleared meanwhile: the packets under way are those of the list as it was, and a request is dropped still.
#[test]
fn the_list_changes_during_a_running_bam() {
    let mut valve = four_previously_active();
    valve.send(DM2_REQUEST);
    valve.expect_news(&DM2_FOUR[..1]);
    valve.exchange_news(DM3_REQUEST, &[DM3_DONE]);
    valve.exchange_news(DM2_REQUEST, &[]);
    valve.advance_cyclic(1000, BLOCK);
    valve.expect_news(&DM2_FOUR[1..]);
    expect_dm2(&mut valve, &[DM2_NONE]);
}

/// A bus that is held in the middle delays packets; they do not follow each other faster for it.
#[test]
fn packets_keep_their_distance_on_a_busy_bus() {
    for held in [60, 150, 190, 350] {
        let mut valve = four_previously_active();
        valve.send(DM2_REQUEST);
        valve.expect_news(&DM2_FOUR[..1]);
        valve.advance_cyclic(90, BLOCK);
        valve.hold_bus(true);
        valve.send(BLOCK);
        valve.advance_cyclic(held, BLOCK);
        valve.hold_bus(false);
        let mut sent = Vec::new();
        for ms in 0..600_u64 {
            sent.extend(valve.take_news().into_iter().map(|frame| (ms, frame)));
            if ms % 100 == 0 {
                valve.send(BLOCK);
            }
            valve.advance(1);
        }
        let frames: Vec<&str> = sent.iter().map(|(_, frame)| frame.as_str()).collect();
        assert_eq!(frames, DM2_FOUR[1..], "held for {held} ms");
        assert!(sent.windows(2).all(|pair| (50..=200).contains(&(pair[1].0 - pair[0].0))), "{held}: {sent:?}");
    }
}

/// Active again, it has left the list, with the next recovery it is back, counted twice.
#[test]
fn a_fault_that_is_active_again() {
    let mut valve = four_previously_active();
    valve.sense(|senses| senses.internal_fault = true);
    expect_dm2(
        &mut valve,
        &[
            "1CECFF83: 20 0E 00 02 FF CB FE 00",
            "1CEBFF83: 01 04 FF F1 8F 90 01 73",
            "1CEBFF83: 02 02 03 01 73 02 04 01",
            "18FECA83: 10 FF FA 8F 8B 02 FF FF",
        ],
    );
    valve.sense(|senses| senses.internal_fault = false);
    valve.recover();
    expect_dm2(&mut valve, &[DM2_FOUR[0], "1CEBFF83: 01 10 FF FA 8F 8B 02 F1", DM2_FOUR[2], DM2_FOUR[3]]);
}

#[test]
fn dm3_clears_the_list_and_its_counters() {
    for (request, acknowledgement) in [
        (DM3_REQUEST, Some(DM3_DONE)),
        ("18EA83F9: CC FE 00", Some("18E8FF83: 00 FF FF FF F9 CC FE 00")),
        ("18EAFF27: CC FE 00", None),
    ] {
        for empty in [false, true] {
            let mut valve = if empty { Rig::claimed() } else { four_previously_active() };
            valve.take();
            valve.exchange_news(request, acknowledgement.as_slice());
            expect_dm2(&mut valve, &[DM2_NONE]);
            valve.sense(|senses| senses.internal_fault = true);
            valve.expect_news(&[INTERNAL]);
        }
    }
}

/// What is active, and what the shutdown still holds, stays; so does what was counted of it.
#[test]
fn dm3_leaves_what_is_not_previously_active() {
    let mut valve = Rig::claimed();
    undergo(&mut valve, CAUSES_TEMPERATURE);
    undergo(&mut valve, CAUSES_SUPPLY_HIGH);
    valve.sense(|senses| senses.temperature_c = 130);
    valve.advance_cyclic(300, BLOCK);
    valve.expect_news(&["18FECA83: 04 FF F1 8F 90 02 FF FF"]);
    valve.exchange_news(DM3_REQUEST, &[DM3_DONE]);
    valve.exchange_news(DM1_REQUEST, &["18FECA83: 04 FF F1 8F 90 02 FF FF"]);
    valve.sense(|senses| senses.temperature_c = 25);
    valve.expect_news(&[DM1_CLEAR]);
    valve.exchange_news(DM3_REQUEST, &[DM3_DONE]);
    valve.recover();
    expect_dm2(&mut valve, &["18FECB83: 04 FF F1 8F 90 02 FF FF"]);
    undergo(&mut valve, CAUSES_SUPPLY_HIGH);
    expect_dm2(
        &mut valve,
        &[
            "1CECFF83: 20 0A 00 02 FF CB FE 00",
            "1CEBFF83: 01 04 FF F1 8F 90 02 73",
            "1CEBFF83: 02 02 03 01 FF FF FF FF",
        ],
    );
}

/// Each trouble code has a counter of its own, those of the spool too; it stops at 127 and DM1 still comes.
#[test]
fn counters_stop_at_127() {
    let mut valve = Rig::claimed();
    for count in 1..=300 {
        valve.sense(|senses| senses.internal_fault = true);
        valve.expect_news(&[&format!("18FECA83: 10 FF FA 8F 8B {:02X} FF FF", count.min(127))]);
        valve.sense(|senses| senses.internal_fault = false);
        valve.expect_news(&[DM1_CLEAR]);
    }
    valve.sense(|senses| senses.temperature_c = 130);
    valve.advance(250);
    valve.expect_news(&[TEMPERATURE]);
    valve.sense(|senses| senses.temperature_c = 25);
    valve.recover();
    expect_dm2(
        &mut valve,
        &[
            "1CECFF83: 20 0A 00 02 FF CB FE 00",
            "1CEBFF83: 01 10 FF FA 8F 8B 7F F1",
            "1CEBFF83: 02 8F 90 01 FF FF FF FF",
        ],
    );
}

#[test]
fn both_faults_of_the_spool_count_for_themselves() {
    let mut valve = Rig::claimed();
    for count in 1..=3 {
        valve.sense(|senses| senses.spool.lever = Position::new(8192));
        valve.advance(500);
        valve.expect_news(&[&format!("18FECA83: 10 FF EC 8F 87 {count:02X} FF FF")]);
        valve.sense(|senses| senses.spool.lever = None);
        valve.advance(150);
        valve.expect_news(&[DM1_CLEAR]);
    }
    valve.recover();
    valve.sense(|senses| senses.spool.fault = SpoolFault::NoFloat);
    valve.send(FLOAT);
    valve.advance_cyclic(1000, FLOAT);
    valve.expect_news(&["18FECA83: 10 FF EE 8F 87 01 FF FF"]);
}

trait ExchangeNews {
    fn exchange_news(&mut self, request: &str, answers: &[&str]);
}

impl ExchangeNews for Rig {
    /// Sends a frame; the valve must send these, beside its estimated flow, and nothing more.
    #[track_caller]
    fn exchange_news(&mut self, request: &str, answers: &[&str]) {
        self.expect_news(&[]);
        self.send(request);
        assert_eq!(self.take_news(), answers, "answers to {request}");
    }
}
