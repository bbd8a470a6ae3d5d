//! The node: boot-up, NMT, heartbeat, SYNC, PDOs, EMCYs and resets.

use super::super::nmt::Reset;
use super::super::node::Demand;
use super::Rig;
use crate::wire::emcy::Emcy;

#[test]
fn without_a_node_id_there_is_lss_alone() {
    let mut rig = Rig::started(None, None);
    assert!(rig.sent().is_empty());
    let filters = rig.node.take_filters().unwrap();
    assert_eq!(filters.iter().map(|filter| filter.key).collect::<std::vec::Vec<_>>(), [0x7E5]);
    assert!(rig.node.take_filters().is_none(), "told once");
    for text in ["000: 01 00", "605: 40 00 10 00 00 00 00 00", "205: 07"] {
        assert!(rig.exchange(text).is_empty(), "{text}");
    }
    assert_eq!(rig.exchange("7E5: 04 01 00 00 00 00 00 00"), [""; 0]);
    assert_eq!(rig.exchange("7E5: 5E 00 00 00 00 00 00 00"), ["7E4: 5E FF 00 00 00 00 00 00"]);
}

#[test]
fn pdos_are_exchanged_in_operational_alone() {
    let mut rig = Rig::booted();
    assert!(rig.exchange("205: 07").is_empty());
    assert!(rig.exchange("000: 01 05").is_empty(), "none is sent on entering it");
    rig.lamp.register = 0x11;
    assert_eq!(rig.exchange("205: 07"), ["185: 07 11"]);
    assert_eq!(rig.exchange("205: 65"), ["185: 07 11"], "an invalid value is dropped");
    assert!(rig.exchange("205:").is_empty(), "too short");
    assert!(rig.exchange("000: 02 00").is_empty());
    assert!(rig.exchange("205: 07").is_empty());
    assert_eq!((rig.lamp.stops, rig.lamp.brightness), (1, 0));
    assert!(rig.exchange("000: 02 00").is_empty());
    assert_eq!(rig.lamp.stops, 1, "stopped already");
}

#[test]
fn every_nth_sync() {
    let mut rig = Rig::booted();
    assert_eq!(rig.exchange("605: 2F 00 18 02 02 00 00 00"), ["585: 60 00 18 02 00 00 00 00"]);
    rig.exchange("000: 01 00");
    assert!(rig.exchange("205: 07").is_empty());
    assert!(rig.exchange("080:").is_empty());
    assert_eq!(rig.exchange("080:"), ["185: 07 00"]);
    // A 29-bit identifier, which this product permits.
    assert_eq!(rig.exchange("605: 23 05 10 00 80 00 00 20"), ["585: 60 05 10 00 00 00 00 00"]);
    assert!(rig.exchange("080:").is_empty());
    assert!(rig.exchange("00000080:").is_empty());
    assert_eq!(rig.exchange("00000080:"), ["185: 07 00"]);
}

#[test]
fn heartbeats_to_the_millisecond() {
    let mut rig = Rig::booted();
    assert_eq!(rig.exchange("605: 2B 17 10 00 07 00 00 00"), ["585: 60 17 10 00 00 00 00 00"]);
    assert_eq!(rig.advance(0), ["705: 7F"], "the first at once");
    assert_eq!(rig.advance(6), [""; 0]);
    rig.exchange("000: 01 00");
    assert_eq!(rig.advance(1), ["705: 05"]);
    assert_eq!(rig.advance(14), ["705: 05"; 2]);
}

#[test]
fn emcys_wait_for_the_boot_up_and_are_not_sent_in_stopped() {
    let mut rig = Rig::started(Some(5), None);
    let error = Emcy { code: 0x4200, register: 0x09, manufacturer: [1, 0, 0, 0, 0] };
    assert!(rig.node.report_error(error, 1));
    assert_eq!(rig.sent(), ["705: 00", "085: 00 42 09 01 00 00 00 00"]);
    assert_eq!(rig.exchange("605: 40 03 10 01 00 00 00 00"), ["585: 43 03 10 01 00 42 01 00"]);
    rig.exchange("000: 02 00");
    rig.node.send_emcy(Emcy::default());
    assert!(rig.exchange("000: 80 00").is_empty());
}

#[test]
fn the_emcy_of_another_node() {
    let mut rig = Rig::booted();
    assert!(rig.exchange("086: 00 10 01 00 00 00 00 00").is_empty());
    assert_eq!(rig.lamp.heard, None);
    rig.exchange("605: 23 28 10 01 86 00 00 00");
    rig.exchange("086: 00 10 01 00 00 00 00 00");
    assert_eq!(rig.lamp.heard.map(|emcy| emcy.code), Some(0x1000));
}

#[test]
fn resets_are_the_devices() {
    let mut rig = Rig::booted();
    rig.node.report_error(Emcy { code: 0x4200, ..Emcy::default() }, 1);
    rig.sent();
    rig.exchange("605: 2F 00 62 00 09 00 00 00");
    assert_eq!(rig.take("000: 82 05"), Some(Demand::Reset(Reset::Communication)));
    assert_eq!(rig.take("000: 01 05"), None);
    assert!(rig.exchange("605: 40 00 10 00 00 00 00 00").is_empty(), "it takes no part until the restart");
    rig.start(Reset::Communication, Some(6), None);
    assert_eq!(rig.sent(), ["706: 00"]);
    assert_eq!(rig.exchange("606: 40 03 10 00 00 00 00 00"), ["586: 4F 03 10 00 01 00 00 00"], "the history stays");
    assert_eq!(rig.take("000: 81 06"), Some(Demand::Reset(Reset::Application)));
    rig.start(Reset::Application, Some(6), None);
    assert_eq!(rig.sent(), ["706: 00"]);
    assert_eq!(rig.exchange("606: 40 03 10 00 00 00 00 00"), ["586: 4F 03 10 00 00 00 00 00"]);
    assert_eq!(rig.take("000: 81 07"), None, "another node's");
}

extern crate std;
