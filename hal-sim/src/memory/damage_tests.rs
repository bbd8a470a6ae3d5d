//! Damage that passes for an item, of a length that no item has (SPEC 6): what lies behind it is found, and the memory
//! can be written as before.

use super::tests::{held, numbered, payload, record, with_history};
use super::*;

/// An item begins with the checksum of its data, its length and the checksum of that.
const HEADER: usize = 8;

/// Lengths that no item has: none, longer than key and record, up to the end of the sector and beyond.
const LENGTHS: [u16; 10] = [0, 130, 132, 133, 160, 161, 1000, 8000, 16000, 0xFFFE];

/// The checksum that the map gives to a length: CRC-16 with the reversed polynomial 0x1A2E.
fn checksum(length: u16) -> u16 {
    let crc = length.to_le_bytes().iter().fold(0xFFFF_u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0x1A2E } else { 0 })
    });
    !crc
}

/// Where the items of the first sector begin, and where the next one would.
fn items(flash: &Flash) -> Vec<usize> {
    let mut starts = vec![WORD];
    loop {
        let start = starts[starts.len() - 1];
        let header = &flash.image()[start..start + HEADER];
        if header == [ERASED; HEADER] {
            return starts;
        }
        let length = u16::from_le_bytes([header[4], header[5]]);
        assert_eq!(u16::from_le_bytes([header[6], header[7]]), checksum(length), "as the map computes it");
        starts.push(start + HEADER + usize::from(length).next_multiple_of(WORD));
    }
}

/// Puts the header of an item of this length there; what checks the data is right for one without any.
fn with_header(flash: &Flash, at: usize, length: u16) -> Flash {
    let mut image = flash.image();
    image[at..at + 4].fill(0x11);
    image[at + 4..at + 6].copy_from_slice(&length.to_le_bytes());
    image[at + 6..at + 8].copy_from_slice(&checksum(length).to_le_bytes());
    Flash::from_image(image).unwrap()
}

/// Stores each record but the factory's, until the sector was changed; nothing is lost.
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
                    // The factory record has no older one, and the inventory says that it is missing.
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
        for length in [0, 130, 8000, 16000] {
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
        // The last two are those of a sector that is full, and of one that is in use.
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
            let (at, length) = (random.usize(..SIZE / WORD - 2) * WORD, random.u16(..) >> random.u32(..16));
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
            // What is stored first lies in the gap, and what comes later closes it.
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
    // The last of these fills its sector.
    for count in [12, 147, 148, 149] {
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

/// Items behind a begin of a sector that was lost, too few to be told from what power cuts leave of first stores.
#[test]
fn what_read_as_nothing_does_not_come_back() {
    let mut memory = Memory::in_ram();
    for key in [RecordKey::RestoreFlag, RecordKey::FaultLog] {
        memory.store(key, &record(&[])).unwrap();
    }
    let mut image = memory.flash().image();
    // The mark of the sector, and the first item.
    image[..40].fill(ERASED);
    let mut memory = Memory::with_flash(Flash::from_image(image).unwrap());
    assert!(memory.read_image().is_new());
    memory.store(RecordKey::LocalLayer, &record(b"new")).unwrap();
    let image = memory.read_image();
    assert_eq!(image.payload(RecordKey::LocalLayer, 1), Ok(Some(&b"new"[..])));
    for key in [RecordKey::RestoreFlag, RecordKey::FaultLog] {
        assert_eq!(image.payload(key, 1), Ok(None), "{key:?}");
    }
}
