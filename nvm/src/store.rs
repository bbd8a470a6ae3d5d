//! Records under their keys in a flash: in a [log](crate::log) of entries.
//!
//! The store adds an inventory of the keys ever stored to the log: it tells a lost record from one that was never written.
//!
//! Nothing is kept between two operations: what counts is what a start would find, and a start goes through the entries
//! once, from the oldest to the newest.
//!
//! Beside the records of the device there is a setting of the platform, such as which device it is.

use embedded_storage::nor_flash::NorFlash;
use heapless::Vec;
use protocol_core::memory::{Image, Record, RecordKey, StoreError, open, seal};

use crate::log::{HEADER, Log};
use crate::{BUFFER, INVENTORY, SETTING, record_key};

/// The most bytes of a setting.
pub const SETTING_MAX: usize = 8;

/// The inventory of a memory without records: a byte with a bit for each record, set once that was stored.
const NOTHING: u8 = 0;

/// How the setting is encoded.
const SETTING_VERSION: u8 = 1;

/// Returns the most bytes in use that can be all that power cuts have left of first stores: of four inventories.
const fn first_stores<F: NorFlash>() -> usize {
    4 * (HEADER + 1).next_multiple_of(F::WRITE_SIZE)
}

/// The setting of a platform.
pub type Setting = Vec<u8, SETTING_MAX>;

/// Everything that is kept.
#[derive(Debug)]
pub struct Contents {
    /// The records of the device.
    pub image: Image,
    /// The setting of the platform, if there is one that is intact.
    pub setting: Option<Setting>,
}

impl Contents {
    /// Returns the contents of a memory that was never written.
    #[must_use]
    pub const fn empty() -> Self {
        Self { image: Image::empty(), setting: None }
    }
}

/// What is in the flash makes no sense.
#[derive(Debug, PartialEq, Eq)]
pub struct Unreadable;

/// What a start would find, in short.
#[derive(Default)]
struct Survey {
    /// Any entry at all.
    any: bool,
    /// The bits of the records that there are.
    stored: u8,
    /// The bits of the records that were stored once, as far as that is known.
    inventory: Option<u8>,
}

impl Survey {
    /// Notes one more entry; it replaces what came before under its key. From a beginning on nothing else counts.
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

    /// Returns whether this record was stored once and is not there.
    fn misses(&self, key: RecordKey) -> bool {
        self.inventory() & !self.stored & bit(key) != 0
    }
}

/// The records in a flash of two sectors.
pub struct Records<'buffer, F> {
    log: Log<'buffer, F>,
}

impl<'buffer, F: NorFlash> Records<'buffer, F> {
    /// Returns the records in a flash; nothing is read or written yet.
    pub const fn new(flash: F, buffer: &'buffer mut [u8; BUFFER]) -> Self {
        Self { log: Log::new(flash, buffer) }
    }

    /// Writes a record; what lay under its key before stays until the new one is complete.
    ///
    /// # Errors
    /// [`StoreError`] when the flash fails or cannot hold it.
    pub fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        let found = self.put(key as u8, record)?;
        if found.inventory() & bit(key) == 0 {
            // Which records there are was seen anew: the inventory itself may be what was lost.
            let inventory = found.inventory() | found.stored;
            // The record is stored, whatever becomes of this; the next store of it tries again.
            let _ = self.write(INVENTORY, &[inventory], false);
        }
        Ok(())
    }

    /// Reads everything, and changes nothing. Of a damaged memory the newest version of a record that is intact counts
    /// (A). A record that the flash does not give, although it was stored once, is unreadable in the image.
    ///
    /// # Errors
    /// [`Unreadable`] when the memory as a whole makes no sense; of the contents the setting is of use then, if there is
    /// one.
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
        // More than first stores leave behind, and nothing of it makes sense: that was something else once.
        let is_noise =
            scanned.is_ok() && !found.any && self.log.in_use().is_ok_and(|bytes| bytes > first_stores::<F>());
        if is_noise { Err(Unreadable) } else { Ok(()) }
    }

    /// Writes the setting of the platform; the one before stays until the new one is complete.
    ///
    /// # Errors
    /// [`StoreError`] when it is longer than [`SETTING_MAX`], or the flash fails.
    pub fn store_setting(&mut self, setting: &[u8]) -> Result<(), StoreError> {
        let setting = Vec::<u8, SETTING_MAX>::from_slice(setting).map_err(|_| StoreError)?;
        self.put(SETTING, &seal(SETTING_VERSION, &setting)?).map(drop)
    }

    /// Writes an entry, and begins the log with an inventory if there is none: a first entry so short that power cuts
    /// leave little behind of it, and once it is there, nothing that they leave passes for noise.
    fn put(&mut self, key: u8, bytes: &[u8]) -> Result<Survey, StoreError> {
        let before = self.survey(key, bytes)?;
        if !before.0.any {
            self.write(INVENTORY, &[NOTHING], false)?;
        }
        self.write(key, bytes, before.1)
    }

    /// Writes an entry, whose content was there before or not; returns what is found then.
    fn write(&mut self, key: u8, bytes: &[u8], held_before: bool) -> Result<Survey, StoreError> {
        let stored = self.log.append(key, bytes);
        // A failure may have come so late that all is there: what counts is what a start would find.
        match (stored, self.survey(key, bytes)?) {
            (Ok(()), (found, true)) => Ok(found),
            (Err(_), (found, true)) if !held_before => Ok(found),
            _ => Err(StoreError),
        }
    }

    /// Returns what a start would find, and whether these bytes are under this key.
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

    /// Removes all records, old versions too: none comes back, whatever bit flips. The setting stays.
    ///
    /// A power cut leaves all records as they were or none; clearing anew finishes that. What is clear is not written to.
    ///
    /// # Errors
    /// [`StoreError`] when the flash fails.
    pub fn clear(&mut self) -> Result<(), StoreError> {
        if self.is_clear()? {
            return Ok(());
        }
        self.log.begin_anew(&[NOTHING]).or_else(|error| {
            // A failure may have come so late that all is gone.
            if self.is_clear()? { Ok(()) } else { Err(error) }
        })
    }

    /// Returns whether there is no record, nor what is left of one.
    fn is_clear(&mut self) -> Result<bool, StoreError> {
        let (found, _) = self.survey(INVENTORY, &[])?;
        let has_leftovers = self.log.has_leftovers().map_err(|_| StoreError)?;
        Ok(found.stored == 0 && found.inventory() == NOTHING && !has_leftovers)
    }
}

const fn bit(key: RecordKey) -> u8 {
    1 << key as u8
}
