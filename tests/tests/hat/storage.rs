//! Store and restore by group, and power cuts (SPEC 6, 9).

use std::collections::BTreeSet;

use protocol_core::controller::BitRate;
use protocol_core::device::ProductInputs;
use protocol_core::device::hat::{Kind, Setup};
use protocol_core::encoder::Shaft;
use protocol_core::memory::{RecordKey, open, seal};
use protocol_core::time::Duration;
use tests::{Rig, lss, sdo};

use super::{LOAD, SAVE, booted};

/// The marker of each group: object, size, default, another value.
const COMMUNICATION: (u16, u8, u8, u32, u32) = (0x1017, 0, 2, 0, 0xFFFF);
const APPLICATION: (u16, u8, u8, u32, u32) = (0x6003, 0, 4, 0, 77);
const BIT_RATE: (u16, u8, u8, u32, u32) = (0x2002, 2, 1, 2, 3);
const NODE_ID: (u16, u8, u8, u32, u32) = (0x2001, 2, 1, 1, 9);
const MARKERS: [(u16, u8, u8, u32, u32); 4] = [COMMUNICATION, APPLICATION, BIT_RATE, NODE_ID];

/// Which groups a sub-index of 0x1010 and 0x1011 is about, by marker.
const SUBS: [(u8, [bool; 4]); 4] = [
    (1, [true, true, false, false]),
    (2, [true, false, false, false]),
    (3, [false, true, false, false]),
    (4, [false, false, true, true]),
];

fn change_all(rig: &mut Rig) {
    for (index, sub, size, _, other) in MARKERS {
        assert_eq!(rig.write(index, sub, size, other), Ok(()));
        rig.take();
    }
}

/// Whether each marker differs from its default.
fn changed(rig: &mut Rig) -> [bool; 4] {
    MARKERS.map(|(index, sub, _, default, other)| {
        let value = rig.read(index, sub);
        assert!([default, other].contains(&value), "{index:04X}:{sub} = {value:X}");
        value == other
    })
}

#[test]
fn save_touches_its_groups_and_no_other() {
    for (sub, groups) in SUBS {
        let mut rig = booted();
        change_all(&mut rig);
        rig.writes.clear();
        rig.save(sub);
        assert_eq!(rig.writes.len(), if sub == 1 { 2 } else { 1 });
        assert_eq!(changed(&mut rig), [true; 4], "the running values stay");
        rig.start_anew();
        assert_eq!(changed(&mut rig), groups, "1010:{sub}");
    }
}

#[test]
fn load_touches_its_groups_and_no_other_and_acts_at_the_next_reset() {
    for (sub, groups) in SUBS {
        for restart in
            [Rig::power_cycle, |rig: &mut Rig| rig.send("000: 81 00"), |rig: &mut Rig| rig.send("000: 82 00")]
        {
            let mut rig = booted();
            change_all(&mut rig);
            rig.write_all(&[(0x1010, 1, 4, SAVE), (0x1010, 4, 4, SAVE)]);
            rig.exchange("000: 81 00", &["709: 00"]);
            assert_eq!(changed(&mut rig), [true; 4]);
            rig.load(sub);
            assert_eq!(changed(&mut rig), [true; 4], "the running values stay");
            restart(&mut rig);
            rig.take();
            assert_eq!(changed(&mut rig), groups.map(|loaded| !loaded), "1011:{sub}");
        }
    }
}

#[test]
fn a_save_after_a_load_stores_the_running_values() {
    let mut rig = booted();
    change_all(&mut rig);
    for sub in 1..=4 {
        rig.write_all(&[(0x1011, sub, 4, LOAD), (0x1010, sub, 4, SAVE)]);
    }
    rig.start_anew();
    assert_eq!(changed(&mut rig), [true; 4]);
}

#[test]
fn restored_lss_parameters_are_in_force_by_their_resets() {
    let mut rig = booted();
    change_all(&mut rig);
    rig.save(4);
    rig.exchange("000: 81 00", &["709: 00"]);
    rig.load(4);
    rig.exchange("000: 82 00", &["701: 00"]);
    assert_eq!((rig.read(0x2002, 1), rig.read(0x2002, 2)), (3, 2), "the rate waits for reset node");
    rig.exchange("000: 81 00", &["701: 00"]);
    assert_eq!(rig.read(0x2002, 1), 2);
}

#[test]
fn saved_cob_ids_are_absolute_and_load_makes_them_follow() {
    let mut rig = booted();
    for (sub, value) in [(2, 9), (2, 17)] {
        rig.write_all(&[(0x1010, 2, 4, SAVE), (0x2001, sub, 1, value), (0x1010, 4, 4, SAVE)]);
        rig.send("000: 82 00");
        rig.take();
        assert_eq!((rig.read(0x1014, 0), rig.read(0x1800, 1)), (0x81, 0x8000_0181));
    }
    rig.load(2);
    rig.exchange("000: 82 00", &["711: 00"]);
    assert_eq!((rig.read(0x1014, 0), rig.read(0x1800, 1)), (0x91, 0x8000_0191));
}

#[test]
fn every_communication_object_is_kept() {
    let mut rig = booted();
    let objects = [
        (0x1005, 0, 4, 0x2000_1234),
        (0x1014, 0, 4, 0xA000_5678),
        (0x1017, 0, 2, 7),
        (0x1029, 1, 1, 2),
        (0x1029, 2, 1, 1),
        (0x1800, 1, 4, 0x8000_0200),
        (0x1800, 2, 1, 17),
        (0x1800, 3, 2, 3),
        (0x1800, 5, 2, 5),
        (0x1A00, 0, 1, 0),
        (0x1A00, 1, 4, 0x6503_0010),
        (0x1A00, 8, 4, 0x1001_0008),
        (0x1F80, 0, 4, 0x0C),
    ];
    for (index, sub, size, value) in objects {
        assert_eq!(rig.write(index, sub, size, value), Ok(()), "{index:04X}:{sub}");
        rig.take();
    }
    rig.save(2);
    rig.start_anew();
    for (index, sub, _, value) in objects {
        assert_eq!(rig.read(index, sub), value, "{index:04X}:{sub}");
    }
}

#[test]
fn a_failed_write_is_an_abort_and_no_emcy() {
    for (sub, _) in SUBS {
        for failing in 0..if sub == 1 { 2 } else { 1 } {
            for (index, signature) in [(0x1010, SAVE), (0x1011, LOAD)] {
                let mut rig = booted();
                rig.failing_writes = BTreeSet::from([failing]);
                assert_eq!(rig.write(index, sub, 4, signature), Err(0x0606_0000), "{index:X}:{sub}");
                rig.expect_nothing();
                assert_eq!((rig.read(0x1001, 0), rig.read(0x1003, 0)), (0, 0));
                assert_eq!(rig.write(index, sub, 4, signature), Ok(()), "the next one succeeds");
            }
        }
    }
}

/// With what a new sensor is made as, not with what 0x2001 and 0x2002 demand by then.
#[test]
fn a_new_memory_is_not_filled_with_what_is_demanded() {
    let mut rig = booted();
    rig.records.clear();
    rig.write_time = Duration::from_millis(10);
    rig.power_cycle_sends(&["701: 00"]);
    rig.write_all(&[(0x2001, 2, 1, 9), (0x2002, 2, 1, 3)]);
    rig.advance(50);
    rig.power_cycle_sends(&["701: 00"]);
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit500);
}

/// A damaged record held a node ID: the sensor starts with that of a new one, and a blank one with the factory's.
#[test]
fn damaged_lss_parameters_are_those_of_a_new_sensor() {
    let new = Setup::new(Kind::Hat1000);
    let made = Setup { node_id: Some(5), bit_rate: Some(BitRate::Kbit250), ..new };
    let blank = Setup { node_id: None, ..new };
    for (setup, node_id, bit_rate) in
        [(made, 5, BitRate::Kbit250), (blank, 1, BitRate::Kbit500), (new, 1, BitRate::Kbit500)]
    {
        let mut rig = Rig::power_on(setup);
        rig.take();
        rig.records.get_mut(&RecordKey::LocalLayer).unwrap()[3] ^= 1;
        rig.power_cycle_sends(&[format!("70{node_id}: 00"), format!("08{node_id}: 00 FF 81 01 00 00 00 00")]);
        assert_eq!(rig.device().bit_rate(), bit_rate);
    }
}

#[test]
fn the_offset_is_stored_as_it_is_not_as_the_preset() {
    let mut rig = booted();
    rig.sense_hat(|inputs| inputs.product = ProductInputs::Encoder(Shaft::at(9_000)));
    rig.write_all(&[(0x6003, 0, 4, 16_383), (0x1010, 1, 4, SAVE)]);
    rig.sense_hat(|inputs| inputs.product = ProductInputs::Encoder(Shaft::at(0)));
    rig.start_anew();
    assert_eq!((rig.read(0x6003, 0), rig.read(0x6004, 0)), (16_383, 12_287));
    rig.load(3);
    rig.exchange("000: 82 00", &["701: 00"]);
    assert_eq!((rig.read(0x6003, 0), rig.read(0x6004, 0), rig.read(0x6509, 0)), (0, 0, 0));
}

/// Intact, and of another firmware: it does not fit the objects.
#[test]
fn a_record_of_another_length_is_damaged() {
    for key in [RecordKey::LocalLayer, RecordKey::Parameters, RecordKey::Application] {
        for longer in [false, true] {
            let mut rig = booted();
            rig.save(1);
            let mut payload = open(1, &rig.records[&key]).expect("intact").to_vec();
            if longer {
                payload.push(0);
            } else {
                payload.pop();
            }
            rig.records.insert(key, seal(1, &payload).expect("room").to_vec());
            rig.power_cycle();
            assert_eq!(rig.take(), ["701: 00", "081: 00 FF 81 01 00 00 00 00"], "{key:?}, longer: {longer}");
        }
    }
}

/// A client that turns to something else is answered about that alone, and when that is done.
#[test]
fn a_task_is_answered_by_its_own_writes() {
    let (communication, application) = (&sdo::write(1, 0x1010, 2, b"save"), &sdo::write(1, 0x1010, 3, b"save"));
    for fails in [false, true] {
        let mut rig = booted();
        rig.write_time = Duration::from_millis(10);
        if fails {
            rig.failing_writes.insert(0);
        }
        rig.silent_to(&[communication, application]);
        rig.silent_for(19);
        rig.advance(1);
        assert_eq!(rig.take(), [sdo::written(1, 0x1010, 3)], "the first one fails: {fails}");
    }
    // Back to what still waits, behind a write for LSS: the other task's record is written later.
    let mut rig = booted();
    rig.write_time = Duration::from_millis(10);
    for request in [lss::TO_CONFIGURATION, lss::STORE, application, communication, application] {
        rig.exchange(request, &[]);
    }
    rig.advance_sends(20, &[lss::STORED, &sdo::written(1, 0x1010, 3)]);
    rig.silent_for(100);
}
