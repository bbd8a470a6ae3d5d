//! The flash, its records, and their state after every kind of accident.

use protocol_core::memory::{Corrupt, seal};

use super::*;

const VERSION: u8 = 1;

pub(super) fn record(payload: &[u8]) -> Record {
    seal(VERSION, payload).unwrap()
}

pub(super) fn payload(image: &Image, key: RecordKey) -> Option<Vec<u8>> {
    image.payload(key, VERSION).unwrap().map(<[u8]>::to_vec)
}

/// Returns a payload of 90 bytes: a sector is full after about 150 stores.
pub(super) fn numbered(number: u32) -> Vec<u8> {
    let mut bytes = vec![number as u8; 90];
    bytes[..4].copy_from_slice(&number.to_le_bytes());
    bytes
}

/// Returns a memory after `count` stores under changing keys, and the content of each key.
pub(super) fn with_history(count: u32) -> (Memory, Vec<Option<Vec<u8>>>) {
    let mut memory = Memory::in_ram();
    let mut held = vec![None; RecordKey::ALL.len()];
    for number in 0..count {
        // The factory record is written once and must survive.
        let key = if number == 0 { 0 } else { 1 + number as usize % 5 };
        memory.store(RecordKey::ALL[key], &record(&numbered(number))).unwrap();
        held[key] = Some(numbered(number));
    }
    (memory, held)
}

pub(super) fn held(memory: &mut Memory) -> Vec<Option<Vec<u8>>> {
    let image = memory.read_image();
    assert!(!image.is_damaged());
    RecordKey::ALL.map(|key| payload(&image, key)).to_vec()
}

#[test]
fn a_new_memory_is_new() {
    let mut memory = Memory::in_ram();
    assert!(memory.read_image().is_new());
    assert_eq!((memory.flash().word_writes(), memory.flash().erases()), (0, 0));
}

#[test]
fn records_outlive_many_rewrites() {
    let (mut memory, expected) = with_history(700);
    assert_eq!(held(&mut memory), expected);
    assert!(memory.flash().erases() >= 2, "{}", memory.flash().erases());
}

#[test]
fn a_cut_in_proportion_cuts_at_that_word() {
    let mut memory = Memory::in_ram();
    memory.store(RecordKey::Parameters, &record(&[1; 90])).unwrap();
    let before = memory.flash().word_writes();
    // Header of 2 words, key and 96 bytes: 25 words.
    memory.store_cut(RecordKey::Parameters, &record(&[2; 90]), 1, 3);
    assert_eq!(memory.flash().word_writes() - before, 27 / 3);
    memory.store_cut(RecordKey::Parameters, &record(&[2; 90]), 0, 3);
    assert_eq!(payload(&memory.read_image(), RecordKey::Parameters), Some(vec![1; 90]));
}

#[test]
fn writes_that_fail_change_nothing() {
    let (mut memory, expected) = with_history(3);
    memory.set_write_fails(true);
    let image = memory.flash().image();
    assert_eq!(memory.store(RecordKey::Parameters, &record(b"x")), Err(StoreError));
    assert!(memory.flash().image() == image);
    assert_eq!(held(&mut memory), expected);
    memory.set_write_fails(false);
    assert_eq!(memory.store(RecordKey::Parameters, &record(b"x")), Ok(()));
}

#[test]
fn no_flipped_bit_gives_a_record_that_was_never_stored() {
    let (memory, _) = with_history(8);
    let used = memory.flash().words_in_use() * 32;
    let mut fallen_back = 0;
    for bit in (0..used + 64).step_by(5) {
        let mut memory = Memory::with_flash(memory.flash().clone());
        memory.flash_mut().flip_bit(bit);
        let image = memory.read_image();
        for key in RecordKey::ALL {
            if let Ok(Some(found)) = image.payload(key, VERSION) {
                let number = u32::from_le_bytes(found[..4].try_into().unwrap());
                assert_eq!(found, numbered(number), "bit {bit}");
                fallen_back += u32::from(number < 4 && key != RecordKey::Factory);
            }
        }
        memory.store(RecordKey::Parameters, &record(b"again")).unwrap();
        assert_eq!(payload(&memory.read_image(), RecordKey::Parameters).as_deref(), Some(&b"again"[..]));
    }
    assert!(fallen_back > 20, "a flipped bit in the newest record brings the one before back: {fallen_back}");
}

#[test]
fn noise_is_a_damaged_memory_that_can_be_written_again() {
    for seed in 0..60 {
        let mut noise = fastrand::Rng::with_seed(seed);
        let mut memory = Memory::in_ram();
        match seed {
            0 => memory.flash_mut().fill(|_| 0),
            1 => memory.flash_mut().fill(|_| 0x55),
            _ => memory.flash_mut().fill(|_| noise.u8(..)),
        }
        let unreadable = memory.flash().image();
        let image = memory.read_image();
        assert!(image.is_damaged(), "seed {seed}");
        assert!(memory.put_aside() == Some(&unreadable[..]), "seed {seed}: kept as it was");
        memory.store(RecordKey::Factory, &record(b"new")).unwrap();
        let image = memory.read_image();
        assert!(!image.is_damaged(), "told once");
        assert_eq!(payload(&image, RecordKey::Factory).as_deref(), Some(&b"new"[..]));
    }
}

#[test]
fn a_damaged_memory_that_cannot_be_erased_stays() {
    let mut memory = Memory::in_ram();
    memory.flash_mut().fill(|_| 0);
    memory.set_write_fails(true);
    for _ in 0..2 {
        let image = memory.read_image();
        assert!(image.is_damaged() || image.payload(RecordKey::Factory, VERSION) == Err(Corrupt));
    }
    assert!(memory.flash().image().iter().all(|cell| *cell == 0));
}

mod flash {
    use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

    use super::*;

    #[test]
    fn writing_only_clears_bits() {
        let mut flash = Flash::new();
        flash.write(8, &[0xF0, 0xFF, 0x0F, 0]).unwrap();
        flash.write(8, &[0x33; 4]).unwrap();
        let mut word = [0; 4];
        flash.read(8, &mut word).unwrap();
        assert_eq!(word, [0x30, 0x33, 0x03, 0]);
        flash.erase(0, SECTOR as u32).unwrap();
        flash.read(8, &mut word).unwrap();
        assert_eq!(word, [ERASED; 4]);
        assert_eq!((flash.word_writes(), flash.erases()), (2, 1));
    }

    #[test]
    fn words_and_sectors_are_kept_to() {
        let mut flash = Flash::new();
        assert_eq!(flash.write(2, &[0; 4]), Err(FlashError::NotAligned));
        assert_eq!(flash.write(4, &[0; 3]), Err(FlashError::NotAligned));
        assert_eq!(flash.write(SIZE as u32, &[0; 4]), Err(FlashError::OutOfBounds));
        assert_eq!(flash.erase(0, 4), Err(FlashError::NotAligned));
        assert_eq!(flash.erase(4, 0), Err(FlashError::OutOfBounds));
        assert_eq!(flash.read(SIZE as u32 - 1, &mut [0; 2]), Err(FlashError::OutOfBounds));
        assert_eq!(flash.words_in_use(), 0);
    }

    #[test]
    fn a_power_cut_tears_one_word_and_stops_everything() {
        let mut flash = Flash::new();
        flash.cut_power_after(1);
        assert_eq!(flash.write(0, &[0; 12]), Err(FlashError::PowerCut));
        assert_eq!(flash.image()[..4], [0; 4]);
        assert_eq!(flash.image()[8..12], [ERASED; 4]);
        assert_eq!(flash.read(0, &mut [0]), Err(FlashError::PowerCut));
        assert_eq!(flash.write(12, &[0; 4]), Err(FlashError::PowerCut));
        flash.restore_power();
        assert_eq!(flash.write(12, &[0; 4]), Ok(()));
    }

    #[test]
    fn a_cut_erase_leaves_half_a_sector() {
        let mut flash = Flash::new();
        flash.fill(|_| 0);
        flash.cut_power_after(1);
        assert_eq!(flash.erase(0, SIZE as u32), Err(FlashError::PowerCut));
        let second = &flash.image()[SECTOR..];
        assert!(flash.image()[..SECTOR] == [ERASED; SECTOR]);
        let erased = second.iter().take_while(|cell| **cell == ERASED).count();
        let untouched = second.iter().rev().take_while(|cell| **cell == 0).count();
        assert!(erased + untouched >= SECTOR - WORD, "{erased} erased, {untouched} untouched");
        assert!(untouched > 0);
    }
}
