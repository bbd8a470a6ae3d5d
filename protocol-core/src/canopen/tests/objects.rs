//! The dictionary with the SDO server, and the stored parameters.

use heapless::Vec;

use super::super::nmt::Reset;
use super::super::node::Demand;
use super::Rig;
use super::lamp::{DICTIONARY, Task};
use crate::canopen::dictionary::Group;
use crate::wire::sdo::{AbortCode, Multiplexer};

#[test]
fn rows_are_found_and_what_there_is_not_is_told_apart() {
    let find = |index, sub| DICTIONARY.entries().find(Multiplexer::new(index, sub));
    assert_eq!(find(0x1018, 1).map(|place| place.entry.object().index), Ok(0x1018));
    assert_eq!(find(0x1018, 2).err(), Some(AbortCode::NO_SUB));
    assert_eq!(find(0x1019, 1).err(), Some(AbortCode::NO_OBJECT));
}

#[test]
fn values_and_aborts() {
    let mut rig = Rig::booted();
    for (request, answer) in [
        ("605: 40 00 10 00 00 00 00 00", "585: 43 00 10 00 91 01 00 00"),
        ("605: 40 18 10 01 00 00 00 00", "585: 43 18 10 01 11 00 00 00"),
        ("605: 40 14 10 00 00 00 00 00", "585: 43 14 10 00 85 00 00 00"),
        ("605: 40 10 10 01 00 00 00 00", "585: 43 10 10 01 01 00 00 00"),
        ("605: 40 00 21 00 00 00 00 00", "585: 43 00 21 00 6C 61 6D 70"),
        ("605: 2F 00 62 00 64 00 00 00", "585: 60 00 62 00 00 00 00 00"),
        ("605: 2F 00 62 00 65 00 00 00", "585: 80 00 62 00 31 00 09 06"),
        ("605: 2F 00 60 00 01 00 00 00", "585: 80 00 60 00 02 00 01 06"),
        ("605: 2B 00 62 00 01 00 00 00", "585: 80 00 62 00 12 00 07 06"),
        ("605: 23 10 10 01 65 76 61 73", "585: 80 10 10 01 20 00 00 08"),
        ("605: 2B 17 10 00 FF FF 00 00", "585: 60 17 10 00 00 00 00 00"),
    ] {
        assert_eq!(rig.exchange(request), [answer], "{request}");
    }
}

#[test]
fn a_text_in_segments() {
    let mut rig = Rig::booted();
    assert_eq!(rig.exchange("605: 21 00 21 00 09 00 00 00"), ["585: 60 00 21 00 00 00 00 00"]);
    assert_eq!(rig.exchange("605: 00 74 61 62 6C 65 20 6C"), ["585: 20 00 00 00 00 00 00 00"]);
    assert_eq!(rig.exchange("605: 1B 61 6D 00 00 00 00 00"), ["585: 30 00 00 00 00 00 00 00"]);
    assert_eq!(rig.lamp.label, b"table lam");
    assert_eq!(rig.exchange("605: 40 00 21 00 00 00 00 00"), ["585: 41 00 21 00 09 00 00 00"]);
    assert_eq!(rig.exchange("605: 60 00 00 00 00 00 00 00"), ["585: 00 74 61 62 6C 65 20 6C"]);
    assert_eq!(rig.advance(5000), ["585: 80 00 21 00 00 00 04 05"], "the client has fallen silent");
}

#[test]
fn an_sdo_client_waits_for_its_task() {
    let mut rig = Rig::booted();
    assert_eq!(rig.take("605: 23 10 10 01 73 61 76 65"), Some(Demand::Task(Task::Save)));
    assert!(rig.sent().is_empty());
    rig.node.end_task(Task::Save, false);
    assert_eq!(rig.sent(), ["585: 80 10 10 01 00 00 06 06"]);
    assert_eq!(rig.take("605: 22 10 10 01 73 61 76 65"), Some(Demand::Task(Task::Save)));
    rig.node.end_task(Task::Save, true);
    assert_eq!(rig.sent(), ["585: 60 10 10 01 00 00 00 00"]);
    rig.node.end_task(Task::Save, true);
    assert!(rig.sent().is_empty(), "nobody waits");
}

#[test]
fn parameters_come_back_and_defaults_follow_the_node_id() {
    let mut rig = Rig::booted();
    rig.exchange("605: 2B 17 10 00 F4 01 00 00");
    rig.exchange("605: 23 00 21 00 61 62 63 64");
    let (mut stored, mut defaults) = (Vec::<u8, 64>::new(), Vec::<u8, 64>::new());
    rig.node.parameters(Group::All, &rig.lamp, &mut stored).unwrap();
    rig.node.default_parameters(&rig.lamp, &mut defaults).unwrap();
    assert!(rig.node.parameters(Group::All, &rig.lamp, &mut Vec::<u8, 8>::new()).is_none(), "too many bytes");

    let mut other = Rig::started(Some(6), Some(&stored));
    assert_eq!(other.sent(), ["706: 00"]);
    assert_eq!(other.exchange("606: 40 17 10 00 00 00 00 00"), ["586: 4B 17 10 00 F4 01 00 00"]);
    assert_eq!(other.exchange("606: 40 00 18 01 00 00 00 00"), ["586: 43 00 18 01 85 01 00 00"], "an absolute number");
    // Reset communication does not load the product's own objects.
    other.lamp.label = Vec::from_slice(b"mine").unwrap();
    other.start(Reset::Communication, Some(6), Some(&defaults));
    assert_eq!(other.lamp.label, b"mine");
    assert_eq!(other.exchange("606: 40 17 10 00 00 00 00 00").last().unwrap(), "586: 4B 17 10 00 00 00 00 00");
    other.start(Reset::Application, Some(6), Some(&stored[1..]));
    assert_eq!(other.lamp.label, b"lamp", "not a payload: the defaults");
    assert_eq!(other.exchange("606: 40 00 18 01 00 00 00 00").last().unwrap(), "586: 43 00 18 01 86 01 00 00");

    let blank = Rig::started(None, None);
    assert!(
        blank.node.default_parameters(&blank.lamp, &mut Vec::<u8, 64>::new()).is_none(),
        "there is no node ID to follow"
    );
}
