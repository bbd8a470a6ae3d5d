//! Bit rot (SPEC 6): with any bit of its flash turned over a valve boots, and each record is intact, or lost and told.

use std::collections::BTreeSet;

use hal_sim::Memory;
use hal_sim::memory::{Flash, WORD};
use protocol_core::memory::{RecordKey, seal};
use tests::BusRig;

/// The records of a valve.
const KEYS: [RecordKey; 5] =
    [RecordKey::Factory, RecordKey::LocalLayer, RecordKey::Parameters, RecordKey::RestoreFlag, RecordKey::FaultLog];
const VERSION: u8 = 1;

/// The flash of a valve that has stored each of its records once.
fn stored() -> Flash {
    let (mut rig, valve) = BusRig::booted();
    rig.exchange("620: 23 10 10 01 73 61 76 65", "5A0: 60 10 10 01 00 00 00 00");
    rig.exchange("620: 23 11 10 01 6C 6F 61 64", "5A0: 60 11 10 01 00 00 00 00");
    for internal_fault in [true, false] {
        rig.sense(valve, |inputs| inputs.internal_fault = internal_fault);
    }
    rig.run_for(1000);
    rig.world.memory(valve).flash().clone()
}

#[test]
fn a_flipped_bit_loses_one_record_at_the_most_and_is_told() {
    let flash = stored();
    let intact = Memory::with_flash(flash.clone()).read_image();
    let mut all_lost = BTreeSet::new();
    // The bits of what is written, and of the words that come next.
    let bytes = flash.image();
    let in_use = bytes.chunks_exact(WORD).map(|word| *word != [0xFF; WORD]).collect::<Vec<_>>();
    let is_near = |word: &usize| in_use[word.saturating_sub(20)..=*word].contains(&true);
    for bit in (0..in_use.len()).filter(is_near).flat_map(|word| word * WORD * 8..(word + 1) * WORD * 8) {
        let mut rotten = flash.clone();
        rotten.flip_bit(bit);
        let mut memory = Memory::with_flash(rotten.clone());
        let image = memory.read_image();
        assert!(!image.is_damaged(), "one bit is not the whole memory: {bit}");
        let lost: Vec<_> = KEYS.into_iter().filter(|key| image.payload(*key, VERSION).is_err()).collect();
        for key in KEYS.iter().filter(|key| !lost.contains(key)) {
            assert_eq!(image.payload(*key, VERSION), intact.payload(*key, VERSION), "{key:?}, bit {bit}");
        }
        if all_lost.insert(lost.clone()) {
            let (mut rig, valve) = BusRig::with_flash(rotten);
            let mut boot = vec!["720: 00", "0A0: 00 00 00 00 00 00 00 00"];
            match lost[..] {
                [] => {}
                [RecordKey::FaultLog] => boot.push("0A0: 00 10 01 01 00 00 00 00"),
                // "load", which this start executes, writes it anew.
                [RecordKey::Parameters] => {
                    boot.extend(["0A0: 00 10 01 02 00 00 00 00", "0A0: 00 00 00 00 00 00 00 00"])
                }
                _ => boot.push("0A0: 00 10 01 02 00 00 00 00"),
            }
            assert_eq!(rig.boot(valve), boot, "{lost:?}");
        }
        // A record is stored in spite of it, in its way or not.
        memory.store(RecordKey::Parameters, &seal(VERSION, &[bit as u8; 90]).unwrap()).unwrap();
        let image = memory.read_image();
        assert_eq!(image.payload(RecordKey::Parameters, VERSION), Ok(Some(&[bit as u8; 90][..])), "bit {bit}");
    }
    let expected = [vec![]].into_iter().chain(KEYS.map(|key| vec![key]));
    assert_eq!(all_lost, expected.collect(), "one at a time, and each");
}
