//! Records under their keys in a flash: `sequential-storage`'s map, as on the board.
//!
//! What the map does not do by itself is added here: an erase that was cut is finished ([`SureErase`]), damage that
//! passes for an item of any length is stepped over (`ItemLengths`), a store counts only when it reads back, and an
//! inventory of the keys ever stored tells a record that was lost from one that was never written.
//!
//! Nothing is kept between two operations, nor from a write to its being read back: what counts is what a start would
//! find, and a start goes through the items once, from the oldest to the newest.
//!
//! Beside the records of the device the map keeps a setting of the platform, such as which device it is.

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_futures::block_on;
use embedded_storage::nor_flash::{NorFlash, ReadNorFlash as _};
use heapless::Vec;
use protocol_core::memory::{Image, RECORD_MAX, Record, RecordKey, StoreError, open, seal};
use sequential_storage::Error;
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

use crate::SECTORS;
use crate::item_lengths::ItemLengths;
use crate::preview::Preview;
use crate::sure_erase::{ERASED, SureErase, WORD_MAX};

/// The bytes of the longest item: its key and a record.
const ITEM_MAX: usize = 1 + RECORD_MAX;

/// The bytes that [`Records`] works in: the longest item, in whole words of whatever length.
pub const BUFFER: usize = ITEM_MAX.next_multiple_of(WORD_MAX);

/// The most bytes of a setting.
pub const SETTING_MAX: usize = 8;

/// The records, the inventory and the setting.
const KEYS: usize = RecordKey::ALL.len() + 2;

/// The key of the inventory: a byte with a bit for each record, set once that was stored for the first time.
const INVENTORY: u8 = 0;
/// The inventory of a memory without records.
const NOTHING: u8 = 0;

/// The key of the setting: as far from those of the records as can be.
const SETTING: u8 = 0xFF;
/// How the setting is encoded.
const SETTING_VERSION: u8 = 1;

/// A look at all sectors.
const ALL: [bool; SECTORS] = [false; SECTORS];

/// A store that does not read back is tried again behind what was in its way, say a bit that had flipped there: so
/// often.
const ATTEMPTS: usize = 3;

/// Returns the most bytes in use that can be all that power cuts have left of the first stores: the mark of the sector,
/// a header of two words, key and record.
const fn first_store<F: NorFlash>() -> usize {
    3 * F::WRITE_SIZE + ITEM_MAX.next_multiple_of(F::WRITE_SIZE)
}

type Map<S> = MapStorage<
    u8,
    BlockingAsync<ItemLengths<Preview<S>, ITEM_MAX>>,
    Cache<ArrayPageStates<SECTORS>, ArrayPagePointers<SECTORS>, ArrayKeyPointers<u8, KEYS>, u8>,
>;

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

/// The map in the flash makes no sense.
#[derive(Debug, PartialEq, Eq)]
pub struct Unreadable;

/// What a start would find, in short.
#[derive(Default)]
struct Survey {
    /// Any item at all.
    any: bool,
    /// The bits of the records that there are.
    stored: u8,
    /// The bits of the records that were stored once, as far as that is known.
    inventory: Option<u8>,
}

impl Survey {
    /// Notes one more item; it replaces what came before under its key.
    fn note(&mut self, key: u8, bytes: &[u8]) {
        self.any = true;
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
pub struct Records<'buffer, F: NorFlash> {
    flash: SureErase<F>,
    buffer: &'buffer mut [u8; BUFFER],
}

impl<'buffer, F: NorFlash> Records<'buffer, F> {
    /// Finishes an erase that was cut. To be done anew after every error.
    ///
    /// # Errors
    /// Those of the flash.
    pub fn open(flash: F, buffer: &'buffer mut [u8; BUFFER]) -> Result<Self, F::Error> {
        Ok(Self { flash: SureErase::open(flash)?, buffer })
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

    /// Reads everything, and changes nothing. Of a damaged map the newest version of a record that is intact counts
    /// (A). A record that the flash does not give, although it was stored once, is unreadable in the image.
    ///
    /// # Errors
    /// [`Unreadable`] when the map as a whole makes no sense; of the contents the setting is of use then, if there is
    /// one.
    pub fn read(&mut self, contents: &mut Contents) -> Result<(), Unreadable> {
        let Contents { image, setting } = contents;
        image.clear();
        *setting = None;
        let mut found = Survey::default();
        let mut visit = |key, bytes: &[u8]| {
            found.note(key, bytes);
            if key == SETTING {
                *setting = open(SETTING_VERSION, bytes).and_then(|bytes| Vec::from_slice(bytes).ok());
            } else if let Some(key) = record_key(key) {
                image.put(key, bytes);
            }
        };
        match self.scan(ALL, &mut visit) {
            Ok(()) if !found.any => {
                // Noise mostly reads so: more of it than first stores leave behind was something else once.
                let in_use = self.in_use().map_err(|_| Unreadable)?;
                if in_use > first_store::<F>() {
                    return Err(Unreadable);
                }
            }
            Ok(()) => {
                RecordKey::ALL.into_iter().filter(|key| found.misses(*key)).for_each(|key| image.put_unreadable(key))
            }
            Err(Error::Storage { .. }) => RecordKey::ALL.into_iter().for_each(|key| image.put_unreadable(key)),
            Err(_) => return Err(Unreadable),
        }
        Ok(())
    }

    /// Writes the setting of the platform; the one before stays until the new one is complete.
    ///
    /// # Errors
    /// [`StoreError`] when it is longer than [`SETTING_MAX`], or the flash fails.
    pub fn store_setting(&mut self, setting: &[u8]) -> Result<(), StoreError> {
        let setting = Vec::<u8, SETTING_MAX>::from_slice(setting).map_err(|_| StoreError)?;
        self.put(SETTING, &seal(SETTING_VERSION, &setting)?).map(drop)
    }

    /// Writes an item, and begins the map with an inventory if there is none: a first item so short that power cuts
    /// leave little behind of it, and once it is there, nothing that they leave passes for the noise of a damaged map.
    fn put(&mut self, key: u8, bytes: &[u8]) -> Result<Survey, StoreError> {
        let before = self.survey(key, bytes);
        if let Ok((Survey { any: false, .. }, _)) = before {
            // What reads as nothing must not come back as items of the map that begins here.
            if self.in_use().map_err(|_| StoreError)? > 0 {
                (0..SECTORS).try_for_each(|sector| self.flash.erase_sector(sector)).map_err(|_| StoreError)?;
            }
            self.write(INVENTORY, &[NOTHING], false)?;
        }
        self.write(key, bytes, before.is_ok_and(|(_, holds)| holds))
    }

    /// Writes an item, which was there before or not; what is found then.
    fn write(&mut self, key: u8, bytes: &[u8], held_before: bool) -> Result<Survey, StoreError> {
        for _ in 0..ATTEMPTS {
            let stored = self.store_item(key, bytes, None);
            // A failure may have come so late that all is there: what counts is what a start would find.
            match (stored, self.survey(key, bytes)) {
                (Ok(()), Ok((found, true))) => return Ok(found),
                (Err(_), Ok((found, true))) if !held_before => return Ok(found),
                (Ok(()), _) => {}
                (Err(_), _) => break,
            }
        }
        Err(StoreError)
    }

    /// Returns what a start would find, and whether these bytes are under this key.
    fn survey(&mut self, key: u8, bytes: &[u8]) -> Result<(Survey, bool), Error<F::Error>> {
        let mut survey = Survey::default();
        let mut holds = false;
        self.scan(ALL, &mut |found, content| {
            survey.note(found, content);
            if found == key {
                holds = content == bytes;
            }
        })?;
        Ok((survey, holds))
    }

    /// Goes through all items that are intact, from the oldest to the newest; those of some sectors are left out.
    fn scan(&mut self, hidden: [bool; SECTORS], visit: &mut dyn FnMut(u8, &[u8])) -> Result<(), Error<F::Error>> {
        let mut map = map(Preview::looking(&mut self.flash, hidden), None);
        // A sector that makes no sense is given up by a fetch, as it has to be, but not by a walk through the items.
        block_on(async {
            if matches!(map.fetch_all_items(self.buffer).await, Err(Error::Corrupted {})) {
                map.fetch_item::<&[u8]>(self.buffer, &INVENTORY).await?;
            }
            let mut items = map.fetch_all_items(self.buffer).await?;
            while let Some((key, bytes)) = items.next::<&[u8]>(self.buffer).await? {
                visit(key, bytes);
            }
            Ok(())
        })
    }

    /// Returns how many bytes are not erased, in whole words.
    fn in_use(&mut self) -> Result<usize, F::Error> {
        let len = SECTORS * SureErase::<F>::SECTOR;
        let mut words = 0;
        for sector in (0..len).step_by(SureErase::<F>::SECTOR) {
            let end = sector + SureErase::<F>::SECTOR;
            for start in (sector..end).step_by(BUFFER) {
                let bytes = &mut self.buffer[..(end - start).min(BUFFER)];
                self.flash.read(start as u32, bytes)?;
                words +=
                    bytes.chunks_exact(F::WRITE_SIZE).filter(|word| word.iter().any(|byte| *byte != ERASED)).count();
            }
        }
        Ok(words * F::WRITE_SIZE)
    }

    /// Removes all records, old versions too: none comes back, whatever bit flips. The setting stays.
    ///
    /// The map moves to its other sector, and takes the setting along alone. A power cut leaves all records as they
    /// were or none; clearing anew finishes that. What is clear is not written to.
    ///
    /// # Errors
    /// [`StoreError`] when the flash fails.
    pub fn clear(&mut self) -> Result<(), StoreError> {
        for _ in 0..ATTEMPTS {
            let mut found = Survey::default();
            self.scan(ALL, &mut |key, bytes| found.note(key, bytes)).map_err(|_| StoreError)?;
            if found.stored == 0 && found.inventory() == NOTHING {
                return Ok(());
            }
            self.store_item(INVENTORY, &[NOTHING], Some(SETTING))?;
        }
        Err(StoreError)
    }

    /// Writes an item once. With `kept`, gives up the items of all other keys.
    fn store_item(&mut self, key: u8, bytes: &[u8], kept: Option<u8>) -> Result<(), StoreError> {
        self.tidy().map_err(|_| StoreError)?;
        let mut map = map(Preview::writing(&mut self.flash), kept);
        block_on(map.store_item(self.buffer, &key, &bytes)).map_err(|_| StoreError)
    }

    /// Puts right what the map would lose all items by: damage in one sector, and none of them in the other one.
    fn tidy(&mut self) -> Result<(), Error<F::Error>> {
        for sector in 0..SECTORS {
            let other = 1 - sector;
            // The map would take the newer sector for an unfinished copy of the older one, and give that up.
            if self.flash.is_older(sector).map_err(storage)? && !self.holds_items(sector)? {
                self.flash.erase_sector(sector).map_err(storage)?;
            }
            // The map would take a sector that has lost its mark for an empty one.
            if self.flash.is_unmarked(sector).map_err(storage)?
                && self.holds_items(sector)?
                && !self.holds_items(other)?
            {
                self.flash.erase_sector(other).map_err(storage)?;
                self.flash.mark(sector).map_err(storage)?;
            }
        }
        Ok(())
    }

    fn holds_items(&mut self, sector: usize) -> Result<bool, Error<F::Error>> {
        let mut hidden = [true; SECTORS];
        hidden[sector] = false;
        let mut holds = false;
        self.scan(hidden, &mut |_, _| holds = true)?;
        Ok(holds)
    }
}

const fn storage<E>(value: E) -> Error<E> {
    Error::Storage { value }
}

fn record_key(key: u8) -> Option<RecordKey> {
    RecordKey::ALL.into_iter().find(|record| *record as u8 == key)
}

const fn bit(key: RecordKey) -> u8 {
    1 << key as u8
}

/// Returns a map without a memory of its own: nothing but what is in the flash counts.
fn map<S: NorFlash>(flash: Preview<S>, kept: Option<u8>) -> Map<S> {
    let config = MapConfig::new(0..(SECTORS * S::ERASE_SIZE) as u32);
    let cache = Cache::new(ArrayPageStates::new(), ArrayPagePointers::new(), ArrayKeyPointers::new());
    MapStorage::new(BlockingAsync::new(ItemLengths::new(flash, kept)), config, cache)
}
