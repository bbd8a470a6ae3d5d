//! LSS with the rules of a product that answers identification in waiting and has its own error codes.

use super::super::lss::Configuration;
use super::super::nmt::Reset;
use super::super::node::Demand;
use super::Rig;
use crate::controller::BitRate;
use crate::wire::cob_id::NodeId;
use crate::wire::lss::LssNodeId;

fn configuring(rig: &mut Rig) {
    assert!(rig.exchange("7E5: 04 01 00 00 00 00 00 00").is_empty());
}

/// Requests a store and returns the configuration to store.
fn to_store(rig: &mut Rig) -> Configuration {
    configuring(rig);
    assert_eq!(rig.take("7E5: 17 00 00 00 00 00 00 00"), Some(Demand::StoreConfiguration));
    rig.node.begin_lss_store()
}

#[test]
fn identified_in_waiting_while_there_is_no_node_id() {
    let mut rig = Rig::started(None, None);
    assert_eq!(rig.exchange("7E5: 4C 00 00 00 00 00 00 00"), ["7E4: 50 00 00 00 00 00 00 00"]);
    assert_eq!(rig.exchange("7E5: 51 00 00 00 00 80 00 00"), ["7E4: 4F 00 00 00 00 00 00 00"]);
    configuring(&mut rig);
    assert_eq!(rig.exchange("7E5: 11 09 00 00 00 00 00 00"), ["7E4: 11 00 00 00 00 00 00 00"]);
    assert!(rig.exchange("7E5: 4C 00 00 00 00 00 00 00").is_empty(), "one is pending");
}

#[test]
fn the_products_error_codes() {
    let mut rig = Rig::booted();
    configuring(&mut rig);
    assert_eq!(rig.exchange("7E5: 11 80 00 00 00 00 00 00"), ["7E4: 11 FF 00 00 00 00 00 00"]);
    assert_eq!(rig.exchange("7E5: 13 00 05 00 00 00 00 00"), ["7E4: 13 01 00 00 00 00 00 00"]);
    assert_eq!(rig.exchange("7E5: 13 00 08 00 00 00 00 00"), ["7E4: 13 00 00 00 00 00 00 00"], "10 kbit/s");
    assert_eq!(rig.take("7E5: 17 00 00 00 00 00 00 00"), Some(Demand::StoreConfiguration));
    rig.node.end_lss_store(false, true);
    assert_eq!(rig.sent(), ["7E4: 17 FF 00 00 00 00 00 00"]);
}

#[test]
fn a_configuration_is_unstored_until_the_memory_holds_it() {
    let mut rig = Rig::booted();
    configuring(&mut rig);
    assert_eq!(to_store(&mut rig), Configuration::NONE);
    rig.exchange("7E5: 11 09 00 00 00 00 00 00");
    rig.exchange("7E5: 13 00 02 00 00 00 00 00");
    let both = Configuration { node_id: LssNodeId::new(9), bit_rate: Some(BitRate::Kbit500) };
    assert_eq!(to_store(&mut rig), both);
    rig.node.configuration_stored(Configuration { node_id: None, ..both });
    assert_eq!(to_store(&mut rig), Configuration { bit_rate: None, ..both });
    assert_eq!(rig.take("7E5: 04 00 00 00 00 00 00 00"), Some(Demand::Reset(Reset::Application)));
    rig.start(Reset::Application, Some(5), None);
    assert_eq!(rig.node.node_id(), NodeId::new(9), "held until power-off");
    rig.start(Reset::Application, Some(5), None);
    rig.sent();
    assert_eq!(to_store(&mut rig), Configuration { bit_rate: None, ..both });
    // A node ID stored by another service is in force from the next start.
    rig.node.configuration_stored(Configuration { node_id: LssNodeId::new(12), bit_rate: None });
    rig.start(Reset::Communication, Some(12), None);
    assert_eq!(rig.node.node_id(), NodeId::new(12));
}

#[test]
fn a_pending_node_id_is_taken_over_by_reset_communication_alone() {
    for (scope, expected) in [(Reset::Communication, 9), (Reset::Application, 5)] {
        let mut rig = Rig::booted();
        configuring(&mut rig);
        rig.exchange("7E5: 11 09 00 00 00 00 00 00");
        rig.start(scope, Some(5), None);
        assert_eq!(rig.node.node_id(), NodeId::new(expected));
    }
}

fn switching() -> Rig {
    let mut rig = Rig::booted();
    configuring(&mut rig);
    rig.exchange("7E5: 13 00 02 00 00 00 00 00");
    assert!(rig.exchange("7E5: 15 0A 00 00 00 00 00 00").is_empty());
    rig
}

#[test]
fn the_rate_is_switched_between_two_silent_delays() {
    let mut rig = switching();
    assert!(rig.node.take_abort().is_some(), "nothing that the controller has may go out");
    assert!(rig.exchange("605: 40 00 10 00 00 00 00 00").is_empty());
    assert_eq!(rig.node.frames_dropped(), 1);
    assert_eq!((rig.advance(9).len(), rig.node.take_bit_rate()), (0, None));
    rig.advance(1);
    assert_eq!((rig.node.take_bit_rate(), rig.node.take_bit_rate()), (Some(BitRate::Kbit500), None));
    rig.advance(10);
    assert_eq!(rig.exchange("605: 40 00 10 00 00 00 00 00").len(), 1);
    assert_eq!(to_store(&mut rig).bit_rate, Some(BitRate::Kbit500));
}

#[test]
fn a_reset_in_the_silence_boots_at_its_end() {
    for (scope, rate) in [(Reset::Communication, Some(BitRate::Kbit500)), (Reset::Application, None)] {
        let mut rig = switching();
        rig.start(scope, Some(5), None);
        assert!(rig.advance(19).is_empty());
        assert_eq!(rig.node.take_bit_rate(), rate, "reset application drops what is pending");
        assert_eq!(rig.advance(1), ["705: 00"]);
    }
}

#[test]
fn present_rate_activated_leaves_nothing_to_store() {
    let mut rig = Rig::booted();
    configuring(&mut rig);
    rig.exchange("7E5: 15 01 00 00 00 00 00 00");
    rig.advance(2);
    assert_eq!(rig.node.take_bit_rate(), Some(BitRate::Kbit250));
    assert_eq!(to_store(&mut rig), Configuration::NONE);
}
