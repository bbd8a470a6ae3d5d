//! The node ID and the COB-IDs: use case 6, what follows a change and what does not (SPEC 4.5, 8).

use tests::Rig;

/// How a node ID is changed: by LSS, or by UDS and a start.
const WAYS: [fn(&mut Rig, u8); 3] = [by_lss, by_uds_and_reset, by_uds_and_power];

fn by_lss(valve: &mut Rig, node_id: u8) {
    valve.send("7E5: 04 01 00 00 00 00 00 00");
    valve.send(&format!("7E5: 11 {node_id:02X} 00 00 00 00 00 00"));
    valve.send("7E5: 17 00 00 00 00 00 00 00");
    valve.send("7E5: 04 00 00 00 00 00 00 00");
}

fn by_uds(valve: &mut Rig, node_id: u8) {
    let id = 0x1BC7_8800 | u32::from(valve.node_id().unwrap());
    valve.exchange(&format!("{id:08X}: 04 2E 10 01 {node_id:02X}"), &["1BC408F1: 03 6E 10 01"]);
}

fn by_uds_and_reset(valve: &mut Rig, node_id: u8) {
    by_uds(valve, node_id);
    valve.send("000: 81 00");
}

fn by_uds_and_power(valve: &mut Rig, node_id: u8) {
    by_uds(valve, node_id);
    valve.power_cycle();
}

/// COB-IDs of EMCY, RPDO and TPDO.
fn cob_ids(valve: &mut Rig) -> [u32; 3] {
    [valve.read(0x1014, 0), valve.read(0x1400, 1), valve.read(0x1800, 1)]
}

/// The parameters of a valve that was never saved follow the node ID.
#[test]
fn never_saved_cob_ids_follow() {
    for change in WAYS {
        let mut valve = Rig::booted();
        assert_eq!(cob_ids(&mut valve), [0xA0, 0x220, 0x1A0]);
        change(&mut valve, 0x17);
        assert_eq!(valve.take_under("717"), ["717: 00"]);
        assert_eq!(cob_ids(&mut valve), [0x97, 0x217, 0x197]);
        valve.send("000: 01 00");
        valve.exchange("220: 0F 00 00 00", &[]);
        valve.exchange("217: 0F 00 00 00", &["197: 09 00 00 00"]);
    }
}

/// Saved ones are absolute numbers: they stay, until use case 6 is run. That of the EMCY always follows.
#[test]
fn saved_cob_ids_stay_until_use_case_6() {
    for change in WAYS {
        for restart in ["000: 81 00", ""] {
            let mut valve = Rig::booted();
            valve.exchange("620: 22 10 10 01 73 61 76 65", &["5A0: 60 10 10 01 00 00 00 00"]);
            change(&mut valve, 0x17);
            assert_eq!(valve.take_under("097").len(), 1);
            assert_eq!(cob_ids(&mut valve), [0x97, 0x220, 0x1A0]);
            valve.send("000: 01 00");
            valve.exchange("220: 0F 00 00 00", &["1A0: 09 00 00 00"]);

            valve.exchange("617: 22 11 10 01 6C 6F 61 64", &["597: 60 11 10 01 00 00 00 00"]);
            valve.exchange("617: 22 10 10 01 73 61 76 65", &["597: 60 10 10 01 00 00 00 00"]);
            if restart.is_empty() {
                valve.power_cycle();
            } else {
                valve.send(restart);
            }
            assert_eq!(valve.take(), ["717: 00", "097: 00 00 00 00 00 00 00 00"]);
            assert_eq!(cob_ids(&mut valve), [0x97, 0x217, 0x197]);
            // stored now, as absolute numbers again
            change(&mut valve, 0x18);
            valve.take();
            assert_eq!(cob_ids(&mut valve), [0x98, 0x217, 0x197]);
        }
    }
}

/// "load" gives the defaults for the node ID of the start that executes it.
#[test]
fn the_defaults_are_those_of_the_node_id_of_the_start() {
    for change in WAYS {
        let mut valve = Rig::booted();
        valve.exchange("620: 22 10 10 01 73 61 76 65", &["5A0: 60 10 10 01 00 00 00 00"]);
        valve.exchange("620: 22 11 10 01 6C 6F 61 64", &["5A0: 60 11 10 01 00 00 00 00"]);
        change(&mut valve, 0x17);
        valve.take();
        assert_eq!(cob_ids(&mut valve), [0x97, 0x217, 0x197]);
        valve.start_anew();
        assert_eq!(cob_ids(&mut valve), [0x97, 0x217, 0x197]);
    }
}

/// An ID by UDS is in force after a restart, a reset of the communication included (C), and not before.
#[test]
fn by_uds_it_is_in_force_after_a_restart() {
    for restart in ["000: 81 00", "000: 82 00"] {
        let mut valve = Rig::booted();
        by_uds(&mut valve, 0x17);
        assert_eq!((valve.node_id(), cob_ids(&mut valve)), (Some(0x20), [0xA0, 0x220, 0x1A0]));
        valve.exchange(restart, &["717: 00", "097: 00 00 00 00 00 00 00 00"]);
        assert_eq!(cob_ids(&mut valve), [0x97, 0x217, 0x197]);
    }
}

/// A later change by UDS wins over an ID that LSS configured and did not store.
#[test]
fn uds_after_an_id_that_is_held() {
    let mut valve = Rig::booted();
    valve.send_all(&["7E5: 04 01 00 00 00 00 00 00", "7E5: 11 17 00 00 00 00 00 00", "7E5: 04 00 00 00 00 00 00 00"]);
    valve.take();
    assert_eq!(valve.node_id(), Some(0x17));
    valve.exchange("1BC78817: 03 22 10 01", &["1BC0B8F1: 04 62 10 01 20"]);
    by_uds(&mut valve, 0x18);
    assert_eq!(valve.node_id(), Some(0x17));
    valve.exchange("000: 82 00", &["718: 00", "098: 00 00 00 00 00 00 00 00"]);
}
