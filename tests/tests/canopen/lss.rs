//! LSS, where the valves have rules of their own: what leaving configuration does (SPEC 4.4, 4.5).

use protocol_core::controller::BitRate;
use protocol_core::time::Duration;
use tests::Rig;
use tests::lss::{STORE, STORED, TO_CONFIGURATION, TO_WAITING, activate};

use super::blank;

const BOOT_AS_17: [&str; 2] = ["717: 00", "097: 00 00 00 00 00 00 00 00"];

/// A valve in pre-operational and LSS configuration.
fn configuring() -> Rig {
    let mut valve = Rig::booted();
    valve.exchange(TO_CONFIGURATION, &[]);
    valve
}

/// Identify remote slave is no service of the valve (SPEC 4.4): six bounds that all hold are not answered.
#[test]
fn identify_remote_slave_is_not_answered() {
    const HOLDS: [&str; 6] =
        ["46 19 00 00 01", "47 00 00 36 53", "48 20 00 01 00", "49 20 00 01 00", "4A 00 01 2E 5B", "4B 00 01 2E 5B"];
    for state in [TO_WAITING, TO_CONFIGURATION] {
        for order in ["000: 80 00", "000: 02 00", "000: 01 00"] {
            for mut valve in [Rig::booted(), blank()] {
                valve.silent_to(&[order, state]);
                HOLDS.iter().for_each(|bound| valve.lss(bound, None));
            }
        }
    }
}

/// Orders are obeyed during the silence of an activation; a start drops nothing that is on its way.
#[test]
fn a_start_during_the_silence() {
    let mut valve = configuring();
    valve.configure_bit_rate(2);
    valve.silent_to(&[&activate(100), "000: 01 00", "220: 01 00 00 00"]);
    valve.advance(200);
    assert_eq!(valve.bit_rates(), [BitRate::Kbit500]);
    valve.exchange("220: 01 00 00 00", &["1A0: 09 00 00 00"]);
}

#[test]
fn leaving_with_a_changed_node_id_restarts_as_after_reset_application() {
    let mut valve = Rig::booted();
    valve.write_all(&[(0x6040, 0, 2, 1), (0x6042, 0, 1, 2)]);
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.configure_node_id(0x17);
    valve.exchange(TO_WAITING, &BOOT_AS_17);
    assert_eq!((valve.status(), valve.read(0x6042, 0), valve.read(0x6040, 0)), (0x08, 1, 0));
    assert_eq!((valve.read(0x1014, 0), valve.read(0x1400, 1), valve.read(0x1800, 1)), (0x97, 0x217, 0x197));
    valve.exchange("620: 40 00 10 00 00 00 00 00", &[]);
    assert!(!valve.is_configuring());
}

#[test]
fn leaving_without_a_change_does_nothing() {
    for requests in [&[][..], &["11 20"], &["11 20", "17"], &["13 00 02"], &["5E"], &["11 17", "11 20"]] {
        let mut valve = Rig::booted();
        valve.write_all(&[(0x6040, 0, 2, 1)]);
        valve.exchange(TO_CONFIGURATION, &[]);
        for request in requests {
            valve.send(&tests::lss::request(request));
        }
        valve.take();
        valve.exchange(TO_WAITING, &[]);
        assert_eq!(valve.status(), 0x09, "{requests:?}");
        assert!(!valve.is_configuring());
    }
}

/// A later ID, not stored, wins over the one whose write was still under way.
#[test]
fn an_id_configured_while_another_is_being_stored() {
    let mut valve = configuring();
    valve.write_time = Duration::from_millis(30);
    valve.configure_node_id(0x18);
    valve.exchange(STORE, &[]);
    valve.configure_node_id(0x17);
    valve.exchange(TO_WAITING, &[]);
    valve.advance_sends(30, &[STORED, BOOT_AS_17[0], BOOT_AS_17[1]]);
    valve.power_cycle();
    assert_eq!(valve.node_id(), Some(0x18));
}

/// A valve without a node ID gets one that is not stored, and boots.
#[test]
fn an_id_that_is_not_stored_is_enough_to_boot() {
    let mut valve = blank();
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.configure_node_id(0x17);
    valve.exchange(TO_WAITING, &BOOT_AS_17);
    assert_eq!(valve.status(), 0x08);
    assert_eq!((valve.read(0x1400, 1), valve.read(0x1800, 1)), (0x217, 0x197));
    valve.power_cycle();
    assert_eq!(valve.node_id(), None);
}

/// The first write of a new memory may last: the ID that came meanwhile is not lost.
#[test]
fn an_id_configured_during_the_first_write() {
    let mut valve = blank();
    valve.records.clear();
    valve.write_time = Duration::from_millis(100);
    valve.power_cycle();
    valve.exchange(TO_CONFIGURATION, &[]);
    valve.configure_node_id(0x17);
    valve.exchange(TO_WAITING, &[]);
    valve.advance_sends(200, &BOOT_AS_17);
}
