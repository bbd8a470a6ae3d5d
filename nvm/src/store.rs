//! The records, each stored under its key in a [log](crate::log) of entries.
//!
//! The store adds an inventory of all keys ever stored to the log. The inventory distinguishes lost records from
//! records that were never written.
//!
//! The store keeps no state between operations. Each operation scans the flash as a start does, from the oldest entry
//! to the newest.
//!
//! Besides the records of the device, the store contains a setting of the platform, such as the kind of device.

use embedded_storage::nor_flash::NorFlash;
use heapless::Vec;
use protocol_core::memory::{Image, Record, RecordKey, StoreError, open, seal};

use crate::log::{HEADER, Log};
use crate::{BUFFER, INVENTORY, SETTING, record_key};

/// The maximum length of a setting, in bytes.
pub const SETTING_MAX: usize = 8;

/// The inventory of a memory without records. An inventory is a byte with a bit for each record. The bit is set once
/// the record has been stored.
const NOTHING: u8 = 0;

/// The version of the setting's encoding.
const SETTING_VERSION: u8 = 1;

/// Returns the maximum number of bytes that interrupted first stores leave behind: the size of four inventories.
const fn first_stores<F: NorFlash>() -> usize {
    4 * (HEADER + 1).next_multiple_of(F::WRITE_SIZE)
}

/// The setting of a platform: arbitrary bytes.
pub type Setting = Vec<u8, SETTING_MAX>;

/// The contents of a memory.
#[derive(Debug)]
pub struct Contents {
    /// The records of the device.
    pub image: Image,
    /// The setting of the platform; `None` if it is missing or damaged.
    pub setting: Option<Setting>,
}

impl Contents {
    /// Creates the contents of a memory that was never written.
    #[must_use]
    pub const fn empty() -> Self {
        Self { image: Image::empty(), setting: None }
    }
}

/// The error for a flash without an intact entry that holds more data than interrupted first stores leave behind.
#[derive(Debug, PartialEq, Eq)]
pub struct Unreadable;

/// A summary of the contents that a start would find.
#[derive(Default)]
struct Survey {
    /// Whether the flash holds an entry.
    any: bool,
    /// The bits of the records found.
    stored: u8,
    /// The bits of the records ever stored; `None` if the inventory is missing or damaged.
    inventory: Option<u8>,
}

impl Survey {
    /// Adds a scanned entry, which replaces earlier entries with its key. A beginning invalidates all earlier records.
    fn note(&mut self, key: u8, bytes: &[u8], is_beginning: bool) {
        self.any = true;
        if is_beginning {
            self.stored = 0;
        }
        match (record_key(key), bytes) {
            (Some(key), _) => self.stored |= bit(key),
            (None, [inventory]) if key == INVENTORY => self.inventory = Some(*inventory),
            (None, _) => {}
        }
    }

    fn inventory(&self) -> u8 {
        self.inventory.unwrap_or(NOTHING)
    }

    /// Returns whether a record was stored once and is missing now.
    fn misses(&self, key: RecordKey) -> bool {
        self.inventory() & !self.stored & bit(key) != 0
    }
}

/// The records in a flash of two sectors.
pub struct Records<'buffer, F> {
    log: Log<'buffer, F>,
}

impl<'buffer, F: NorFlash> Records<'buffer, F> {
    /// Creates the records for a flash. The flash is not accessed.
    pub const fn new(flash: F, buffer: &'buffer mut [u8; BUFFER]) -> Self {
        Self { log: Log::new(flash, buffer) }
    }

    /// Writes a record. The previous version stays valid until the new version is complete.
    ///
    /// # Errors
    /// Returns [`StoreError`] if the flash fails or is full.
    pub fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        let found = self.put(key as u8, record)?;
        if found.inventory() & bit(key) == 0 {
            // The records just found are included, because the inventory may have been lost.
            let inventory = found.inventory() | found.stored;
            // The record is stored in any case. Its next store repeats a failed write of the inventory.
            let _ = self.write(INVENTORY, &[inventory], false);
        }
        Ok(())
    }

    /// Reads all contents. The flash does not change. In a damaged memory the newest intact version of a record counts
    /// (A). A record that was stored once and is missing now is unreadable in the image.
    ///
    /// # Errors
    /// Returns [`Unreadable`] if the flash holds no intact entry, but more data than interrupted first stores leave
    /// behind. The contents then have no setting.
    pub fn read(&mut self, contents: &mut Contents) -> Result<(), Unreadable> {
        let Contents { image, setting } = contents;
        image.clear();
        *setting = None;
        let mut found = Survey::default();
        let scanned = self.log.scan(&mut |key, bytes, is_beginning| {
            found.note(key, bytes, is_beginning);
            if is_beginning {
                image.clear();
            }
            if key == SETTING {
                *setting = open(SETTING_VERSION, bytes).and_then(|bytes| Vec::from_slice(bytes).ok());
            } else if let Some(key) = record_key(key) {
                image.put(key, bytes);
            }
        });
        let lost = |key: &RecordKey| scanned.is_err() || found.misses(*key);
        RecordKey::ALL.into_iter().filter(lost).for_each(|key| image.put_unreadable(key));
        // Interrupted first stores leave less data, so these data come from elsewhere.
        let is_noise =
            scanned.is_ok() && !found.any && self.log.in_use().is_ok_and(|bytes| bytes > first_stores::<F>());
        if is_noise { Err(Unreadable) } else { Ok(()) }
    }

    /// Writes the setting of the platform. The previous setting stays valid until the new setting is complete.
    ///
    /// # Errors
    /// Returns [`StoreError`] for a setting longer than [`SETTING_MAX`], and if the flash fails.
    pub fn store_setting(&mut self, setting: &[u8]) -> Result<(), StoreError> {
        let setting = Vec::<u8, SETTING_MAX>::from_slice(setting).map_err(|_| StoreError)?;
        self.put(SETTING, &seal(SETTING_VERSION, &setting)?).map(drop)
    }

    /// Writes an entry. An empty log gets an inventory first.
    fn put(&mut self, key: u8, bytes: &[u8]) -> Result<Survey, StoreError> {
        let (found, held_before) = self.survey(key, bytes)?;
        self.begin(&found)?;
        self.write(key, bytes, held_before)
    }

    /// Writes an inventory into an empty log. An inventory is so short that interrupted attempts leave little behind.
    /// Once it is written, the remains of later power cuts cannot be mistaken for foreign data.
    fn begin(&mut self, found: &Survey) -> Result<(), StoreError> {
        if found.any { Ok(()) } else { self.write(INVENTORY, &[NOTHING], false).map(drop) }
    }

    /// Writes an entry and scans the flash. Succeeds if the scan finds the content. If the write itself failed, the
    /// content must not have been stored before (`held_before`). Returns a summary of the contents that a start would
    /// find.
    fn write(&mut self, key: u8, bytes: &[u8], held_before: bool) -> Result<Survey, StoreError> {
        let stored = self.log.append(key, bytes);
        // A write can fail after it has completed the entry, so the scan decides.
        match (stored, self.survey(key, bytes)?) {
            (Ok(()), (found, true)) => Ok(found),
            (Err(_), (found, true)) if !held_before => Ok(found),
            _ => Err(StoreError),
        }
    }

    /// Scans the flash. Returns a summary of the contents that a start would find, and whether the newest entry of
    /// `key` holds `bytes`.
    fn survey(&mut self, key: u8, bytes: &[u8]) -> Result<(Survey, bool), StoreError> {
        let mut survey = Survey::default();
        let mut holds = false;
        let scanned = self.log.scan(&mut |found, content, is_beginning| {
            survey.note(found, content, is_beginning);
            if found == key {
                holds = content == bytes;
            } else if is_beginning && key != SETTING {
                holds = false;
            }
        });
        scanned.map(|()| (survey, holds)).map_err(|_| StoreError)
    }

    /// Removes all records, old versions included, so that no flipped bit can restore a record. The setting stays.
    ///
    /// A power cut leaves all records or none, and another call completes an interrupted removal. A memory without
    /// records is not written.
    ///
    /// # Errors
    /// Returns [`StoreError`] if the flash fails.
    pub fn clear(&mut self) -> Result<(), StoreError> {
        let (found, _) = self.survey(INVENTORY, &[])?;
        if self.is_clear(&found)? {
            return Ok(());
        }
        self.begin(&found)?;
        self.log.begin_anew(&[NOTHING]).or_else(|error| {
            // The operation can fail after it has removed everything.
            let (found, _) = self.survey(INVENTORY, &[])?;
            if self.is_clear(&found)? { Ok(()) } else { Err(error) }
        })
    }

    /// Returns whether the flash is free of records and of their remains.
    fn is_clear(&mut self, found: &Survey) -> Result<bool, StoreError> {
        let has_leftovers = self.log.has_leftovers().map_err(|_| StoreError)?;
        Ok(found.stored == 0 && found.inventory() == NOTHING && !has_leftovers)
    }
}

const fn bit(key: RecordKey) -> u8 {
    1 << key as u8
}
