//! After a blocked bus a valve tells the state as it is then, answers what it was asked, and a BAM is whole or given up
//! (SPEC 5).

use protocol_core::controller::BusErrorMode;
use tests::isobus::{AVEF_BLOCKED, BLOCK, CLAIM, DM1_CLEAR, DM1_REQUEST, DM2_REQUEST, INTERNAL, TEMPERATURE};
use tests::{Inputs, Rig};

const DM1: &str = "18FECA83";
const CLAIM_REQUEST: &str = "18EAFF27: 00 EE 00";

/// Internal error and temperature: two packets of DM2.
const DM2_TWO: [&str; 3] =
    ["1CECFF83: 20 0A 00 02 FF CB FE 00", "1CEBFF83: 01 10 FF FA 8F 8B 01 F1", "1CEBFF83: 02 8F 90 01 FF FF FF FF"];

/// The tool is unplugged for a while: of all that changed meanwhile, and of what was asked, the present state alone is told.
#[test]
fn dm1_tells_the_present_state() {
    type Change = fn(&mut Inputs);
    let internal: Change = |inputs| inputs.internal_fault = true;
    let both: Change = |inputs| (inputs.internal_fault, inputs.temperature_c) = (true, 130);
    for (request, change, ms, later, told) in [
        (BLOCK, internal, 15_000, (|inputs| inputs.internal_fault = false) as Change, DM1_CLEAR),
        (BLOCK, internal, 5_500, |_| {}, INTERNAL),
        (BLOCK, both, 300, |inputs| inputs.internal_fault = false, TEMPERATURE),
        (DM1_REQUEST, internal, 0, |_| {}, INTERNAL),
    ] {
        let mut valve = Rig::claimed();
        valve.hold_bus(true);
        valve.send(request);
        valve.sense(change);
        valve.advance_cyclic(ms, BLOCK);
        valve.sense(later);
        valve.advance_cyclic(400, BLOCK);
        valve.hold_bus(false);
        assert_eq!(valve.take_under(DM1), [told]);
        valve.advance_cyclic(1000, BLOCK);
        assert_eq!(valve.take_under(DM1), vec![told; usize::from(told != DM1_CLEAR)]);
    }
}

/// A burst of requests for the claim pushes nothing else out.
#[test]
fn a_burst_of_requests_for_the_claim() {
    let mut valve = Rig::with_two_previously_active();
    valve.hold_bus(true);
    valve.send_all(&[DM1_REQUEST, DM2_REQUEST, "18EA8328: 00 FF 00"]);
    for _ in 0..600 {
        valve.send(CLAIM_REQUEST);
    }
    valve.hold_bus(false);
    let mut sent = valve.take_news();
    valve.advance_cyclic(1000, BLOCK);
    sent.extend(valve.take_news());
    let claims = sent.iter().filter(|frame| *frame == CLAIM).count();
    assert!((1..=3).contains(&claims), "{claims} claims");
    sent.retain(|frame| frame != CLAIM);
    let mut expected = vec!["18E8FF83: 01 FF FF FF 28 00 FF 00", DM1_CLEAR];
    expected.extend(DM2_TWO);
    assert_eq!(sent, expected);
}

/// The burst falls between two packets.
#[test]
fn a_burst_in_a_bam() {
    let mut valve = Rig::with_two_previously_active();
    valve.exchange(DM2_REQUEST, &DM2_TWO[..1]);
    valve.advance(40);
    valve.hold_bus(true);
    for _ in 0..600 {
        valve.send(CLAIM_REQUEST);
    }
    // The packet is due now.
    valve.advance(80);
    for _ in 0..600 {
        valve.send(CLAIM_REQUEST);
    }
    valve.hold_bus(false);
    let mut sent = valve.take_news();
    valve.advance_cyclic(1000, BLOCK);
    sent.extend(valve.take_news());
    sent.retain(|frame| frame != CLAIM);
    assert_eq!(sent, DM2_TWO[1..]);
}

/// The gap between two packets has passed 200 ms: the BAM is given up, the packet in the controller included.
#[test]
fn a_bam_is_given_up() {
    for packets in [0, 1] {
        let mut valve = Rig::with_two_previously_active();
        valve.exchange(DM2_REQUEST, &DM2_TWO[..1]);
        if packets == 1 {
            valve.advance_cyclic(150, BLOCK);
            assert!(valve.take().contains(&DM2_TWO[1].to_owned()));
        }
        valve.hold_bus(true);
        valve.advance_cyclic(300, BLOCK);
        valve.hold_bus(false);
        valve.advance_cyclic(1000, BLOCK);
        assert_eq!(valve.take_news(), [""; 0], "after {packets} packets");
        // The next request is answered whole.
        valve.send(DM2_REQUEST);
        valve.advance_cyclic(1000, BLOCK);
        assert_eq!(valve.take_news(), DM2_TWO);
    }
}

/// One that was asked for in bus-off, or was under way when the bus was lost, is given up, the announcement included.
#[test]
fn a_bam_and_bus_off() {
    for under_way in [false, true] {
        let mut valve = Rig::with_two_previously_active();
        if under_way {
            valve.exchange(DM2_REQUEST, &DM2_TWO[..1]);
        }
        valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
        if !under_way {
            valve.exchange(DM2_REQUEST, &[]);
        }
        valve.advance_cyclic(50, BLOCK);
        valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        valve.advance_cyclic(1000, BLOCK);
        let sent = valve.take_news();
        assert!(!sent.iter().any(|frame| frame.starts_with("1CE")), "{sent:?}");
    }
}

/// An announcement that the bus has not taken yet begins no gap.
#[test]
fn a_bam_that_has_not_begun() {
    let mut valve = Rig::with_two_previously_active();
    valve.hold_bus(true);
    valve.send(DM2_REQUEST);
    valve.advance_cyclic(5000, BLOCK);
    valve.hold_bus(false);
    valve.advance_cyclic(500, BLOCK);
    assert_eq!(valve.take_news(), DM2_TWO);
}

/// Refusals, acknowledgements and UDS answers do not go stale: each is sent, or counted as dropped.
#[test]
fn every_request_is_answered_or_counted() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    let mut asked = Vec::new();
    for source in 0..40_u32 {
        valve.send(&format!("18EA83{source:02X}: 00 FF 00"));
        asked.push(format!("18E8FF83: 01 FF FF FF {source:02X} 00 FF 00"));
        valve.send(&format!("{:08X}: 03 22 F0 10", 0x1BC0_0083 | source << 11));
        asked.push(format!("{:08X}: 04 62 F0 10 A5", 0x1BC4_1800 | source));
        valve.send(&format!("18EA83{source:02X}: CC FE 00"));
        asked.push(format!("18E8FF83: 00 FF FF FF {source:02X} CC FE 00"));
    }
    valve.hold_bus(false);
    let sent = valve.take_news();
    let answered = asked.iter().filter(|answer| sent.contains(answer)).count();
    let dropped = usize::try_from(valve.device().frames_dropped()).unwrap();
    assert_eq!(asked.len(), answered + dropped, "{sent:#?}");
}

/// The wait after the claim begins when the claim is on the bus: DM1 of what happened meanwhile comes after it.
#[test]
fn the_first_dm1_after_a_held_claim() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    valve.power_cycle();
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.advance(3000);
    valve.hold_bus(false);
    valve.expect(CLAIM);
    valve.silent_until(250, &[AVEF_BLOCKED, INTERNAL]);
}
