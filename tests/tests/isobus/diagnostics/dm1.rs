//! DM1: the active fault of the highest priority, when it changes and every second (SPEC 5).

use super::*;

/// The temperature has no lower limit on ISOBUS.
#[test]
fn no_cold_is_a_fault() {
    for temperature_c in [-50, i16::MIN] {
        let mut valve = Rig::claimed();
        valve.sense(|inputs| inputs.temperature_c = temperature_c);
        valve.advance_news(10_000, &[]);
    }
}

/// One at a time, the most important; a less important one neither shows nor restarts the second.
#[test]
fn the_highest_priority_alone() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.supply_mv = 8_000);
    valve.advance_news(2000, &[SUPPLY_LOW]);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance_news(250, &[TEMPERATURE]);
    valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
    // going in another order: those that do not show make no difference
    valve.sense_news(|inputs| inputs.temperature_c = 25, &[]);
    valve.sense_news(|inputs| inputs.internal_fault = false, &[SUPPLY_LOW]);
    valve.sense_news(|inputs| inputs.supply_mv = 24_000, &[DM1_CLEAR]);

    let mut valve = Rig::claimed();
    valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
    valve.advance(400);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance_news(300, &[]);
    valve.no_news_until(300, &[INTERNAL]);
    // it was counted all the same, once
    valve.sense_news(|inputs| inputs.internal_fault = false, &[TEMPERATURE]);
}

#[test]
fn every_second_while_active() {
    let mut valve = Rig::claimed();
    valve.advance_by(Duration::from_micros(33_333));
    valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
    for _ in 0..20 {
        valve.no_news_until(1000, &[INTERNAL]);
    }
    valve.sense_news(|inputs| inputs.internal_fault = false, &[DM1_CLEAR]);
    valve.advance_news(10_000, &[]);
}

/// A change restarts the second; a request is answered and does not.
#[test]
fn what_restarts_the_second() {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance_news(250, &[TEMPERATURE]);
    valve.advance(700);
    valve.exchange_news(DM1_REQUEST, &[TEMPERATURE]);
    valve.exchange_news("18EAFF27: CA FE 00", &[TEMPERATURE]);
    valve.no_news_until(300, &[TEMPERATURE]);
    valve.advance(700);
    valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
    valve.no_news_until(1_000, &[INTERNAL]);
    valve.advance(300);
    valve.sense_news(|inputs| inputs.internal_fault = false, &[TEMPERATURE]);
    valve.no_news_until(1_000, &[TEMPERATURE]);
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
    let mut valve = Rig::extending(300);
    valve.take();
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    assert!(!valve.outputs().solenoids);
    valve.internal_fault_comes_and_goes();
    valve.silent_for(10_050);
    valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
    // time guarding has been active for long: with bus-off gone, that is what shows
    valve.expect_all(&[TIME_GUARDING]);
    valve.advance_sends(50, &["0CFE1383: 7D 7D 30 FF FF FF FF FF"]);
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
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    valve.advance(10);
    valve.sense_news(|inputs| inputs.bus = BusErrorMode::ErrorPassive, &[DM1_CLEAR]);
}

/// Whatever was on its way when the bus went off is not sent afterwards.
#[test]
fn bus_off_empties_the_queue() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.send_all(&[DM1_REQUEST, DM2_REQUEST]);
    valve.advance(500);
    valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
    valve.send("18EA8327: 00 EE 00");
    valve.hold_bus(false);
    valve.expect_nothing();
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.sense_news(|inputs| inputs.bus = BusErrorMode::ErrorActive, &[DM1_CLEAR]);
}
