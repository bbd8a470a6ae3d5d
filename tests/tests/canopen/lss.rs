//! LSS: every service in every LSS and NMT state, and what each comes to (SPEC 4.4).

use protocol_core::device::pve::{Kind, Setup};
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::Rig;

const BOOT: [&str; 2] = ["720: 00", "0A0: 00 00 00 00 00 00 00 00"];
const BOOT_AS_17: [&str; 2] = ["717: 00", "097: 00 00 00 00 00 00 00 00"];

/// The switch selective of the manual's use case 4.
const SELECT: [&str; 4] = ["40 19 00 00 01", "41 00 00 36 53", "42 20 00 01 00", "43 00 01 2E 5B"];
const SELECTED: &str = "44 00 00 00 00";

const STATES: [Nmt; 4] = [Nmt::PreOperational, Nmt::Stopped, Nmt::Operational, Nmt::NoNodeId];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Nmt {
    PreOperational,
    Stopped,
    Operational,
    NoNodeId,
}

fn blank() -> Rig {
    let mut valve = Rig::power_on(Setup { node_id: None, ..Setup::new(Kind::PveaCanopen) });
    valve.expect_nothing();
    valve
}

fn valve_in(nmt: Nmt) -> Rig {
    let mut valve = if nmt == Nmt::NoNodeId { blank() } else { Rig::booted() };
    match nmt {
        Nmt::Stopped => valve.send("000: 02 00"),
        Nmt::Operational => valve.send("000: 01 00"),
        Nmt::PreOperational | Nmt::NoNodeId => {}
    }
    valve.expect_nothing();
    valve
}

/// A valve in pre-operational and LSS configuration.
fn configuring() -> Rig {
    let mut valve = Rig::booted();
    lss(&mut valve, "04 01", None);
    valve
}

/// Sends a request, filled with zeros; the answer must be this one, given as its first five bytes.
#[track_caller]
fn lss(valve: &mut Rig, request: &str, answer: Option<&str>) {
    let zeros = " 00".repeat(8 - request.split(' ').count());
    let answer = answer.map(|answer| format!("7E4: {answer} 00 00 00"));
    let answers: Vec<&str> = answer.as_deref().into_iter().collect();
    valve.exchange(&format!("7E5: {request}{zeros}"), &answers);
}

#[track_caller]
fn is_configuring(valve: &mut Rig) -> bool {
    valve.send("7E5: 5E 00 00 00 00 00 00 00");
    !valve.take().is_empty()
}

/// A service: request, answer in configuration with and without a node ID.
const SERVICES: [(&str, Option<&str>, Option<&str>); 30] = [
    ("04 00", None, None),
    ("04 01", None, None),
    ("04 02", None, None),
    ("04 FF", None, None),
    (SELECT[0], None, None),
    (SELECT[1], None, None),
    (SELECT[2], None, None),
    (SELECT[3], None, None),
    ("11 17", Some("11 00 00 00 00"), Some("11 00 00 00 00")),
    ("11 00", Some("11 01 00 00 00"), Some("11 01 00 00 00")),
    ("11 80", Some("11 01 00 00 00"), Some("11 01 00 00 00")),
    ("11 FF", Some("11 01 00 00 00"), Some("11 01 00 00 00")),
    ("13 00 02", Some("13 00 00 00 00"), Some("13 00 00 00 00")),
    ("13 00 01", Some("13 01 00 00 00"), Some("13 01 00 00 00")),
    ("13 01 02", Some("13 01 00 00 00"), Some("13 01 00 00 00")),
    ("15 00 00", None, None),
    ("17", Some("17 00 00 00 00"), Some("17 00 00 00 00")),
    ("5A", Some("5A 19 00 00 01"), Some("5A 19 00 00 01")),
    ("5B", Some("5B 00 00 36 53"), Some("5B 00 00 36 53")),
    ("5C", Some("5C 20 00 01 00"), Some("5C 20 00 01 00")),
    ("5D", Some("5D 00 01 2E 5B"), Some("5D 00 01 2E 5B")),
    ("5E", Some("5E 20 00 00 00"), Some("5E FF 00 00 00")),
    ("4C", None, Some("50 00 00 00 00")),
    ("51 00 00 00 00 80 00 00", None, Some("4F 00 00 00 00")),
    // what is a slave's own, and what this slave does not know
    (SELECTED, None, None),
    ("4F", None, None),
    ("50", None, None),
    ("46 19 00 00 01", None, None),
    ("00", None, None),
    ("FF", None, None),
];

#[test]
fn every_service_in_every_lss_and_nmt_state() {
    for (request, with_node_id, without) in SERVICES {
        for nmt in STATES {
            for configuration in [false, true] {
                let mut valve = valve_in(nmt);
                if configuration {
                    lss(&mut valve, "04 01", None);
                }
                let expected = match nmt {
                    Nmt::Operational => None,
                    _ if !configuration => None,
                    Nmt::NoNodeId => without,
                    Nmt::PreOperational | Nmt::Stopped => with_node_id,
                };
                lss(&mut valve, request, expected);
                let stays = match request {
                    "04 00" => false,
                    "04 01" => true,
                    _ => configuration,
                };
                let what = format!("{request}, {nmt:?}, configuration: {configuration}");
                assert_eq!(is_configuring(&mut valve), stays && nmt != Nmt::Operational, "{what}");
            }
        }
    }
}

#[test]
fn other_lengths_and_remote_frames_are_ignored() {
    for request in ["7E5: 5E", "7E5: 5E 00 00 00 00 00 00", "7E5:", "7E5: R8", "7E4: 5E 00 00 00 00 00 00 00"] {
        configuring().exchange(request, &[]);
    }
    configuring().exchange("000007E5: 5E 00 00 00 00 00 00 00", &[]);
}

/// What is sent to a valve in waiting, by number of the part, `x` for another number; whether it is selected at the
/// end.
const SELECTIONS: [(&str, bool); 20] = [
    ("0 1 2 3", true),
    ("0 1 2", false),
    ("1 2 3", false),
    ("0 1 3", false),
    ("0 2 1 3", false),
    ("3 2 1 0", false),
    ("x0 1 2 3", false),
    ("0 x1 2 3", false),
    ("0 1 x2 3", false),
    ("0 1 2 x3", false),
    // a mismatch starts over
    ("0 1 2 x3 3", false),
    ("0 1 x2 2 3", false),
    ("0 x1 0 1 2 3", true),
    ("x0 0 1 2 3", true),
    ("0 1 2 x3 0 1 2 3", true),
    ("0 1 0 1 2 3", true),
    ("0 0 1 2 3", true),
    ("0 1 1 2 3", false),
    // another slave is selected meanwhile
    ("0 x0 1 2 3", false),
    ("0 1 2 x0 x1 x2 x3 3", false),
];

#[test]
fn switch_selective() {
    for (selection, selected) in SELECTIONS {
        for nmt in STATES {
            let mut valve = valve_in(nmt);
            let selected = selected && nmt != Nmt::Operational;
            let steps: Vec<&str> = selection.split(' ').collect();
            for (position, step) in steps.iter().enumerate() {
                let part: usize = step.trim_start_matches('x').parse().unwrap();
                let request = if step.starts_with('x') {
                    format!("{} FF FF FF FF", &SELECT[part][..2])
                } else {
                    SELECT[part].to_owned()
                };
                let last = position + 1 == steps.len();
                lss(&mut valve, &request, (last && selected).then_some(SELECTED));
            }
            assert_eq!(is_configuring(&mut valve), selected, "{selection}, {nmt:?}");
        }
    }
}

/// Leaving to waiting forgets how far a selection has come; requests that waiting does not allow, and other services do
/// not.
#[test]
fn what_comes_between_a_switch_selective() {
    for (between, selected) in [("04 00", false), ("17", true), ("5A", true)] {
        let mut valve = Rig::booted();
        lss(&mut valve, SELECT[0], None);
        lss(&mut valve, SELECT[1], None);
        lss(&mut valve, between, None);
        assert_eq!(valve.read(0x1018, 4), 0x5B2E_0100);
        lss(&mut valve, SELECT[2], None);
        lss(&mut valve, SELECT[3], selected.then_some(SELECTED));
    }
}

/// Identify remote slave is no service of the valve (SPEC 4.4): six bounds that all hold are not answered.
#[test]
fn identify_remote_slave_is_not_answered() {
    const HOLDS: [&str; 6] =
        ["46 19 00 00 01", "47 00 00 36 53", "48 20 00 01 00", "49 20 00 01 00", "4A 00 01 2E 5B", "4B 00 01 2E 5B"];
    for nmt in STATES {
        for state in ["04 00", "04 01"] {
            let mut valve = valve_in(nmt);
            for request in [state].iter().chain(&HOLDS) {
                lss(&mut valve, request, None);
            }
        }
    }
}

#[test]
fn node_ids_1_to_127_are_taken() {
    for node_id in 0..=255_u8 {
        let mut valve = configuring();
        let valid = (1..=127).contains(&node_id);
        lss(&mut valve, &format!("11 {node_id:02X}"), Some(if valid { "11 00 00 00 00" } else { "11 01 00 00 00" }));
        lss(&mut valve, "5E", Some("5E 20 00 00 00"));
        lss(&mut valve, "17", Some("17 00 00 00 00"));
        valve.power_cycle();
        assert_eq!(valve.node_id(), Some(if valid { node_id } else { 0x20 }));
    }
}

/// An ID that is refused leaves the one that is pending alone.
#[test]
fn a_refused_node_id_changes_nothing() {
    let mut valve = configuring();
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    lss(&mut valve, "11 80", Some("11 01 00 00 00"));
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
}

#[test]
fn leaving_with_a_changed_node_id_restarts_as_after_reset_application() {
    let mut valve = Rig::booted();
    valve.write(0x6040, 0, 2, 1).unwrap();
    valve.write(0x6042, 0, 1, 2).unwrap();
    lss(&mut valve, "04 01", None);
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
    assert_eq!((valve.status(), valve.read(0x6042, 0), valve.read(0x6040, 0)), (0x08, 1, 0));
    assert_eq!((valve.read(0x1014, 0), valve.read(0x1400, 1), valve.read(0x1800, 1)), (0x97, 0x217, 0x197));
    valve.exchange("620: 40 00 10 00 00 00 00 00", &[]);
    assert!(!is_configuring(&mut valve));
}

#[test]
fn leaving_without_a_change_does_nothing() {
    let nothing: &[&str] = &[];
    let same = ["11 20"];
    let stored = ["11 20", "17"];
    let rate = ["13 00 02"];
    for requests in [nothing, &same, &stored, &rate, &["5E"], &["11 17", "11 20"]] {
        let mut valve = Rig::booted();
        valve.write(0x6040, 0, 2, 1).unwrap();
        lss(&mut valve, "04 01", None);
        for request in requests {
            valve.send(&format!("7E5: {request}{}", " 00".repeat(8 - request.split(' ').count())));
        }
        valve.take();
        valve.exchange("7E5: 04 00 00 00 00 00 00 00", &[]);
        assert_eq!(valve.status(), 0x09, "{requests:?}");
        assert!(!is_configuring(&mut valve));
    }
}

/// What is not stored is held until power-off, resets included.
#[test]
fn a_node_id_that_is_not_stored_is_held_until_power_off() {
    let mut valve = configuring();
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
    for _ in 0..2 {
        valve.exchange("000: 81 00", &BOOT_AS_17);
        valve.exchange("000: 82 00", &BOOT_AS_17);
    }
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT);
}

/// And one that is stored stays, whether it was stored while pending or in force.
#[test]
fn a_node_id_that_is_stored_stays() {
    let mut valve = configuring();
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    lss(&mut valve, "17", Some("17 00 00 00 00"));
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT_AS_17);

    let mut valve = configuring();
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
    lss(&mut valve, "04 01", None);
    lss(&mut valve, "17", Some("17 00 00 00 00"));
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT_AS_17);
}

/// Stored, but configuration never left: in force after the next reset, communication included.
#[test]
fn a_stored_node_id_is_taken_over_by_every_reset() {
    for reset in ["000: 81 00", "000: 82 00"] {
        let mut valve = configuring();
        lss(&mut valve, "11 17", Some("11 00 00 00 00"));
        lss(&mut valve, "17", Some("17 00 00 00 00"));
        valve.exchange(reset, &BOOT_AS_17);
    }
    // pending and not stored
    for (reset, boot) in [("000: 81 00", BOOT), ("000: 82 00", BOOT_AS_17)] {
        let mut valve = configuring();
        lss(&mut valve, "11 17", Some("11 00 00 00 00"));
        valve.exchange(reset, &boot);
        assert!(!is_configuring(&mut valve));
    }
}

#[test]
fn nmt_start_leaves_configuration_and_drops_what_is_pending() {
    let mut valve = configuring();
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    lss(&mut valve, "13 00 02", Some("13 00 00 00 00"));
    valve.exchange("000: 01 00", &[]);
    valve.exchange("000: 80 00", &[]);
    assert!(!is_configuring(&mut valve));
    lss(&mut valve, "04 01", None);
    lss(&mut valve, "17", Some("17 00 00 00 00"));
    lss(&mut valve, "04 00", None);
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT);
    assert_eq!(valve.device().bit_rate().bits_per_second(), 250_000);
}

/// The master is answered in operational too, and what it asked for is stored.
#[test]
fn a_store_that_nmt_start_comes_into() {
    for memory_is_busy in [false, true] {
        let mut valve = configuring();
        valve.write_time = Duration::from_millis(30);
        lss(&mut valve, "11 17", Some("11 00 00 00 00"));
        lss(&mut valve, "13 00 02", Some("13 00 00 00 00"));
        if memory_is_busy {
            valve.exchange("620: 23 10 10 01 73 61 76 65", &[]);
        }
        lss(&mut valve, "17", None);
        valve.exchange("000: 01 00", &[]);
        valve.advance(100);
        let sent = valve.take();
        assert!(sent.contains(&"7E4: 17 00 00 00 00 00 00 00".to_owned()), "{sent:?}");
        valve.power_cycle();
        assert_eq!(valve.take(), BOOT_AS_17, "busy: {memory_is_busy}");
        assert_eq!(valve.device().bit_rate().bits_per_second(), 500_000);
    }
}

/// A number that is configured after the store was asked for is not part of it.
#[test]
fn a_store_stores_what_was_configured_when_it_was_asked_for() {
    let mut valve = configuring();
    valve.write_time = Duration::from_millis(30);
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    valve.exchange("620: 23 10 10 01 73 61 76 65", &[]);
    lss(&mut valve, "17", None);
    lss(&mut valve, "11 18", Some("11 00 00 00 00"));
    valve.advance(100);
    valve.take();
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT_AS_17);
}

#[test]
fn stop_and_pre_operational_leave_configuration_alone() {
    for order in ["000: 02 00", "000: 80 00"] {
        let mut valve = configuring();
        lss(&mut valve, "11 17", Some("11 00 00 00 00"));
        valve.exchange(order, &[]);
        valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
    }
}

#[test]
fn a_reset_leaves_configuration() {
    for order in ["000: 81 00", "000: 82 00"] {
        let mut valve = configuring();
        valve.exchange(order, &BOOT);
        assert!(!is_configuring(&mut valve));
    }
}

/// Answered when the memory holds the data, with error 2 when it fails; then the internal error too.
#[test]
fn store_is_answered_when_the_memory_holds_it() {
    let mut valve = configuring();
    valve.write_time = Duration::from_millis(30);
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    lss(&mut valve, "17", None);
    valve.advance(29);
    valve.expect_nothing();
    valve.advance(1);
    assert_eq!(valve.take(), ["7E4: 17 00 00 00 00 00 00 00"]);
    assert_eq!(valve.writes.last(), Some(&RecordKey::LocalLayer));

    valve.writes_fail = true;
    lss(&mut valve, "17", None);
    valve.advance(30);
    let mut sent = valve.take();
    sent.sort();
    assert_eq!(sent, ["0A0: 00 10 01 01 00 00 00 00", "7E4: 17 02 00 00 00 00 00 00"]);
    valve.writes_fail = false;
    lss(&mut valve, "17", None);
    valve.advance(30);
    let mut sent = valve.take();
    sent.sort();
    assert_eq!(sent, ["0A0: 00 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00"]);
}

/// A later ID, not stored, wins over the one whose write was still under way.
#[test]
fn an_id_configured_while_another_is_being_stored() {
    let mut valve = configuring();
    valve.write_time = Duration::from_millis(30);
    lss(&mut valve, "11 18", Some("11 00 00 00 00"));
    lss(&mut valve, "17", None);
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    lss(&mut valve, "04 00", None);
    valve.advance(30);
    assert_eq!(valve.take(), ["7E4: 17 00 00 00 00 00 00 00", BOOT_AS_17[0], BOOT_AS_17[1]]);
    valve.power_cycle();
    assert_eq!(valve.node_id(), Some(0x18));
}

/// A store without a node ID configured leaves the stored one alone, and so with the bit rate.
#[test]
fn store_stores_what_was_configured() {
    // UDS has stored another node ID, which is not in force yet
    let mut valve = Rig::booted();
    valve.exchange("1BC78820: 04 2E 10 01 17", &["1BC408F1: 03 6E 10 01"]);
    lss(&mut valve, "04 01", None);
    lss(&mut valve, "13 00 02", Some("13 00 00 00 00"));
    lss(&mut valve, "17", Some("17 00 00 00 00"));
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT_AS_17);
    assert_eq!(valve.device().bit_rate().bits_per_second(), 500_000);

    // a bit rate was stored, which is not in force yet
    let mut valve = configuring();
    lss(&mut valve, "13 00 02", Some("13 00 00 00 00"));
    lss(&mut valve, "17", Some("17 00 00 00 00"));
    valve.exchange("000: 01 00", &[]);
    valve.exchange("000: 80 00", &[]);
    lss(&mut valve, "04 01", None);
    lss(&mut valve, "11 17", Some("11 00 00 00 00"));
    lss(&mut valve, "17", Some("17 00 00 00 00"));
    valve.power_cycle();
    assert_eq!(valve.take(), BOOT_AS_17);
    assert_eq!(valve.device().bit_rate().bits_per_second(), 500_000);
}

mod without_a_node_id {
    use super::*;

    #[test]
    fn it_gets_one_and_boots() {
        for stored in [false, true] {
            let mut valve = blank();
            lss(&mut valve, "04 01", None);
            lss(&mut valve, "11 17", Some("11 00 00 00 00"));
            if stored {
                lss(&mut valve, "17", Some("17 00 00 00 00"));
            }
            valve.exchange("7E5: 04 00 00 00 00 00 00 00", &BOOT_AS_17);
            assert_eq!(valve.status(), 0x08);
            assert_eq!((valve.read(0x1400, 1), valve.read(0x1800, 1)), (0x217, 0x197));
            valve.power_cycle();
            assert_eq!(valve.node_id(), stored.then_some(0x17));
        }
    }

    /// A pending node ID counts as configured.
    #[test]
    fn identify_only_while_none_is_pending() {
        let mut valve = blank();
        lss(&mut valve, "04 01", None);
        lss(&mut valve, "4C", Some("50 00 00 00 00"));
        lss(&mut valve, "11 17", Some("11 00 00 00 00"));
        lss(&mut valve, "4C", None);
        lss(&mut valve, "51 00 00 00 00 80 00 00", None);
        lss(&mut valve, "5E", Some("5E FF 00 00 00"));
    }

    #[test]
    fn leaving_without_one_changes_nothing() {
        let mut valve = blank();
        lss(&mut valve, "04 01", None);
        lss(&mut valve, "17", Some("17 00 00 00 00"));
        lss(&mut valve, "04 00", None);
        assert_eq!(valve.node_id(), None);
        valve.power_cycle();
        valve.expect_nothing();
    }

    /// The first write of a new memory may last: the ID that came meanwhile is not lost.
    #[test]
    fn an_id_configured_during_the_first_write() {
        let mut valve = blank();
        valve.records.clear();
        valve.write_time = Duration::from_millis(100);
        valve.power_cycle();
        lss(&mut valve, "04 01", None);
        lss(&mut valve, "11 17", Some("11 00 00 00 00"));
        lss(&mut valve, "04 00", None);
        valve.advance(200);
        assert_eq!(valve.take(), BOOT_AS_17);
    }
}
