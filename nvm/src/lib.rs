//! The non-volatile memory of the devices: records in a NOR flash of two sectors. The host runs this code on a
//! simulated flash, and the board on its own flash.
//!
//! # Layers
//!
//! The log writes entries to one sector until it is full, then copies the newest entries to the other sector. Above the
//! log, the store manages a record for each key, an inventory of all keys ever stored, and a setting of the platform.
//! Beside the log, a reader imports the records of flashes that still have the previous layout.
//!
//! ```text
//! store    records by key, inventory and setting
//! log      entries in the flash
//! legacy   reader for the previous layout
//! ```
//!
//! Every call blocks until it succeeds or fails. A later write repeats an interrupted move. On the board, the task with
//! the lowest priority makes the calls.
//!
//! # A record in a flash
//!
//! ```
//! # use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
//! # struct Flash([u8; 4096]);
//! # impl ErrorType for Flash {
//! #     type Error = NorFlashErrorKind;
//! # }
//! # impl ReadNorFlash for Flash {
//! #     const READ_SIZE: usize = 1;
//! #     fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
//! #         bytes.copy_from_slice(&self.0[offset as usize..][..bytes.len()]);
//! #         Ok(())
//! #     }
//! #     fn capacity(&self) -> usize {
//! #         self.0.len()
//! #     }
//! # }
//! # impl NorFlash for Flash {
//! #     const WRITE_SIZE: usize = 4;
//! #     const ERASE_SIZE: usize = 2048;
//! #     fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
//! #         self.0[from as usize..to as usize].fill(nvm::ERASED);
//! #         Ok(())
//! #     }
//! #     fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
//! #         self.0[offset as usize..][..bytes.len()].copy_from_slice(bytes);
//! #         Ok(())
//! #     }
//! # }
//! use nvm::{BUFFER, Contents, Records};
//! use protocol_core::memory::{RecordKey, seal};
//!
//! let mut flash = Flash([nvm::ERASED; 4096]); // two sectors in RAM, a `NorFlash`
//! let mut buffer = [0; BUFFER];
//! let mut records = Records::new(&mut flash, &mut buffer);
//! records.store(RecordKey::LocalLayer, &seal(1, b"node").unwrap()).unwrap();
//! records.store(RecordKey::LocalLayer, &seal(1, b"new").unwrap()).unwrap();
//!
//! let mut contents = Contents::empty();
//! records.read(&mut contents).unwrap(); // as at the next start
//! assert_eq!(contents.image.payload(RecordKey::LocalLayer, 1), Ok(Some(&b"new"[..])));
//! ```
#![no_std]
#![forbid(unsafe_code)]

mod legacy;
mod log;
mod store;

use protocol_core::memory::{RECORD_MAX, RecordKey};

pub use store::{Contents, Records, SETTING_MAX, Setting, Unreadable};

/// The value of an erased byte.
pub const ERASED: u8 = 0xFF;

/// The number of sectors of a memory. One sector holds the contents. When it is full, the newest entries move to the
/// other sector.
const SECTORS: usize = 2;

/// The maximum word size of a flash, in bytes.
const WORD_MAX: usize = 32;

/// The maximum length of an entry's content, in bytes.
const ITEM_MAX: usize = RECORD_MAX;

/// The size of the working buffer of [`Records`]: the longest entry, in whole words of any flash.
pub const BUFFER: usize = (log::HEADER + ITEM_MAX).next_multiple_of(WORD_MAX);

/// The key of the inventory.
const INVENTORY: u8 = 0;

/// The key of the setting. It differs from the record keys in many bits.
const SETTING: u8 = 0xFF;

/// The number of keys: inventory, records and setting.
const KEYS: usize = RecordKey::ALL.len() + 2;

fn record_key(key: u8) -> Option<RecordKey> {
    RecordKey::ALL.into_iter().find(|record| *record as u8 == key)
}

fn is_key(key: u8) -> bool {
    matches!(key, INVENTORY | SETTING) || record_key(key).is_some()
}

/// Returns the index of a key among all keys, 0 for the inventory.
fn index_of(key: u8) -> usize {
    match key {
        INVENTORY => 0,
        SETTING => KEYS - 1,
        key => record_key(key).map_or(0, |key| 1 + key.position()),
    }
}
