//! The worst-case number of flash reads, which delays a start on the board.

use protocol_core::memory::seal;

use super::*;

/// The number of reads of each operation.
struct Reads {
    start: u64,
    store: u64,
    store_that_erases: u64,
}

/// Returns the worst case: a sector full of records with this payload.
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
fn a_start_reads_each_entry_twice_and_a_store_a_few_times() {
    for (payload, entries) in [(1, 819), (90, 151)] {
        let Reads { start, store, store_that_erases } = worst(&vec![1; payload]);
        // For each entry: its first word, its header, and the whole entry; then the rest of the sectors.
        let walk = 3 * entries + 460;
        assert!(start <= walk, "{start} for a start, {payload} bytes");
        // One walk for the content, one for the free space, one for the result.
        assert!(store <= 3 * walk + 20, "{store} for a store, {payload} bytes");
        assert!(store_that_erases <= 5 * walk + 100, "{store_that_erases} for an erase, {payload} bytes");
    }
}
