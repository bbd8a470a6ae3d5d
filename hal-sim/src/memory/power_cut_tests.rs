//! Power cuts and failures at any word write or erase, with any result of a torn erase (SPEC 6). Each record is old or
//! new, and leftovers cause no harm later.

use protocol_core::memory::seal;

use super::*;

const VERSION: u8 = 1;
type Held = [Option<Vec<u8>>; RecordKey::ALL.len()];

/// A memory before a store, and the store.
struct Moment {
    flash: Flash,
    before: Held,
    key: RecordKey,
    number: u32,
    /// The number of word writes and erases of the store.
    operations: u64,
}

fn record(number: u32) -> Record {
    let mut payload = [number as u8; 90];
    payload[..4].copy_from_slice(&number.to_le_bytes());
    seal(VERSION, &payload).unwrap()
}

fn held(memory: &mut Memory) -> Held {
    let image = memory.read_image();
    assert!(!image.is_damaged());
    RecordKey::ALL.map(|key| image.payload(key, VERSION).unwrap().map(<[u8]>::to_vec))
}

fn operations(flash: &Flash) -> u64 {
    flash.word_writes() + flash.erases()
}

impl Moment {
    /// Returns the stores up to the `erases`th erase of a sector, filtered by `wanted`.
    fn all_until(erases: u64, wanted: impl Fn(&Self) -> bool) -> Vec<Self> {
        let mut memory = Memory::in_ram();
        let mut before = Held::default();
        let mut moments = Vec::new();
        for number in 0.. {
            // The factory record is written once and must survive.
            let key = if number == 0 { RecordKey::Factory } else { RecordKey::ALL[1 + number as usize % 5] };
            let flash = memory.flash().clone();
            memory.store(key, &record(number)).unwrap();
            let operations = operations(memory.flash()) - operations(&flash);
            let moment = Self { flash, before: before.clone(), key, number, operations };
            if wanted(&moment) {
                moments.push(moment);
            }
            before[key.position()] = Some(record(number)[2..92].to_vec());
            if memory.flash().erases() == erases {
                break;
            }
        }
        moments
    }

    /// Returns the first `erases` stores that erase a sector.
    fn erasing(erases: u64) -> Vec<Self> {
        Self::all_until(erases, Self::erases)
    }

    fn erases(&self) -> bool {
        self.operations > 60
    }

    fn after(&self) -> Held {
        let mut after = self.before.clone();
        after[self.key.position()] = Some(record(self.number)[2..92].to_vec());
        after
    }

    fn memory(&self, torn_erase: TornErase, seed: u64) -> Memory {
        let mut flash = self.flash.clone();
        flash.set_torn_erase(torn_erase);
        flash.seed_noise(seed);
        Memory::with_flash(flash)
    }

    fn store(&self, memory: &mut Memory) -> Result<(), StoreError> {
        memory.store(self.key, &record(self.number))
    }

    /// Checks that the memory holds the content before or after the store, and that the record can be stored without
    /// loss.
    #[track_caller]
    fn check(&self, mut memory: Memory, what: &str) {
        let found = held(&mut memory);
        assert!(found == self.before || found == self.after(), "store {} {what}", self.number);
        self.store(&mut memory).unwrap();
        assert!(held(&mut memory) == self.after(), "store {} {what}, and stored again", self.number);
    }
}

#[test]
fn a_cut_at_any_word_leaves_each_record_old_or_new() {
    let mut cuts = 0;
    // The first store of each record, the stores that start a sector, and some others.
    for moment in Moment::all_until(2, |moment| moment.number < 6 || moment.operations > 28 || moment.number % 97 == 0)
    {
        let torn_erases = if moment.erases() { &TornErase::ALL[..] } else { &TornErase::ALL[..1] };
        for torn_erase in torn_erases {
            for cut in 0..moment.operations {
                let mut memory = moment.memory(*torn_erase, cut);
                memory.flash_mut().cut_power_after(cut);
                let stored = moment.store(&mut memory);
                assert!(memory.flash().is_dead());
                memory.power_up();
                let what = format!("cut after {cut}, {torn_erase:?}");
                assert!(stored.is_err() || held(&mut memory) == moment.after(), "store {} {what}", moment.number);
                moment.check(memory, &what);
                cuts += 1;
            }
        }
    }
    assert!(cuts > 1700, "{cuts} cuts");
}

#[test]
fn an_erase_that_is_cut_leaves_nothing_that_does_harm() {
    for moment in Moment::erasing(2) {
        // The erase, its completion mark and the record are written at the end of the store, in this order.
        let erase = (0..moment.operations).rev().find(|cut| {
            let mut memory = moment.memory(TornErase::Front, 0);
            memory.flash_mut().cut_power_after(*cut);
            let _ = moment.store(&mut memory);
            memory.flash().erases() == moment.flash.erases()
        });
        let erase = erase.expect("it erases");
        for torn_erase in TornErase::ALL {
            for seed in 0..30 {
                let mut memory = moment.memory(torn_erase, seed);
                memory.flash_mut().cut_power_after(erase);
                moment.store(&mut memory).unwrap_err();
                memory.power_up();
                moment.check(memory, &format!("{torn_erase:?} with seed {seed}"));
            }
        }
    }
}

#[test]
fn a_cut_of_the_recovery_from_a_cut_does_no_harm() {
    let mut cuts = 0;
    for moment in Moment::erasing(2) {
        for torn_erase in TornErase::ALL {
            for first in (0..moment.operations).filter(|cut| *cut % 41 == 0 || *cut > moment.operations - 34) {
                let cut_once = || {
                    let mut memory = moment.memory(torn_erase, first);
                    memory.flash_mut().cut_power_after(first);
                    let _ = moment.store(&mut memory);
                    memory.power_up();
                    memory
                };
                // The read recovers a part, the store the rest.
                let mut memory = cut_once();
                let before = operations(memory.flash());
                memory.read_image();
                moment.store(&mut memory).unwrap();
                let recovery = operations(memory.flash()) - before;
                for second in (0..recovery).filter(|cut| cut % 19 == first % 19 || *cut > recovery - 3) {
                    let mut memory = cut_once();
                    memory.flash_mut().cut_power_after(second);
                    memory.read_image();
                    let _ = moment.store(&mut memory);
                    assert!(memory.flash().is_dead());
                    memory.power_up();
                    moment.check(memory, &format!("cut after {first}, {torn_erase:?}, then after {second}"));
                    cuts += 1;
                }
            }
        }
    }
    assert!(cuts > 600, "{cuts} cuts");
}

#[test]
fn one_cut_after_the_other_loses_nothing() {
    for seed in 0..10 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut memory = Memory::in_ram();
        memory.flash_mut().seed_noise(seed);
        let mut before = Held::default();
        for number in 0..500 {
            let key = if number == 0 { RecordKey::Factory } else { RecordKey::ALL[1 + random.usize(..5)] };
            let mut after = before.clone();
            after[key.position()] = Some(record(number)[2..92].to_vec());
            memory.flash_mut().set_torn_erase(TornErase::ALL[random.usize(..5)]);
            memory.flash_mut().cut_power_after(random.u64(..200));
            let stored = memory.store(key, &record(number));
            let cut = memory.flash().is_dead();
            memory.flash_mut().restore_power();
            let found = held(&mut memory);
            let new = found == after;
            assert!(new || (cut && stored.is_err() && found == before), "seed {seed}, store {number}");
            before = found;
        }
        assert!(memory.flash().erases() > 0);
    }
}

#[test]
fn a_failure_at_any_word_is_told_and_leaves_the_old_record() {
    let mut failures = 0;
    for moment in Moment::all_until(2, |moment| moment.number < 6 || moment.operations > 28) {
        for failure in 0..moment.operations {
            let torn_erase = TornErase::ALL[failure as usize % 5];
            let mut memory = moment.memory(torn_erase, failure);
            memory.flash_mut().fail_once_after(failure);
            let stored = moment.store(&mut memory);
            let expected = if stored.is_ok() { moment.after() } else { moment.before.clone() };
            let what = format!("{stored:?} at a failure of {failure} of {}, {torn_erase:?}", moment.operations);
            assert!(held(&mut memory) == expected, "store {} {what}", moment.number);
            moment.check(memory, &what);
            failures += u32::from(stored.is_err());
        }
    }
    assert!(failures > 400, "{failures} failures");
}

#[test]
fn a_cut_first_store_leaves_a_new_memory_or_the_record() {
    let moment = &Moment::all_until(1, |moment| moment.number == 0)[0];
    let mut new = 0;
    for cut in 0..moment.operations {
        let mut memory = moment.memory(TornErase::Front, cut);
        memory.flash_mut().cut_power_after(cut);
        let _ = moment.store(&mut memory);
        memory.power_up();
        new += u32::from(memory.read_image().is_new());
        moment.check(memory, &format!("cut after {cut}"));
    }
    // The empty inventory and the record: 31 words; the inventory with the record takes four.
    assert!((29..=32).contains(&new) && moment.operations == 35, "{new} of {}", moment.operations);
}

#[test]
fn a_first_store_that_is_cut_again_and_again_leaves_a_new_memory() {
    let moment = &Moment::all_until(1, |moment| moment.number == 0)[0];
    let cuts = (0..30).flat_map(|first| (0..30).map(move |second| [first, second, first]));
    for cuts in cuts.chain((0..30).map(|cut| [cut; 3])) {
        let mut memory = moment.memory(TornErase::Front, cuts[0] + 31 * cuts[1]);
        for cut in cuts {
            memory.flash_mut().cut_power_after(cut);
            let _ = moment.store(&mut memory);
            memory.power_up();
        }
        moment.check(memory, &format!("cut after {cuts:?}"));
    }
}
