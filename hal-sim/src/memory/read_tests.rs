//! How often the flash is read, at the worst: on the board, a start waits for it.

use protocol_core::memory::seal;

use super::*;

/// Reads of one operation.
struct Reads {
    start: u64,
    store: u64,
    store_that_erases: u64,
}

/// The most that there is to read: a sector full of records with so long a payload.
fn worst(payload: &[u8]) -> Reads {
    let mut memory = Memory::in_ram();
    let record = seal(1, payload).unwrap();
    for key in RecordKey::ALL {
        memory.store(key, &record).unwrap();
    }
    let (mut start, mut last) = (0, 0);
    loop {
        let before = memory.flash().reads();
        memory.store(RecordKey::RestoreFlag, &record).unwrap();
        let store = memory.flash().reads() - before;
        if memory.flash().erases() > 0 {
            return Reads { start, store: last, store_that_erases: store };
        }
        last = store;
        let before = memory.flash().reads();
        memory.read_image();
        start = memory.flash().reads() - before;
    }
}

#[test]
fn a_start_reads_each_item_once_and_a_store_twice() {
    // Each item takes two reads; the announcements of erases take 32, marks and ends a few.
    for (payload, items, kept) in [(1, 1012, 8), (90, 156, 8)] {
        let Reads { start, store, store_that_erases } = worst(&vec![1; payload]);
        assert!(start <= 2 * items + 32 + 16, "{start} for a start, {payload} bytes");
        // Before and after, and once only the headers for the place that is free; each time what is left of the sector.
        assert!(store <= 5 * items + 32 + 56, "{store} for a store, {payload} bytes");
        // The newest of each key is looked for once, not anew for each item; 127 look at the other sector, and
        // as many each time behind what is in it then.
        assert!(
            store_that_erases <= (2 * kept + 6) * items + 8 * 127 + 104,
            "{store_that_erases} for an erase, {payload} bytes"
        );
    }
}
