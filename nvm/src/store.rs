//! Records under their keys in a flash: `sequential-storage`'s map, as on the board.
//!
//! What the map does not do by itself is added here: an erase that was cut is finished ([`SureErase`]), a store counts
//! only when it reads back, and an inventory of the keys ever stored tells a record that was lost from one that was
//! never written.

use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash as _};
use protocol_core::memory::{Image, RECORD_MAX, Record, RecordKey, StoreError};
use sequential_storage::Error;
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

use crate::sure_erase::{ERASED, SureErase};

const SECTORS: usize = 2;
const KEYS: usize = RecordKey::ALL.len() + 1;

/// The key of the inventory: a byte with a bit for each record, set once that was stored for the first time.
const INVENTORY: u8 = 0;

/// A store that does not read back is tried again behind what was in its way, say a bit that had flipped there: so often.
const ATTEMPTS: usize = 3;

/// The most bytes that the very first store leaves behind when the power cuts it: the mark of its sector, a header of two
/// words, key and record.
const fn first_store<F: NorFlash>() -> usize {
    3 * F::WRITE_SIZE + (1 + RECORD_MAX).next_multiple_of(F::WRITE_SIZE)
}

type Map<'flash, F> = MapStorage<
    u8,
    &'flash mut SureErase<F>,
    Cache<ArrayPageStates<SECTORS>, ArrayPagePointers<SECTORS>, ArrayKeyPointers<u8, KEYS>, u8>,
>;

/// The map in the flash makes no sense.
#[derive(Debug, PartialEq, Eq)]
pub struct Unreadable;

/// The records in a flash of two sectors.
pub struct Records<'buffer, F: NorFlash> {
    flash: SureErase<F>,
    /// As long as a sector: damage can pass for an item of any length.
    buffer: &'buffer mut [u8],
}

impl<'buffer, F: NorFlash> Records<'buffer, F> {
    /// Finishes an erase that was cut. To be done anew after every error.
    ///
    /// # Errors
    /// Those of the flash.
    pub async fn open(flash: F, buffer: &'buffer mut [u8]) -> Result<Self, F::Error> {
        Ok(Self { flash: SureErase::open(flash).await?, buffer })
    }

    /// Writes a record; what lay under its key before stays until the new one is complete.
    ///
    /// # Errors
    /// [`StoreError`] when the flash fails or cannot hold it.
    pub async fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        self.put(key as u8, record).await?;
        let inventory = self.inventory().await;
        if inventory & bit(key) == 0 {
            // Which records there are is seen anew: the inventory itself may be what was lost.
            let mut found = inventory;
            for key in RecordKey::ALL {
                if matches!(self.get(key as u8).await, Ok(Some(_))) {
                    found |= bit(key);
                }
            }
            // The record is stored, whatever becomes of this; the next store of it tries again.
            let _ = self.put(INVENTORY, &[found]).await;
        }
        Ok(())
    }

    /// Reads everything, and finishes what a power cut left half done. A record that the flash does not give, although it
    /// was stored once, is unreadable in the image.
    ///
    /// # Errors
    /// [`Unreadable`] when the map as a whole makes no sense.
    pub async fn read(&mut self) -> Result<Image, Unreadable> {
        let mut image = Image::empty();
        // Looked at first: reading can erase a sector that makes no sense.
        let in_use = self.in_use().await.map_err(|_| Unreadable)?;
        let inventory = self.inventory().await;
        let mut found = inventory != 0;
        for key in RecordKey::ALL {
            match self.get(key as u8).await {
                Ok(Some(bytes)) => image.put(key, bytes),
                Ok(None) if inventory & bit(key) == 0 => continue,
                Ok(None) | Err(Error::Storage { .. }) => image.put_unreadable(key),
                Err(_) => return Err(Unreadable),
            }
            found = true;
        }
        // Noise mostly reads as a map without items: more of it than a first store leaves behind was something else once.
        if !found && in_use > first_store::<F>() { Err(Unreadable) } else { Ok(image) }
    }

    /// The bits of the keys that were stored once; none when that is not known.
    async fn inventory(&mut self) -> u8 {
        match self.get(INVENTORY).await {
            Ok(Some([inventory])) => *inventory,
            _ => 0,
        }
    }

    async fn put(&mut self, key: u8, bytes: &[u8]) -> Result<(), StoreError> {
        let held_before = self.holds(key, bytes).await;
        for _ in 0..ATTEMPTS {
            let stored = map(&mut self.flash).store_item(self.buffer, &key, &bytes).await;
            // A failure may have come so late that all is there: what counts is what a start would find.
            let holds = self.holds(key, bytes).await;
            match stored {
                Ok(()) if holds => return Ok(()),
                Err(_) if holds && !held_before => return Ok(()),
                Ok(()) => {}
                Err(_) => break,
            }
        }
        Err(StoreError)
    }

    /// Whether a start would find these bytes.
    async fn holds(&mut self, key: u8, bytes: &[u8]) -> bool {
        matches!(self.get(key).await, Ok(Some(found)) if found == bytes)
    }

    async fn get(&mut self, key: u8) -> Result<Option<&[u8]>, Error<F::Error>> {
        map(&mut self.flash).fetch_item(self.buffer, &key).await
    }

    /// How many bytes are not erased, in whole words.
    async fn in_use(&mut self) -> Result<usize, F::Error> {
        let sector_len = SureErase::<F>::SECTOR;
        let mut words = 0;
        for sector in 0..SECTORS {
            let bytes = &mut self.buffer[..sector_len];
            self.flash.read((sector * sector_len) as u32, bytes).await?;
            words += bytes.chunks_exact(F::WRITE_SIZE).filter(|word| word.iter().any(|byte| *byte != ERASED)).count();
        }
        Ok(words * F::WRITE_SIZE)
    }
}

const fn bit(key: RecordKey) -> u8 {
    1 << key as u8
}

/// A map without a memory of its own: nothing but what is in the flash counts.
fn map<F: NorFlash>(flash: &mut SureErase<F>) -> Map<'_, F> {
    let config = MapConfig::new(0..(SECTORS * SureErase::<F>::SECTOR) as u32);
    let cache = Cache::new(ArrayPageStates::new(), ArrayPagePointers::new(), ArrayKeyPointers::new());
    MapStorage::new(flash, config, cache)
}
