//! A log of entries in a NOR flash of two sectors: an entry is appended behind the others, and the newest one of a key that
//! is intact counts.
//!
//! An entry has a sequence number and a checksum, and begins at a word. Sectors are searched word by word, so that damage
//! hides nothing but itself, whatever it looks like. When the sector in use is full, the other one is erased, and the newest
//! entry of each key is copied into it. The full sector stays as it is until the next move: a cut leaves nothing to be
//! decided, since a copy is as good as its original, and an erase that was cut is simply done again.
//!
//! No word is written twice between two erases, and a word that cannot be read (a torn one, on a flash with error
//! correction) is damage like any other.

use core::ops::Range;

use crc::{CRC_32_ISCSI, Crc, NoTable};
use embedded_storage::nor_flash::NorFlash;
use protocol_core::memory::StoreError;

use crate::{BUFFER, ERASED, INVENTORY, ITEM_MAX, KEYS, SECTORS, SETTING, WORD_MAX, place_of};

/// Another polynomial than that of the records: of a content that ends in its own checksum, the same one would not depend on
/// the content.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISCSI);

/// The mark of an entry, its key, its length, whether it is a beginning, its sequence number, and the checksum of all of
/// it.
pub(crate) const HEADER: usize = 12;

/// What every entry begins with: a word that was written does not read as an erased one.
pub(crate) const MARK: u8 = 0x4E;
const CHECKSUM: Range<usize> = 8..HEADER;

/// A store that does not read back is tried again behind what was in its way, say a bit that had flipped there: so
/// often.
const ATTEMPTS: usize = 3;

/// The log.
pub(crate) struct Log<'buffer, F> {
    flash: F,
    pub(crate) buffer: &'buffer mut [u8; BUFFER],
}

/// An entry as it is found.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Found {
    at: usize,
    /// 0 of an item of the layout before this one: older than every entry.
    sequence: u32,
    key: u8,
    length: u8,
    /// Nothing counts that is older, but the setting.
    is_beginning: bool,
}

/// The newest entry of each key.
type Newest = [Option<Found>; KEYS];

/// What a walk through a sector has found.
#[derive(Clone, Copy)]
struct Walk {
    /// The sequence number of the last entry.
    last: Option<u32>,
    /// Where the next entry goes, and where the room for it ends.
    room: (usize, usize),
    is_blank: bool,
}

/// What there is in the flash.
struct Survey {
    /// The newest entry of each key that counts.
    newest: Newest,
    walks: [Walk; SECTORS],
    /// The sequence number of the next entry.
    next: u32,
    /// The sector with the last entry.
    active: Option<usize>,
}

impl Survey {
    const fn spot_in(&self, sector: usize) -> Spot {
        let (free, end) = self.walks[sector].room;
        Spot { sector, free, end, next: self.next }
    }
}

/// Where an entry is to be written.
struct Spot {
    sector: usize,
    free: usize,
    end: usize,
    next: u32,
}

/// What is written in an entry.
#[derive(Clone, Copy)]
enum Source<'a> {
    Bytes(u8, &'a [u8], bool),
    /// The content of another entry.
    Copy(Found),
}

impl<'buffer, F: NorFlash> Log<'buffer, F> {
    pub(crate) const fn new(flash: F, buffer: &'buffer mut [u8; BUFFER]) -> Self {
        const { assert!(F::WRITE_SIZE <= WORD_MAX && F::WRITE_SIZE.is_multiple_of(F::READ_SIZE)) }
        Self { flash, buffer }
    }

    /// Hands out the entries that count, from the oldest to the newest of each sector, the older sector first: the last one
    /// of a key is the newest. A beginning is handed out with `true`: whatever came before it counts no longer, but the
    /// setting.
    pub(crate) fn scan(&mut self, visit: &mut dyn FnMut(u8, &[u8], bool)) -> Result<(), F::Error> {
        let order = self.order()?;
        for sector in order.into_iter().flatten() {
            self.legacy_items(sector, &mut |_, key, bytes| visit(key, bytes, false))?;
        }
        for sector in order.into_iter().flatten() {
            self.walk(sector, &mut |found, bytes| visit(found.key, bytes, found.is_beginning))?;
        }
        Ok(())
    }

    /// Appends an entry; the one before it of that key counts until this one is complete.
    pub(crate) fn append(&mut self, key: u8, bytes: &[u8]) -> Result<(), StoreError> {
        let source = Source::Bytes(key, bytes, false);
        let mut spot = self.settle(Some(key))?;
        if self.put(&mut spot, source)? {
            return Ok(());
        }
        // All that counts lies in one sector before the other one is erased.
        let old = self.settle(None)?.sector;
        let (survey, mut spot) = self.begin_sector(1 - old)?;
        let others = survey.newest.iter().flatten().filter(|found| found.key != key);
        self.put_all(&mut spot, others.copied().map(Source::Copy).chain([source]))
    }

    /// Begins anew: of all entries the setting stays alone. A cut leaves all of them, or the setting and the inventory.
    pub(crate) fn begin_anew(&mut self, inventory: &[u8]) -> Result<(), StoreError> {
        let old = self.settle(None)?.sector;
        let (survey, mut spot) = self.begin_sector(1 - old)?;
        let setting = survey.newest[place_of(SETTING)].map(Source::Copy);
        let beginning = Source::Bytes(INVENTORY, inventory, true);
        self.put_all(&mut spot, setting.into_iter().chain([beginning]))?;
        self.erase(old)
    }

    /// Finishes a move that was cut, but for the entry of one key; returns where the next entry goes.
    fn settle(&mut self, but: Option<u8>) -> Result<Spot, StoreError> {
        let survey = self.survey().map_err(|_| StoreError)?;
        let mut spot = self.spot(&survey).map_err(|_| StoreError)?;
        let other = 1 - spot.sector;
        let is_left = |found: &&Found| Self::sector_of(found.at) == other && Some(found.key) != but;
        let mut left = survey.newest.iter().flatten().filter(is_left).copied();
        if left.try_fold(true, |fits, found| Ok(fits && self.put(&mut spot, Source::Copy(found))?))? {
            return Ok(spot);
        }
        // The copies do not fit behind damage. A sector that holds copies alone can be erased; what is left of a sector
        // that holds more is a version from before damage, and is given up with the next move.
        for held in survey.newest.iter().flatten().filter(|found| Self::sector_of(found.at) == spot.sector) {
            if !self.has_copy(other, held).map_err(|_| StoreError)? {
                return Ok(spot);
            }
        }
        let (survey, _) = self.begin_sector(spot.sector)?;
        self.spot(&survey).map_err(|_| StoreError)
    }

    /// Returns whether anything is left over in the sector that is not in use.
    pub(crate) fn has_leftovers(&mut self) -> Result<bool, F::Error> {
        let survey = self.survey()?;
        Ok(survey.active.is_some_and(|active| !survey.walks[1 - active].is_blank))
    }

    /// Returns the number of bytes in written words.
    pub(crate) fn in_use(&mut self) -> Result<usize, F::Error> {
        let (mut at, mut words) = (0, 0);
        while let Some(next) = self.next_written(at, SECTORS * F::ERASE_SIZE)? {
            words += 1;
            at = next + F::WRITE_SIZE;
        }
        Ok(words * F::WRITE_SIZE)
    }

    /// Returns where the next entry goes.
    fn spot(&mut self, survey: &Survey) -> Result<Spot, F::Error> {
        let holds =
            [0, 1].map(|sector| survey.newest.iter().flatten().any(|found| Self::sector_of(found.at) == sector));
        let (sector, is_legacy) = match (survey.active, holds) {
            (Some(sector), _) => (sector, false),
            (None, [false, false]) => (0, false),
            // A move of the layout before this one was cut: the newer sector still has room.
            (None, [true, true]) => (usize::from(!self.is_legacy_newer_in_front()?), false),
            (None, [_, second]) => (usize::from(second), true),
        };
        let mut spot = survey.spot_in(sector);
        if is_legacy {
            // A sector of the layout before this one takes no entry: it is moved.
            spot.free = spot.end;
        }
        Ok(spot)
    }

    /// Erases a sector, also one that reads as erased: an erase that was cut may have come so far and no further. Returns
    /// what there is then.
    fn begin_sector(&mut self, sector: usize) -> Result<(Survey, Spot), StoreError> {
        self.erase(sector)?;
        let survey = self.survey().map_err(|_| StoreError)?;
        let spot = survey.spot_in(sector);
        Ok((survey, spot))
    }

    fn put_all<'a>(
        &mut self,
        spot: &mut Spot,
        sources: impl IntoIterator<Item = Source<'a>>,
    ) -> Result<(), StoreError> {
        for source in sources {
            if !self.put(spot, source)? {
                return Err(StoreError);
            }
        }
        Ok(())
    }

    /// Returns whether the newest entry of a key in a sector has the same content.
    fn has_copy(&mut self, sector: usize, held: &Found) -> Result<bool, F::Error> {
        if !self.read_item(held)? {
            return Ok(false);
        }
        let content = CRC.checksum(&self.buffer[HEADER..HEADER + usize::from(held.length)]);
        let mut is_same = false;
        let mut compare = |key: u8, bytes: &[u8]| {
            if key == held.key {
                is_same = bytes.len() == usize::from(held.length) && CRC.checksum(bytes) == content;
            }
        };
        self.legacy_items(sector, &mut |_, key, bytes| compare(key, bytes))?;
        self.walk(sector, &mut |found, bytes| compare(found.key, bytes))?;
        Ok(is_same && !held.is_beginning)
    }

    /// Writes an entry and reads it back; returns false when there is no room for it.
    fn put(&mut self, spot: &mut Spot, source: Source<'_>) -> Result<bool, StoreError> {
        for _ in 0..ATTEMPTS {
            let (key, length, is_beginning) = match source {
                Source::Bytes(key, bytes, is_beginning) => {
                    let room = self.buffer.get_mut(HEADER..HEADER + bytes.len()).ok_or(StoreError)?;
                    room.copy_from_slice(bytes);
                    (key, bytes.len(), is_beginning)
                }
                Source::Copy(found) => {
                    if !self.read_item(&found).map_err(|_| StoreError)? {
                        return Err(StoreError);
                    }
                    // The copy of a beginning is none: what was copied before it, or will be after it, counts.
                    (found.key, usize::from(found.length), false)
                }
            };
            let size = (HEADER + length).next_multiple_of(F::WRITE_SIZE);
            if spot.free + size > spot.end {
                return Ok(false);
            }
            self.buffer[HEADER + length..size].fill(0);
            self.buffer[..4].copy_from_slice(&[MARK, key, length as u8, u8::from(is_beginning)]);
            self.buffer[4..8].copy_from_slice(&spot.next.to_le_bytes());
            let checksum = self.checksum(length);
            self.buffer[CHECKSUM].copy_from_slice(&checksum);
            let at = spot.free;
            self.flash.write(at as u32, &self.buffer[..size]).map_err(|_| StoreError)?;
            if self.entry_at(at, spot.end).map_err(|_| StoreError)?.is_some_and(|found| found.sequence == spot.next) {
                spot.free += size;
                spot.next += 1;
                return Ok(true);
            }
            spot.free = at + BUFFER;
        }
        Err(StoreError)
    }

    /// Puts the content of an item behind the place of a header in the buffer; returns whether it is still intact.
    fn read_item(&mut self, found: &Found) -> Result<bool, F::Error> {
        if found.sequence == 0 {
            return self.read_legacy(found.at, usize::from(found.length));
        }
        let end = (Self::sector_of(found.at) + 1) * F::ERASE_SIZE;
        Ok(self.entry_at(found.at, end)? == Some(*found))
    }

    fn erase(&mut self, sector: usize) -> Result<(), StoreError> {
        let start = sector * F::ERASE_SIZE;
        self.flash.erase(start as u32, (start + F::ERASE_SIZE) as u32).map_err(|_| StoreError)
    }

    const fn sector_of(at: usize) -> usize {
        at / F::ERASE_SIZE
    }

    /// Returns the sectors that are not blank, the older one first.
    fn order(&mut self) -> Result<[Option<usize>; SECTORS], F::Error> {
        let (mut firsts, mut order) = ([None; SECTORS], [None; SECTORS]);
        for sector in 0..SECTORS {
            if let Some((at, end)) = self.first_written(sector)? {
                order[sector] = Some(sector);
                firsts[sector] = self.first_entry(at, end)?;
            }
        }
        let is_second_older = match firsts {
            [Some(first), Some(second)] => second < first,
            [Some(_), None] => true,
            [None, Some(_)] => false,
            [None, None] => self.is_legacy_newer_in_front()?,
        };
        if is_second_older {
            order.reverse();
        }
        Ok(order)
    }

    /// Returns the first word of a sector that is not erased, and the end of the sector.
    fn first_written(&mut self, sector: usize) -> Result<Option<(usize, usize)>, F::Error> {
        let end = (sector + 1) * F::ERASE_SIZE;
        Ok(self.next_written(sector * F::ERASE_SIZE, end)?.map(|at| (at, end)))
    }

    /// Returns the sequence number of the first entry from a word on.
    fn first_entry(&mut self, mut at: usize, end: usize) -> Result<Option<u32>, F::Error> {
        while let Some(next) = self.next_written(at, end)? {
            if let Some(found) = self.entry_at(next, end)? {
                return Ok(Some(found.sequence));
            }
            at = next + F::WRITE_SIZE;
        }
        Ok(None)
    }

    fn survey(&mut self) -> Result<Survey, F::Error> {
        let blank =
            |sector| Walk { last: None, room: (sector * F::ERASE_SIZE, (sector + 1) * F::ERASE_SIZE), is_blank: true };
        let mut survey = Survey { newest: [None; KEYS], walks: [0, 1].map(blank), next: 1, active: None };
        let order = self.order()?;
        for sector in order.into_iter().flatten() {
            let newest = &mut survey.newest;
            self.legacy_items(sector, &mut |at, key, bytes| {
                let length = bytes.len() as u8;
                newest[place_of(key)] = Some(Found { at, sequence: 0, key, length, is_beginning: false });
            })?;
        }
        for sector in order.into_iter().flatten() {
            let newest = &mut survey.newest;
            let walk = self.walk(sector, &mut |found, _| {
                if found.is_beginning {
                    newest.iter_mut().for_each(|newest| *newest = newest.filter(|newest| newest.key == SETTING));
                }
                newest[place_of(found.key)] = Some(found);
            })?;
            if let Some(last) = walk.last
                && last >= survey.next
            {
                survey.next = last + 1;
                survey.active = Some(sector);
            }
            survey.walks[sector] = walk;
        }
        Ok(survey)
    }

    /// Goes through the entries of a sector, from the oldest to the newest.
    fn walk(&mut self, sector: usize, visit: &mut dyn FnMut(Found, &[u8])) -> Result<Walk, F::Error> {
        let (start, end) = (sector * F::ERASE_SIZE, (sector + 1) * F::ERASE_SIZE);
        let (mut last, mut is_blank, mut gap) = (None, true, None);
        let (mut at, mut free) = (start, start);
        while let Some(next) = self.next_written(at, end)? {
            is_blank = false;
            if let Some(found) = self.entry_at(next, end)? {
                last = Some(found.sequence);
                let length = usize::from(found.length);
                visit(found, &self.buffer[HEADER..HEADER + length]);
                at = next + (HEADER + length).next_multiple_of(F::WRITE_SIZE);
                (free, gap) = (at, None);
            } else {
                if free + BUFFER <= next {
                    gap.get_or_insert((free, next));
                }
                // An entry that was cut ends in words that may have been written, and read as erased ones.
                at = next + F::WRITE_SIZE;
                free = next + BUFFER;
            }
        }
        Ok(Walk { last, room: gap.unwrap_or((free, end)), is_blank })
    }

    /// Returns the entry that begins at a word, if one does; it is in the buffer then.
    fn entry_at(&mut self, at: usize, end: usize) -> Result<Option<Found>, F::Error> {
        let head = HEADER.next_multiple_of(F::WRITE_SIZE);
        if at + head > end {
            return Ok(None);
        }
        self.read(at, head)?;
        let [MARK, key, length, is_beginning @ (0 | 1), s0, s1, s2, s3, ..] = *self.buffer else {
            return Ok(None);
        };
        let length = usize::from(length);
        let size = (HEADER + length).next_multiple_of(F::WRITE_SIZE);
        if length > ITEM_MAX || at + size > end || !crate::is_key(key) {
            return Ok(None);
        }
        self.read(at, size)?;
        let is_intact = self.checksum(length) == self.buffer[CHECKSUM];
        let sequence = u32::from_le_bytes([s0, s1, s2, s3]);
        let found = Found { at, sequence, key, length: length as u8, is_beginning: is_beginning == 1 };
        // No entry could follow the last number.
        Ok(Some(found).filter(|_| is_intact && sequence != 0 && sequence != u32::MAX))
    }

    /// Returns the checksum of the entry in the buffer, with so long a content.
    fn checksum(&self, length: usize) -> [u8; 4] {
        let mut digest = CRC.digest();
        digest.update(&self.buffer[..CHECKSUM.start]);
        digest.update(&self.buffer[HEADER..HEADER + length]);
        digest.finalize().to_le_bytes()
    }

    /// Returns the first word that is not erased, from `at` on.
    pub(crate) fn next_written(&mut self, mut at: usize, end: usize) -> Result<Option<usize>, F::Error> {
        let mut step = F::WRITE_SIZE;
        while at < end {
            let len = step.min(end - at);
            self.read(at, len)?;
            if !is_blank(&self.buffer[..len])
                && let Some(byte) = self.buffer[..len].iter().position(|byte| *byte != ERASED)
            {
                return Ok(Some(at + byte / F::WRITE_SIZE * F::WRITE_SIZE));
            }
            at += len;
            step = BUFFER / F::WRITE_SIZE * F::WRITE_SIZE;
        }
        Ok(None)
    }

    /// Reads into the buffer. Words that cannot be read are zero there.
    pub(crate) fn read(&mut self, at: usize, len: usize) -> Result<(), F::Error> {
        let Err(error) = self.flash.read(at as u32, &mut self.buffer[..len]) else { return Ok(()) };
        let mut is_alive = false;
        for start in (0..len).step_by(F::WRITE_SIZE) {
            let word = &mut self.buffer[start..(start + F::WRITE_SIZE).min(len)];
            match self.flash.read((at + start) as u32, word) {
                Ok(()) => is_alive = true,
                Err(_) => word.fill(0),
            }
        }
        // A flash of which nothing can be read has failed as a whole.
        let mut word = [0; WORD_MAX];
        let mut can_read = |at: usize| self.flash.read(at as u32, &mut word[..F::WRITE_SIZE]).is_ok();
        let ends = [0, F::ERASE_SIZE - F::WRITE_SIZE, F::ERASE_SIZE, 2 * F::ERASE_SIZE - F::WRITE_SIZE];
        if is_alive || ends.into_iter().any(&mut can_read) { Ok(()) } else { Err(error) }
    }
}

/// Looks at four bytes at a time: a start of the board goes through all of its memory.
fn is_blank(bytes: &[u8]) -> bool {
    let (words, rest) = bytes.as_chunks::<4>();
    words.iter().all(|word| *word == [ERASED; 4]) && rest.iter().all(|byte| *byte == ERASED)
}
