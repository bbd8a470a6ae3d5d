//! DM2: the previously active faults, in one frame or in packets (SPEC 5).

use super::*;

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
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.advance_cyclic(100, BLOCK);
    expect_dm2_now(&mut valve, DM2_NONE);
    valve.sense(|inputs| inputs.internal_fault = false);
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
    valve.advance_cyclic_news(500, BLOCK, &[]);
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
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::Stuck);
    valve.recover();
    valve.send(EXTEND);
    valve.advance_cyclic(500, EXTEND);
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::NoFloat);
    valve.recover();
    valve.send(FLOAT);
    valve.advance_cyclic(1000, FLOAT);
    valve.advance(300);
    valve.sense(|inputs| *inputs = Inputs::default());
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
    valve.send_all(&[BLOCK, DM2_REQUEST]);
    valve.expect_news(&DM2_FOUR[..1]);
}

/// The list is cleared meanwhile: the packets under way are those of the list as it was, and a request is dropped
/// still.
#[test]
fn the_list_changes_during_a_running_bam() {
    let mut valve = four_previously_active();
    valve.send(DM2_REQUEST);
    valve.expect_news(&DM2_FOUR[..1]);
    valve.exchange_news(DM3_REQUEST, &[DM3_DONE]);
    valve.exchange_news(DM2_REQUEST, &[]);
    valve.advance_cyclic_news(1000, BLOCK, &DM2_FOUR[1..]);
    expect_dm2(&mut valve, &[DM2_NONE]);
}

/// A bus that is held in the middle delays packets; they do not follow each other faster for it. After 200 ms the rest
/// is given up as a whole.
#[test]
fn packets_keep_their_distance_on_a_busy_bus() {
    for (held, whole) in [(60, true), (100, true), (150, false), (190, false), (350, false)] {
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
        assert_eq!(frames, if whole { &DM2_FOUR[1..] } else { &[] }, "held for {held} ms");
        assert!(sent.windows(2).all(|pair| (50..=200).contains(&(pair[1].0 - pair[0].0))), "{held}: {sent:?}");
    }
}

/// Active again, it has left the list, with the next recovery it is back, counted twice.
#[test]
fn a_fault_that_is_active_again() {
    let mut valve = four_previously_active();
    valve.sense(|inputs| inputs.internal_fault = true);
    expect_dm2(
        &mut valve,
        &[
            "1CECFF83: 20 0E 00 02 FF CB FE 00",
            "1CEBFF83: 01 04 FF F1 8F 90 01 73",
            "1CEBFF83: 02 02 03 01 73 02 04 01",
            "18FECA83: 10 FF FA 8F 8B 02 FF FF",
        ],
    );
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.recover();
    expect_dm2(&mut valve, &[DM2_FOUR[0], "1CEBFF83: 01 10 FF FA 8F 8B 02 F1", DM2_FOUR[2], DM2_FOUR[3]]);
}
