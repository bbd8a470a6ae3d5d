//! The claim of the address: the wait after it, its defence, its loss and what is left then (SPEC 1, 5).

use std::collections::BTreeSet;

use protocol_core::actuator::Led;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::{AVEF_BLOCKED, BLOCK, CANNOT_CLAIM, CLAIM, DM1_CLEAR, EXTEND, HIGHER_NAME, LOWER_NAME, RETRACT};

/// How long a valve waits after its claim.
const WAIT_MS: u64 = 250;
/// The longest delay of a cannot-claim, in milliseconds.
const CANNOT_CLAIM_MAX: u64 = 153;

fn setup(address: u8) -> Setup {
    Setup { node_id: Some(address), ..Setup::new(Kind::PveaIsobus) }
}

/// A valve that lost its address when it had been claimed for a while; its cannot-claim is taken.
fn lost() -> Rig {
    let mut valve = Rig::claimed();
    valve.exchange(LOWER_NAME, &[]);
    valve.advance_sends(CANNOT_CLAIM_MAX, &[CANNOT_CLAIM]);
    valve
}

#[test]
fn every_address_of_both_kinds() {
    for kind in [Kind::PveaIsobus, Kind::PveoIsobus] {
        for address in 0x80..=0x8F_u8 {
            let mut valve = Rig::power_on(Setup { node_id: Some(address), ..Setup::new(kind) });
            valve.expect(&format!("18EEFF{address:02X}: 01 00 20 07 08 FF 02 20"));
            valve.advance_sends(250, &[&format!("0CFE1{:X}{address:02X}: 7D 7D 30 FF FF FF FF FF", address & 0xF)]);
        }
        for other in [None, Some(0x7F), Some(0x90), Some(0), Some(0xFE), Some(0xFF)] {
            let mut valve = Rig::power_on(Setup { node_id: other, ..Setup::new(kind) });
            valve.expect("18EEFF80: 01 00 20 07 08 FF 02 20");
        }
    }
}

/// The low 21 bits, beside them the low three of the manufacturer code.
#[test]
fn the_serial_number_in_the_name() {
    for (serial, name) in [
        (0, "00 00 20 07 08 FF 02 20"),
        (0x0012_3456, "56 34 32 07 08 FF 02 20"),
        (0x5B2E_0100, "00 01 2E 07 08 FF 02 20"),
        (0xFFFF_FFFF, "FF FF 3F 07 08 FF 02 20"),
    ] {
        let mut valve = Rig::power_on(Setup { serial: Some(serial), ..setup(0x8F) });
        valve.expect(&format!("18EEFF8F: {name}"));
    }
}

#[test]
fn nothing_but_claims_for_250_ms() {
    let mut valve = Rig::power_on(setup(0x83));
    valve.expect(CLAIM);
    for request in
        ["18EA8327: CA FE 00", "18EA8327: CB FE 00", "18EA8327: CC FE 00", "18EA8327: 13 FE 00", "18EA8327: 00 FF 00"]
    {
        valve.silent_to(&[request, &request.replace("EA83", "EAFF")]);
    }
    valve.silent_to(&["1BC78883: 03 22 F0 10", "1BC78883: 04 2E 10 01 84"]);
    // what is asked of it about the claim itself is told
    valve.exchange("18EA8327: 00 EE 00", &[CLAIM]);
    valve.exchange("18EAFF27: 00 EE 00", &[CLAIM]);
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.silent_until(WAIT_MS, &[AVEF_BLOCKED, "18FECA83: 10 FF FA 8F 8B 01 FF FF"]);
    valve.exchange("1BC78883: 03 22 10 01", &["1BC418F1: 04 62 10 01 83"]);
}

#[test]
fn commands_act_within_the_wait() {
    let mut valve = Rig::power_on(setup(0x83));
    valve.expect(CLAIM);
    valve.send(EXTEND);
    valve.advance(200);
    valve.send(EXTEND);
    valve.advance_sends(50, &["0CFE1383: E1 7D 31 FF FF FF FF FF"]);
}

/// The guard begins with the first command, within the wait as well.
#[test]
fn time_guarding_within_the_wait() {
    let mut valve = Rig::power_on(setup(0x83));
    valve.expect(CLAIM);
    valve.send(BLOCK);
    valve.silent_until(WAIT_MS, &[AVEF_BLOCKED, "18FECA83: 04 FF E9 8F 93 01 FF FF"]);
}

/// The claim does not reach a bus that is busy, or off: the wait has not begun.
#[test]
fn the_wait_counts_from_the_claim_on_the_bus() {
    for ms in [1, 100, 249, 250, 251, 300, 5000] {
        let mut valve = Rig::claimed();
        valve.hold_bus(true);
        valve.power_cycle();
        valve.silent_for(ms);
        valve.hold_bus(false);
        valve.expect(CLAIM);
        valve.silent_until(WAIT_MS, &[AVEF_BLOCKED]);

        let mut valve = Rig::claimed();
        valve.sense(|inputs| inputs.bus = BusErrorMode::BusOff);
        valve.power_cycle();
        valve.silent_for(ms);
        valve.sense(|inputs| inputs.bus = BusErrorMode::ErrorActive);
        valve.expect(CLAIM);
        valve.silent_until(WAIT_MS, &[AVEF_BLOCKED, DM1_CLEAR]);
    }
}

/// Claims of the same address by NAMEs that are higher: the first bytes count least.
const HIGHER: [&str; 5] = [
    "18EEFF83: 02 00 20 07 08 FF 02 20",
    "18EEFF83: 01 01 20 07 08 FF 02 20",
    "18EEFF83: 00 00 00 00 00 00 00 21",
    "18EEFF83: 00 00 00 00 00 00 00 A0",
    "18EEFF83: FF FF FF FF FF FF FF FF",
];

/// The same by NAMEs that are lower.
const LOWER: [&str; 5] = [
    "18EEFF83: 00 00 20 07 08 FF 02 20",
    "18EEFF83: 00 FF 1F 07 08 FF 02 20",
    "18EEFF83: FF FF FF FF FF FF 01 20",
    "18EEFF83: FF FF FF FF FF FF FF 1F",
    "18EEFF83: 00 00 00 00 00 00 00 00",
];

#[test]
fn a_higher_name_is_answered_by_a_claim() {
    for claim in HIGHER {
        let mut valve = Rig::claimed();
        valve.exchange(claim, &[CLAIM]);
        // and nothing is waited for
        valve.exchange("18EA8327: CA FE 00", &[DM1_CLEAR]);
        valve.advance_sends(100, &[AVEF_BLOCKED]);
    }
}

#[test]
fn a_defence_within_the_wait_does_not_prolong_it() {
    for claim in HIGHER {
        let mut valve = Rig::power_on(setup(0x83));
        valve.expect(CLAIM);
        valve.advance(200);
        valve.exchange(claim, &[CLAIM]);
        valve.silent_until(50, &[AVEF_BLOCKED]);
    }
}

#[test]
fn a_lower_name_takes_the_address() {
    for claim in LOWER {
        for waited in [0, 249, 250, 1000] {
            let mut valve = Rig::power_on(setup(0x83));
            valve.expect(CLAIM);
            valve.advance(waited);
            valve.take();
            valve.exchange(claim, &[]);
            assert_eq!(valve.node_id(), None);
            valve.advance(CANNOT_CLAIM_MAX);
            valve.expect(CANNOT_CLAIM);
            valve.silent_for(10_000);
        }
    }
}

#[test]
fn what_is_no_contention() {
    for claim in [
        // its own NAME: a twin, or its own frame
        CLAIM,
        // other addresses, and somebody who has none
        "18EEFF82: 00 00 00 00 00 00 00 00",
        "18EEFF93: 00 00 00 00 00 00 00 00",
        "18EEFFFE: 00 00 00 00 00 00 00 00",
        // no NAME
        "18EEFF83: 00 00 00 00 00 00 00",
        "18EEFF83:",
        "18EEFF83: R8",
    ] {
        let mut valve = Rig::claimed();
        for _ in 0..20 {
            valve.exchange(claim, &[]);
        }
        assert_eq!(valve.node_id(), Some(0x83), "{claim}");
        valve.advance_sends(100, &[AVEF_BLOCKED]);
    }
}

/// Other groups, by the pages and by the format, are no claims; but somebody sends under the valve's address.
#[test]
fn other_groups_are_no_contention() {
    for frame in [
        "19EEFF83: 00 00 00 00 00 00 00 00",
        "1AEEFF83: 00 00 00 00 00 00 00 00",
        "18EFFF83: 00 00 00 00 00 00 00 00",
        "18EDFF83: 00 00 00 00 00 00 00 00",
    ] {
        let mut valve = Rig::claimed();
        valve.exchange(frame, &[CLAIM]);
        for _ in 0..20 {
            valve.exchange(frame, &[]);
        }
        assert_eq!(valve.node_id(), Some(0x83), "{frame}");
    }
}

/// Of any priority: that is no part of the group.
#[test]
fn contention_of_another_priority() {
    for claim in ["00EEFF83: 02 00 20 07 08 FF 02 20", "1CEEFF83: 02 00 20 07 08 FF 02 20"] {
        Rig::claimed().exchange(claim, &[CLAIM]);
    }
}

/// Takes the address away; how long the cannot-claim takes, in microseconds.
#[track_caller]
fn cannot_claim_delay(valve: &mut Rig) -> u64 {
    valve.send(LOWER_NAME);
    let since = valve.now();
    while valve.now() - since <= Duration::from_millis(CANNOT_CLAIM_MAX) {
        match valve.take().as_slice() {
            [] => valve.advance_by(valve.device().deadline() - valve.now()),
            sent => {
                assert!(sent.len() == 1 && sent[0].starts_with("18EEFFFE: "), "{sent:?}");
                return (valve.now() - since).as_micros();
            }
        }
    }
    panic!("no cannot-claim");
}

#[test]
fn cannot_claim_comes_after_a_pseudo_random_time() {
    let mut delays = BTreeSet::new();
    for at in 0..200 {
        let mut valve = Rig::claimed();
        valve.advance_by(Duration::from_micros(137 * at));
        valve.take();
        delays.insert(cannot_claim_delay(&mut valve));
    }
    assert!(delays.len() > 50, "{} different delays", delays.len());
    assert!(*delays.first().unwrap() < 20_000 && *delays.last().unwrap() > 130_000, "{delays:?}");
}

/// Two valves that lose at the same time do not meet.
#[test]
fn the_delay_depends_on_the_name() {
    let mut delays = BTreeSet::new();
    for serial in 1..=50 {
        let mut valve = Rig::claimed_as(Setup { serial: Some(serial), ..setup(0x83) });
        delays.insert(cannot_claim_delay(&mut valve));
    }
    assert!(delays.len() > 25, "{delays:?}");
}

#[test]
fn a_lost_valve_is_silent() {
    let mut valve = lost();
    for frame in [
        // requests to the address that is another's, of all that is there; and to all
        "18EA8327: 00 EE 00",
        "18EA8327: CA FE 00",
        "18EA8327: CB FE 00",
        "18EA8327: CC FE 00",
        "18EA8327: 13 FE 00",
        "18EA8327: 00 FF 00",
        "18EAFF27: CA FE 00",
        "18EAFF27: CB FE 00",
        "18EAFF27: CC FE 00",
        "18EAFF27: 13 FE 00",
        // UDS
        "1BC78883: 03 22 F0 10",
        "1BC78883: 04 2E 10 01 84",
        // claims of the address, whoever wins
        LOWER_NAME,
        HIGHER_NAME,
        CLAIM,
        // commands
        EXTEND,
        BLOCK,
    ] {
        valve.exchange(frame, &[]);
        valve.silent_for(300);
    }
    // whatever goes wrong
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.advance(5000);
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.silent_for(5000);
    assert_eq!(valve.node_id(), None);
    // nothing was written by UDS
    valve.power_cycle();
    assert_eq!(valve.node_id(), Some(0x83));
    valve.expect(CLAIM);
}

#[test]
fn a_lost_valve_answers_requests_to_all_for_its_claim() {
    let mut valve = lost();
    for _ in 0..10 {
        valve.exchange("18EAFF27: 00 EE 00", &[]);
        valve.advance(CANNOT_CLAIM_MAX);
        valve.expect(CANNOT_CLAIM);
        valve.silent_for(1000);
    }
    // two that come while one is owed are answered at once
    valve.send_all(&["18EAFF27: 00 EE 00", "18EAFF28: 00 EE 00"]);
    valve.advance(CANNOT_CLAIM_MAX);
    valve.expect(CANNOT_CLAIM);
    valve.silent_for(1000);
}

/// One request more does not put the answer off.
#[test]
fn many_requests_to_a_lost_valve() {
    let mut valve = lost();
    for round in 0..20 {
        for _ in 0..=CANNOT_CLAIM_MAX {
            valve.send("18EAFF27: 00 EE 00");
            valve.advance(1);
        }
        assert!(valve.take().contains(&CANNOT_CLAIM.to_string()), "round {round}");
    }
}

#[test]
fn a_lost_valve_is_blocked_and_takes_no_command() {
    let mut valve = Rig::extending(400);
    assert_eq!(valve.flow(), [0xE1, 0x7D, 0x31]);
    valve.send(LOWER_NAME);
    valve.advance(100);
    for _ in 0..10 {
        valve.send(RETRACT);
        valve.advance(100);
    }
    let outputs = valve.outputs();
    assert_eq!((outputs.solenoids, outputs.led), (false, Led::YELLOW));
    assert_eq!(valve.take_under("18EEFFFE").len(), 1);
    // under a new address it is in neutral, and no guard has missed anything
    valve.command_address(0x84, 0x27);
    valve.expect("18EEFF84: 01 00 20 07 08 FF 02 20");
    valve.advance(250);
    valve.expect("0CFE1484: 7D 7D 30 FF FF FF FF FF");
    valve.advance_news(2000, &[]);
    valve.exchange("18EA8427: CB FE 00", &["18FECB84: 00 FF 00 00 00 00 FF FF"]);
}

#[test]
fn a_restart_claims_the_lost_address_again() {
    let mut valve = lost();
    valve.restart();
    assert_eq!(valve.node_id(), Some(0x83));
    valve.watchdog_reset();
    valve.expect(CLAIM);
}

/// However many claim, each is answered, and the rest goes on.
#[test]
fn a_storm_of_claims() {
    let mut valve = Rig::claimed();
    for _ in 0..1000 {
        valve.exchange(HIGHER_NAME, &[CLAIM]);
        valve.exchange("18EAFF27: 00 EE 00", &[CLAIM]);
        valve.exchange("18EA8328: 00 EE 00", &[CLAIM]);
    }
    valve.advance_sends(100, &[AVEF_BLOCKED]);
}
