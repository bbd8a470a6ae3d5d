//! What a flash holds, and how it gets full.

use hal_sim::Memory;
use hal_sim::memory::{Flash, SECTOR, WORD};
use protocol_core::memory::RecordKey::{self, Factory};
use protocol_core::memory::seal;

/// The version of all records.
pub(crate) const VERSION: u8 = 1;

/// The payload of each record.
pub(crate) type Records = [Option<Vec<u8>>; RecordKey::ALL.len()];

pub(crate) fn records(flash: &Flash) -> Records {
    let image = Memory::with_flash(flash.clone()).read_image();
    assert!(!image.is_damaged());
    RecordKey::ALL.map(|key| image.payload(key, VERSION).expect("intact").map(<[u8]>::to_vec))
}

/// Stores a record once more that is there.
pub(crate) fn store_again(memory: &mut Memory, key: RecordKey) {
    let payload = records(memory.flash())[key.position()].clone().expect("stored at the first start");
    memory.store(key, &seal(VERSION, &payload).unwrap()).unwrap();
}

/// Stores the factory record again and again, until the first sector has some 600 bytes left.
pub(crate) fn wear(memory: &mut Memory) {
    while memory.flash().words_in_use() < SECTOR / WORD - 150 {
        store_again(memory, Factory);
    }
    assert_eq!(memory.flash().erases(), 0);
}
