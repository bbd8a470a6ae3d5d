//! The non-volatile memory of the devices: records in a NOR flash of two sectors. The host runs it over a simulated
//! flash, the board over its own: what a power cut cannot break there, it cannot break here.
//!
//! ```text
//! store    records under their keys, and which were ever stored
//! log      entries in the flash: the newest intact one of a key counts
//! legacy   the layout before this one, to be read
//! ```
//!
//! Every call runs to its end: a flash that takes its time blocks the caller, which on the board is a task below all
//! others. Nothing can be dropped half done.
#![no_std]
#![forbid(unsafe_code)]

mod legacy;
mod log;
mod store;

use protocol_core::memory::{RECORD_MAX, RecordKey};

pub use store::{Contents, Records, SETTING_MAX, Setting, Unreadable};

/// What an erased byte reads.
pub const ERASED: u8 = 0xFF;

/// The sectors of a memory: one holds it, the other is where it goes when that is full.
const SECTORS: usize = 2;

/// The longest word that there is room for, in bytes.
const WORD_MAX: usize = 32;

/// The longest content of an entry, in bytes.
const ITEM_MAX: usize = RECORD_MAX;

/// The bytes that [`Records`] works in: the longest entry, in whole words of whatever length.
pub const BUFFER: usize = (log::HEADER + ITEM_MAX).next_multiple_of(WORD_MAX);

/// The key of the inventory.
const INVENTORY: u8 = 0;

/// The key of the setting. It differs in many bits from the keys of the records.
const SETTING: u8 = 0xFF;

/// The number of keys: the inventory, the records and the setting.
const KEYS: usize = RecordKey::ALL.len() + 2;

fn record_key(key: u8) -> Option<RecordKey> {
    RecordKey::ALL.into_iter().find(|record| *record as u8 == key)
}

fn is_key(key: u8) -> bool {
    matches!(key, INVENTORY | SETTING) || record_key(key).is_some()
}

/// Returns the place of a key among all.
fn place_of(key: u8) -> usize {
    match key {
        INVENTORY => 0,
        SETTING => KEYS - 1,
        key => record_key(key).map_or(0, |key| 1 + key.position()),
    }
}
