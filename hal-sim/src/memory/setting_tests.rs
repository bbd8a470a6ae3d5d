//! The platform setting beside the records, and clearing the records but not the setting: functions of `nvm` for the
//! board, after every kind of accident (SPEC 6).

use super::tests::{numbered, payload, record};
use super::*;

type Held = [Option<Vec<u8>>; RecordKey::ALL.len()];

const OLD: &[u8] = b"old";
const NEW: &[u8] = b"new kind";

fn setting(flash: &Flash) -> Option<Vec<u8>> {
    let mut flash = flash.clone();
    let mut buffer = [0; BUFFER];
    let mut records = Records::new(&mut flash, &mut buffer);
    let mut contents = Contents::empty();
    records.read(&mut contents).unwrap();
    contents.setting.map(|setting| setting.to_vec())
}

fn store_setting(flash: &mut Flash, setting: &[u8]) -> Result<(), StoreError> {
    let mut buffer = [0; BUFFER];
    let mut records = Records::new(flash, &mut buffer);
    records.store_setting(setting)
}

fn clear(flash: &mut Flash) -> Result<(), StoreError> {
    let mut buffer = [0; BUFFER];
    let mut records = Records::new(flash, &mut buffer);
    records.clear()
}

fn image(flash: &Flash) -> Image {
    read(&mut flash.clone()).unwrap()
}

#[track_caller]
fn held(flash: &Flash) -> Held {
    let image = image(flash);
    RecordKey::ALL.map(|key| payload(&image, key))
}

fn operations(flash: &Flash) -> u64 {
    flash.word_writes() + flash.erases()
}

/// Returns a flash with an optional setting, after a number of stores.
fn with_stores(setting: Option<&[u8]>, count: u32) -> Flash {
    let mut flash = Flash::new();
    if let Some(setting) = setting {
        store_setting(&mut flash, setting).unwrap();
    }
    for number in 0..count {
        store(&mut flash, RecordKey::ALL[number as usize % 5], &record(&numbered(number))).unwrap();
    }
    flash
}

/// Returns a flash whose records have just begun to move to the other sector.
fn in_a_move(setting: Option<&[u8]>) -> Flash {
    for count in 140.. {
        let mut flash = with_stores(setting, count);
        let before = flash.clone();
        store(&mut flash, RecordKey::RestoreFlag, &record(&numbered(0))).unwrap();
        if flash.erases() > 0 {
            let mut flash = before;
            flash.cut_power_after(60);
            store(&mut flash, RecordKey::RestoreFlag, &record(&numbered(0))).unwrap_err();
            flash.restore_power();
            return flash;
        }
    }
    unreachable!("it is full some time")
}

#[test]
fn a_setting_is_kept_beside_the_records() {
    let mut flash = Flash::new();
    assert_eq!(setting(&flash), None);
    assert_eq!(store_setting(&mut flash, b"ninebytes"), Err(StoreError));
    for bytes in [&b""[..], b"a", b"12345678"] {
        store_setting(&mut flash, bytes).unwrap();
        assert_eq!(setting(&flash).as_deref(), Some(bytes));
        assert!(image(&flash).is_new(), "it is not the device's");
    }
    for number in 0..400 {
        store(&mut flash, RecordKey::Parameters, &record(&numbered(number))).unwrap();
    }
    assert!(flash.erases() >= 2);
    assert_eq!(setting(&flash).as_deref(), Some(&b"12345678"[..]));
}

#[test]
fn a_cut_at_any_word_leaves_the_setting_old_or_new() {
    let full = (140..).map(|count| with_stores(Some(OLD), count)).find(|flash| {
        let mut flash = flash.clone();
        store_setting(&mut flash, NEW).unwrap();
        flash.erases() > 0
    });
    for flash in
        [Flash::new(), with_stores(Some(OLD), 0), with_stores(None, 7), with_stores(Some(OLD), 7), full.unwrap()]
    {
        let (old, records) = (setting(&flash), held(&flash));
        let mut done = flash.clone();
        store_setting(&mut done, NEW).unwrap();
        for cut in 0..operations(&done) - operations(&flash) {
            let mut flash = flash.clone();
            flash.set_torn_erase(TornErase::ALL[cut as usize % 5]);
            flash.seed_noise(cut);
            flash.cut_power_after(cut);
            let stored = store_setting(&mut flash, NEW);
            flash.restore_power();
            let found = setting(&flash);
            assert!(found.as_deref() == Some(NEW) || (stored.is_err() && found == old), "cut after {cut}: {found:?}");
            assert_eq!(held(&flash), records, "cut after {cut}");
            store_setting(&mut flash, NEW).unwrap();
            assert!(setting(&flash).as_deref() == Some(NEW) && held(&flash) == records, "cut after {cut}");
        }
    }
}

#[test]
fn no_flipped_bit_gives_a_setting_that_was_never_stored() {
    let mut flash = with_stores(Some(OLD), 2);
    store_setting(&mut flash, NEW).unwrap();
    let mut fallen_back = 0;
    for bit in 0..(flash.words_in_use() + 2) * WORD * 8 {
        let mut flash = flash.clone();
        flash.flip_bit(bit);
        let found = setting(&flash);
        assert!([OLD, NEW].contains(&found.as_deref().unwrap()), "bit {bit}: {found:?}");
        fallen_back += u32::from(found.as_deref() == Some(OLD));
    }
    assert!(fallen_back > 100, "{fallen_back}");
    let mut flash = with_stores(Some(NEW), 0);
    flash.flip_bit((4 + 12 + 8 + 3) * 8);
    assert_eq!(setting(&flash), None);
}

#[test]
fn asking_for_the_setting_hides_no_damage() {
    for seed in 0..40 {
        let mut random = fastrand::Rng::with_seed(seed as u64);
        let mut flash = Flash::new();
        // A sector with meaningless marks, its front erased and its end not; and an empty sector.
        let front = seed % 2 * SECTOR;
        let noise = front + 1..front + SECTOR;
        flash.fill(|cell| if noise.contains(&cell) { random.u8(..) & random.u8(..) } else { ERASED });
        let mut buffer = [0; BUFFER];
        let mut records = Records::new(&mut flash, &mut buffer);
        let mut contents = Contents::empty();
        assert_eq!(records.read(&mut contents), Err(Unreadable), "seed {seed}");
        assert_eq!(contents.setting, None);
        // A further read reports the damage again.
        assert_eq!(records.read(&mut contents), Err(Unreadable), "seed {seed}");
    }
}

#[test]
fn a_cleared_memory_is_new_and_keeps_the_setting() {
    for kept in [None, Some(NEW)] {
        let mut flash = Flash::new();
        clear(&mut flash).unwrap();
        assert_eq!(operations(&flash), 0, "there is nothing to clear");
        for flash in [with_stores(kept, 1), with_stores(kept, 7), with_stores(kept, 130), in_a_move(kept)] {
            let mut flash = flash;
            clear(&mut flash).unwrap();
            assert!(image(&flash).is_new());
            assert_eq!(setting(&flash).as_deref(), kept);
            let before = operations(&flash);
            clear(&mut flash).unwrap();
            assert_eq!(operations(&flash), before, "what is clear is not written to");
            for number in 0..400 {
                store(&mut flash, RecordKey::Parameters, &record(&numbered(number))).unwrap();
            }
            assert_eq!(held(&flash), [None, None, Some(numbered(399)), None, None, None]);
            assert_eq!(setting(&flash).as_deref(), kept);
        }
    }
}

#[test]
fn no_flipped_bit_brings_back_what_was_cleared() {
    let mut flash = with_stores(Some(NEW), 12);
    clear(&mut flash).unwrap();
    for bit in 0..(flash.words_in_use() + 2) * WORD * 8 {
        let mut flash = flash.clone();
        flash.flip_bit(bit);
        assert!(image(&flash).is_new(), "bit {bit}");
    }
}

/// Checks a flash after a power cut or a failure during clearing, and that a second clearing completes.
#[track_caller]
fn check_cut(mut flash: Flash, before: &Held, kept: Option<&[u8]>, what: &str) {
    let found = held(&flash);
    assert!(found == *before || found.iter().all(Option::is_none), "{what}: all as before, or all absent");
    assert_eq!(setting(&flash).as_deref(), kept, "{what}");
    clear(&mut flash).unwrap();
    assert!(image(&flash).is_new(), "{what}");
    assert_eq!(setting(&flash).as_deref(), kept, "{what}");
    store(&mut flash, RecordKey::FaultLog, &record(b"again")).unwrap();
    assert_eq!(held(&flash), [None, None, None, None, Some(b"again".to_vec()), None], "{what}");
}

/// Returns the flash after a cut or failure `after` operations of the clearing.
fn disturbed(flash: &Flash, disturb: fn(&mut Flash, u64), after: u64) -> Flash {
    let mut flash = flash.clone();
    flash.set_torn_erase(TornErase::ALL[after as usize % 5]);
    flash.seed_noise(after);
    disturb(&mut flash, after);
    let _ = clear(&mut flash);
    flash.restore_power();
    flash
}

#[test]
fn a_cut_or_failure_at_any_word_of_clearing() {
    for kept in [None, Some(NEW)] {
        for flash in [with_stores(kept, 1), with_stores(kept, 7), with_stores(kept, 23), in_a_move(kept)] {
            let before = held(&flash);
            let mut done = flash.clone();
            clear(&mut done).unwrap();
            let total = operations(&done) - operations(&flash);
            assert!(total >= 5);
            for after in 0..total {
                for disturb in [Flash::cut_power_after, Flash::fail_once_after] {
                    check_cut(
                        disturbed(&flash, disturb, after),
                        &before,
                        kept,
                        &format!("{after} of {total}, {kept:?}"),
                    );
                }
            }
        }
    }
}

#[test]
fn one_cut_of_clearing_after_the_other() {
    for kept in [None, Some(NEW)] {
        let flash = with_stores(kept, 9);
        let before = held(&flash);
        for first in 0..40 {
            let once = disturbed(&flash, Flash::cut_power_after, first);
            for second in 0..40 {
                let twice = disturbed(&once, Flash::cut_power_after, second);
                check_cut(twice, &before, kept, &format!("{first}, then {second}, {kept:?}"));
            }
        }
    }
}
