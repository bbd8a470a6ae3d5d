//! DM3 clears the previously active faults and their counters; the counters themselves (SPEC 2, 5).

use super::*;

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
            valve.sense_news(|inputs| inputs.internal_fault = true, &[INTERNAL]);
        }
    }
}

/// What is active, and what the shutdown still holds, stays; so does what was counted of it.
#[test]
fn dm3_leaves_what_is_not_previously_active() {
    let mut valve = Rig::claimed();
    undergo(&mut valve, CAUSES_TEMPERATURE);
    undergo(&mut valve, CAUSES_SUPPLY_HIGH);
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance_cyclic_news(300, BLOCK, &["18FECA83: 04 FF F1 8F 90 02 FF FF"]);
    valve.exchange_news(DM3_REQUEST, &[DM3_DONE]);
    valve.exchange_news(DM1_REQUEST, &["18FECA83: 04 FF F1 8F 90 02 FF FF"]);
    valve.sense_news(|inputs| inputs.temperature_c = 25, &[DM1_CLEAR]);
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

#[test]
fn both_faults_of_the_spool_count_for_themselves() {
    let mut valve = Rig::claimed();
    for count in 1..=3 {
        valve.sense(|inputs| inputs.spool.lever = Position::new(8192));
        valve.advance_news(500, &[&format!("18FECA83: 10 FF EC 8F 87 {count:02X} FF FF")]);
        valve.sense(|inputs| inputs.spool.lever = None);
        valve.advance_news(150, &[DM1_CLEAR]);
    }
    valve.recover();
    valve.sense(|inputs| inputs.spool.fault = SpoolFault::NoFloat);
    valve.send(FLOAT);
    valve.advance_cyclic_news(1000, FLOAT, &["18FECA83: 10 FF EE 8F 87 01 FF FF"]);
}
