//! Records under their keys in a flash: `sequential-storage`'s map, as on the board.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use protocol_core::memory::{Image, Record, RecordKey, StoreError};
use sequential_storage::Error;
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

use super::flash::{Flash, SECTOR, SIZE, WORD};

const SECTORS: usize = SIZE / SECTOR;
const KEYS: usize = RecordKey::ALL.len();

/// The most words that the very first store leaves behind when the power cuts it: the mark of its sector, a header of two
/// words, key and record.
const FIRST_STORE_WORDS: usize = 1 + 2 + (1 + protocol_core::memory::RECORD_MAX).div_ceil(WORD);

type Map<'flash> = MapStorage<
    u8,
    &'flash mut Flash,
    Cache<ArrayPageStates<SECTORS>, ArrayPagePointers<SECTORS>, ArrayKeyPointers<u8, KEYS>, u8>,
>;

/// Writes a record; what lay under its key before stays until the new one is complete.
///
/// # Errors
/// [`StoreError`] when the flash fails or cannot hold it.
pub(super) fn store(flash: &mut Flash, key: RecordKey, record: &Record) -> Result<(), StoreError> {
    let mut buffer = vec![0; SECTOR];
    let bytes: &[u8] = record;
    ready(map(flash).store_item(&mut buffer, &(key as u8), &bytes)).map_err(|_| StoreError)
}

/// Reads everything, and finishes what a power cut left half done. A record that the flash itself does not give is
/// unreadable in the image.
///
/// # Errors
/// [`Unreadable`] when the map as a whole makes no sense.
pub(super) fn read(flash: &mut Flash) -> Result<Image, Unreadable> {
    let mut image = Image::empty();
    let mut found = false;
    let in_use = flash.words_in_use();
    let mut buffer = vec![0; SECTOR];
    let mut map = map(flash);
    for key in RecordKey::ALL {
        match ready(map.fetch_item::<&[u8]>(&mut buffer, &(key as u8))) {
            Ok(Some(bytes)) => image.put(key, bytes),
            Ok(None) => continue,
            Err(Error::Storage { .. }) => image.put_unreadable(key),
            Err(_) => return Err(Unreadable),
        }
        found = true;
    }
    // Noise mostly reads as a map without items: more of it than a first store leaves behind was something else once.
    if !found && in_use > FIRST_STORE_WORDS { Err(Unreadable) } else { Ok(image) }
}

/// The map in the flash makes no sense.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Unreadable;

/// A map without a memory of its own: the flash may have been changed behind its back.
fn map(flash: &mut Flash) -> Map<'_> {
    let config = const { MapConfig::new(0..SIZE as u32) };
    let cache = Cache::new(ArrayPageStates::new(), ArrayPagePointers::new(), ArrayKeyPointers::new());
    MapStorage::new(flash, config, cache)
}

/// The result of a future that never waits, as those over RAM don't.
pub(super) fn ready<F: Future>(future: F) -> F::Output {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(output) => output,
        Poll::Pending => unreachable!("a flash in RAM never waits"),
    }
}
