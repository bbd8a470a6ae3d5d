//! No frame leaves under an address that was lost, wherever it waits (SPEC 5).

use protocol_core::actuator::Led;
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{BLOCK, CANNOT_CLAIM, EXTEND, LOWER_NAME};

/// What makes the valve send, the least urgent frame first: BAM, UDS answer, DM1, claim, refusal, estimated flow.
const REQUESTS: [&str; 6] = [
    "18EA8327: CB FE 00",
    "1BC78883: 03 22 F0 10",
    "18EA8327: CA FE 00",
    "18EA8327: 00 EE 00",
    "18EA8327: 00 FF 00",
    "18EA8327: 13 FE 00",
];

#[track_caller]
fn falls_silent(valve: &mut Rig, what: &str) {
    valve.send(LOWER_NAME);
    valve.hold_bus(false);
    valve.advance(3000);
    assert_eq!(valve.take(), [CANNOT_CLAIM], "{what}");
}

#[test]
fn what_waits_in_the_controller() {
    for request in REQUESTS {
        let mut valve = Rig::with_two_previously_active();
        valve.hold_bus(true);
        valve.send(request);
        assert_eq!(valve.pending(), 1, "{request}");
        falls_silent(&mut valve, request);
    }
}

/// Three frames in the mailboxes, and those that they displaced.
#[test]
fn what_was_displaced_in_the_controller() {
    let mut valve = Rig::with_two_previously_active();
    valve.hold_bus(true);
    for request in REQUESTS {
        valve.send(request);
    }
    assert_eq!(valve.pending(), 3);
    falls_silent(&mut valve, "all of them");
}

/// Between two packets.
#[test]
fn a_bam_under_way() {
    let mut valve = Rig::with_two_previously_active();
    // The packet falls due between two estimated flows.
    while valve.take_under("0CFE1383").is_empty() {
        valve.advance(1);
    }
    valve.advance(70);
    valve.send(BLOCK);
    valve.exchange("18EA8327: CB FE 00", &["1CECFF83: 20 0A 00 02 FF CB FE 00"]);
    valve.advance_news(40, &[]);
    valve.hold_bus(true);
    while valve.pending() == 0 {
        valve.advance(1);
    }
    falls_silent(&mut valve, "a packet");
}

/// The claim itself has not left the controller.
#[test]
fn a_claim_that_waits() {
    let mut valve = Rig::claimed();
    valve.hold_bus(true);
    valve.power_cycle();
    valve.advance(10);
    falls_silent(&mut valve, "the claim");
}

/// Answers that wait for the memory.
#[test]
fn what_waits_for_the_memory() {
    for request in ["18EA8327: CC FE 00", "1BC78883: 04 2E 10 01 84"] {
        let mut valve = Rig::with_two_previously_active();
        valve.write_time = Duration::from_millis(100);
        valve.send(request);
        falls_silent(&mut valve, request);
    }
}

/// A lost valve is commanded by nobody: fault 8, which no command can end, is not shown.
#[test]
fn no_time_guarding_without_an_address() {
    let mut valve = Rig::claimed();
    valve.send(EXTEND);
    valve.advance(300);
    assert_eq!(valve.outputs().led, Led::RED_FLASHING);
    valve.send(LOWER_NAME);
    valve.advance(5000);
    assert_eq!(valve.outputs().led, Led::YELLOW);
}
