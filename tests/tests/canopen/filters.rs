//! What a device tells its controller to let through: all that it listens to, and little else.

use protocol_core::controller::Filters;
use tests::lss;
use tests::{Rig, frame};

/// Whether a frame of each of these identifiers is let through.
#[track_caller]
fn expect(filters: &Filters, passing: &[&str], kept_away: &[&str]) {
    let passes = |text: &str| filters.iter().any(|filter| filter.passes(&frame(text)));
    for text in passing {
        assert!(passes(text), "{text} is kept away by {filters:08X?}");
    }
    for text in kept_away {
        assert!(!passes(text), "{text} passes {filters:08X?}");
    }
}

#[test]
fn a_valve_on_canopen_listens_to_seven_identifiers() {
    let rig = Rig::booted();
    let own = ["000: 01 00", "080:", "220: 0F 00 00 00", "620: 40", "7E5: 04 00", "1BC78820: 03 22 10 01"];
    let others = [
        "001:",
        "0A0:",
        "1A0:",
        "221: 0F 00",
        "5A0: 60",
        "621: 40",
        "7E4: 11",
        "1BC78821: 03",
        "00000000:",
        "00000080:",
    ];
    expect(rig.filters(), &own, &others);
    assert_eq!(rig.filters().len(), own.len(), "the EMCY consumer is off");
}

#[test]
fn filters_follow_the_cob_ids() {
    let mut rig = Rig::booted();
    rig.write_all(&[(0x1005, 0, 4, 0x85), (0x1028, 1, 4, 0xA1), (0x1400, 1, 4, 0x8000_0220)]);
    expect(rig.filters(), &["085:", "0A1: 00 10"], &["080:", "220: 0F 00"]);
    assert_eq!(rig.write(0x1400, 1, 4, 0x301), Ok(()));
    expect(rig.filters(), &["301: 0F 00", "620: 40"], &["220: 0F 00"]);
}

#[test]
fn filters_follow_the_node_id() {
    let mut rig = Rig::booted();
    for request in ["000: 02 00", lss::TO_CONFIGURATION, "7E5: 11 17 00 00 00 00 00 00"] {
        rig.send(request);
    }
    rig.send(lss::TO_WAITING);
    rig.advance(100);
    assert_eq!(rig.node_id(), Some(0x17));
    expect(rig.filters(), &["217: 0F 00", "617: 40", "1BC78817: 03"], &["220: 0F 00", "620: 40", "1BC78820: 03"]);
}

#[test]
fn without_a_node_id_there_is_lss_alone() {
    expect(super::blank().filters(), &["7E5: 04 01"], &["000: 01 00", "080:", "620: 40", "600: 40", "1BC78800: 03"]);
}

#[test]
fn a_valve_on_isobus_listens_to_its_groups() {
    let rig = Rig::claimed();
    let own = [
        "0CFE3327: 00",
        "18FE3300: 00",
        "18EA8327: 00 EE 00",
        "18EAFF27: 00 EE 00",
        "18EEFF83: 00",
        "18ECFF27: 20",
        "18EBFF27: 01",
        "18EC8327: 10",
        "1BC78883: 03",
        // whatever another sends under the valve's address
        "18FECA83: 00",
        "18EF2783: 00",
    ];
    let others = [
        "0CFE3427: 00",
        "0DFE3327: 00",
        "18EA8427: 00 EE 00",
        "18EEFF84: 00",
        "18EC8427: 10",
        "18EB8327: 01",
        "18FECA84: 00",
        "1BC78884: 03",
        "333: 00",
        "000: 01 00",
    ];
    expect(rig.filters(), &own, &others);
}
