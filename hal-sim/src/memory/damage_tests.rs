//! Damage of any length that looks like an entry (SPEC 6): entries behind it are found, and the memory remains
//! writable.

use super::tests::{held, numbered, payload, record, with_history};
use super::*;

/// The header of an entry: mark, key, length, beginning flag, sequence number and checksum.
const HEADER: usize = 12;

/// Valid and invalid lengths of an entry.
const LENGTHS: [u8; 7] = [0, 1, 40, 127, 128, 129, 255];

/// Returns the offsets of the entries in the first sector, and of the free space after them.
fn items(flash: &Flash) -> Vec<usize> {
    let mut starts = vec![0];
    loop {
        let start = starts[starts.len() - 1];
        let header = &flash.image()[start..start + HEADER];
        if header == [ERASED; HEADER] {
            return starts;
        }
        assert!(header[0] == 0x4E && header[1] <= 6, "a mark and a key");
        starts.push(start + (HEADER + usize::from(header[2])).next_multiple_of(WORD));
    }
}

/// Writes the header of an entry with this length and the newest sequence number.
fn with_header(flash: &Flash, at: usize, length: u8) -> Flash {
    let mut image = flash.image();
    image[at..at + HEADER].copy_from_slice(&[0x4E, 3, length, 0, 0, 0, 0, 0x7F, 0x11, 0x11, 0x11, 0x11]);
    Flash::from_image(image).unwrap()
}

/// Stores each record except the factory record until the sector changes, and checks that nothing is lost.
#[track_caller]
fn lives_on(memory: &mut Memory, factory: &Option<Vec<u8>>, what: &str) {
    let mut expected = [const { None }; RecordKey::ALL.len()];
    for number in 1000..1180 {
        let key = RecordKey::ALL[1 + number as usize % 5];
        memory.store(key, &record(&numbered(number))).unwrap();
        expected[key.position()] = Some(numbered(number));
        assert_eq!(payload(&memory.read_image(), key), expected[key.position()], "{key:?} {what}");
        if number % 61 == 0 {
            let image = memory.read_image();
            for key in &RecordKey::ALL[1..] {
                let found = payload(&image, *key);
                assert!(expected[key.position()].is_none() || found == expected[key.position()], "{key:?} {what}");
            }
            let found = image.payload(RecordKey::Factory, 1).ok().flatten().map(<[u8]>::to_vec);
            assert_eq!(found, *factory, "{what}");
        }
    }
    assert!(memory.flash().erases() >= 1);
}

#[test]
fn an_item_of_any_length_hides_only_itself() {
    let (memory, newest) = with_history(12);
    let items = items(memory.flash());
    for (item, at) in items.iter().enumerate() {
        for length in LENGTHS {
            let what = format!("item {item} of {}, length {length}", items.len());
            let mut memory = Memory::with_flash(with_header(memory.flash(), *at, length));
            let image = memory.read_image();
            assert!(!image.is_damaged(), "{what}");
            let mut older = 0;
            for key in RecordKey::ALL {
                match image.payload(key, 1) {
                    Ok(Some(found)) if newest[key.position()].as_deref() == Some(found) => {}
                    // The factory record has no older version, and the inventory reports it missing.
                    Ok(Some(found)) => {
                        assert!(key != RecordKey::Factory && found == numbered(u32::from(found[0])), "{what}");
                        older += 1;
                    }
                    Ok(None) => panic!("{key:?} is lost and nobody knows, {what}"),
                    Err(_) => {
                        assert_eq!(key, RecordKey::Factory, "{what}");
                        older += 1;
                    }
                }
            }
            assert!(older <= 1, "{what}: {older}");
        }
    }
}

#[test]
fn a_memory_with_an_item_of_any_length_lives_on() {
    let (memory, newest) = with_history(6);
    let items = items(memory.flash());
    for (item, at) in items.iter().enumerate() {
        for length in [0, 40, 128, 255] {
            let mut memory = Memory::with_flash(with_header(memory.flash(), *at, length));
            let factory = memory.read_image().payload(RecordKey::Factory, 1).ok().flatten().map(<[u8]>::to_vec);
            assert!(factory.is_none() || factory == newest[0]);
            lives_on(&mut memory, &factory, &format!("item {item}, length {length}"));
        }
    }
}

#[test]
fn an_item_of_any_length_in_a_sector_that_is_not_used_yet() {
    let (memory, newest) = with_history(6);
    for at in [SECTOR / 2, SECTOR + WORD, SECTOR + WORD + 24, SECTOR + 5000] {
        for length in LENGTHS {
            let mut memory = Memory::with_flash(with_header(memory.flash(), at, length));
            assert_eq!(held(&mut memory), newest, "{at}, length {length}");
            lives_on(&mut memory, &newest[0], &format!("{at}, length {length}"));
        }
    }
}

#[test]
fn a_sector_that_makes_no_sense_beside_one_that_does() {
    for count in [8, 160] {
        let (memory, newest) = with_history(count);
        let used = if memory.flash().erases() == 0 { 0 } else { SECTOR };
        // The last two are the marks of a full sector and of a sector in use.
        let marks = [(ERASED, 0), (ERASED, ERASED), (0, 0), (0, ERASED)];
        for (seed, (front, end)) in marks.into_iter().cycle().take(8).enumerate() {
            let mut random = fastrand::Rng::with_seed(seed as u64);
            let mut image = memory.flash().image();
            let other = &mut image[SECTOR - used..][..SECTOR - 128];
            other.fill_with(|| random.u8(..));
            (other[0], other[SECTOR - 128 - 1]) = (front, end);
            let mut memory = Memory::with_flash(Flash::from_image(image).unwrap());
            let what = format!("{count} stores, seed {seed}");
            assert_eq!(held(&mut memory), newest, "{what}");
            lives_on(&mut memory, &newest[0], &what);
        }
    }
}

#[test]
fn noise_full_of_items_does_no_harm() {
    for seed in 0..40 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut memory = Memory::in_ram();
        let zeros = random.usize(1..20);
        memory.flash_mut().fill(|_| if random.usize(..20) < zeros { 0 } else { random.u8(..) });
        for _ in 0..random.usize(..400) {
            let (at, length) = (random.usize(..SIZE / WORD - 3) * WORD, random.u8(..));
            let flash = with_header(memory.flash(), at, length);
            *memory.flash_mut() = flash;
        }
        memory.read_image();
        memory.store(RecordKey::Parameters, &record(b"new")).unwrap();
        assert_eq!(payload(&memory.read_image(), RecordKey::Parameters).as_deref(), Some(&b"new"[..]), "seed {seed}");
    }
}

#[test]
fn nothing_is_lost_in_a_gap_between_items() {
    let (memory, _) = with_history(12);
    let items = items(memory.flash());
    for (first, from) in items.iter().enumerate().skip(6) {
        for to in &items[first + 1..] {
            let mut image = memory.flash().image();
            image[*from..*to].fill(ERASED);
            let mut memory = Memory::with_flash(Flash::from_image(image).unwrap());
            let mut stored = Vec::new();
            // The first record stored is in the gap, and the later ones close it.
            for number in 100..106 {
                let key = RecordKey::ALL[1 + number as usize % 5];
                memory.store(key, &record(&numbered(number))).unwrap();
                stored.retain(|(other, _)| *other != key);
                stored.push((key, numbered(number)));
                let image = memory.read_image();
                for (key, content) in &stored {
                    assert_eq!(payload(&image, *key).as_ref(), Some(content), "{key:?}, {from}..{to}, store {number}");
                }
            }
        }
    }
}

#[test]
fn a_sector_without_its_mark_keeps_its_items() {
    for count in [12, 140] {
        for other in [ERASED, 0] {
            let (memory, newest) = with_history(count);
            assert_eq!(memory.flash().erases(), 0);
            let mut image = memory.flash().image();
            image[..WORD].fill(ERASED);
            image[SECTOR..].fill(other);
            let mut memory = Memory::with_flash(Flash::from_image(image).unwrap());
            assert_eq!(held(&mut memory), newest);
            lives_on(&mut memory, &newest[0], &format!("{count} stores beside {other:02X}"));
        }
    }
}

/// Entries after the lost beginning of a sector are found.
#[test]
fn what_lies_behind_a_lost_begin_is_there() {
    let mut memory = Memory::in_ram();
    for key in [RecordKey::RestoreFlag, RecordKey::FaultLog] {
        memory.store(key, &record(&[])).unwrap();
    }
    let mut image = memory.flash().image();
    // The first inventory and the header of the first record.
    image[..28].fill(ERASED);
    let mut memory = Memory::with_flash(Flash::from_image(image).unwrap());
    for stored in [false, true] {
        let image = memory.read_image();
        assert!(image.payload(RecordKey::RestoreFlag, 1).is_err());
        assert_eq!(image.payload(RecordKey::FaultLog, 1), Ok(Some(&b""[..])));
        assert_eq!(image.payload(RecordKey::LocalLayer, 1), Ok(stored.then_some(&b"new"[..])));
        memory.store(RecordKey::LocalLayer, &record(b"new")).unwrap();
    }
}
