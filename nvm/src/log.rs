//! A log of entries in a NOR flash of two sectors: an entry is appended behind the others, and the newest one of a key that
//! is intact counts.
//!
//! An entry has a sequence number and a checksum, and begins at a word. Sectors are searched word by word, so that damage
//! hides nothing but itself, whatever it looks like. When the sector in use is full, the newest entry of each key is copied
//! into the other one, and the full sector is erased when all of them read back. Entries of a full sector are older than
//! those of the next, so a cut leaves nothing to be decided: a copy is as good as what it was made from, and what half an
//! erase leaves over is older than both.
//!
//! No word is written twice between two erases, and a word that cannot be read (a torn one, on a flash with error
//! correction) is damage like any other.

use core::ops::Range;

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embedded_storage::nor_flash::NorFlash;
use protocol_core::memory::StoreError;

use crate::{BUFFER, ERASED, INVENTORY, ITEM_MAX, KEYS, SECTORS, SETTING, WORD_MAX, place_of};

const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

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
    length: usize,
    /// Nothing counts that is older, but the setting.
    is_beginning: bool,
}

/// What a walk through a sector has found.
#[derive(Clone, Copy, Default)]
struct Walk {
    /// The sequence numbers of the first entry and of the last.
    sequences: Option<(u32, u32)>,
    /// The keys of which there is any entry, a bit each, by their places.
    keys: u8,
    /// Where the next entry goes.
    free: usize,
    is_blank: bool,
}

/// What there is in the flash.
struct Survey {
    /// The newest entry of each key that counts.
    newest: [Option<Found>; KEYS],
    walks: [Walk; SECTORS],
    /// The sequence number of the next entry.
    next: u32,
    /// The sector with the last entry.
    active: Option<usize>,
}

/// Where an entry is to be written.
struct Spot {
    sector: usize,
    free: usize,
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
        // All that counts lies in one sector before it is moved.
        self.settle(None)?;
        self.move_on(key, source)
    }

    /// Begins anew: of all entries the setting stays alone. A cut leaves all of them, or the setting and the inventory.
    pub(crate) fn begin_anew(&mut self, inventory: &[u8]) -> Result<(), StoreError> {
        let old = self.settle(None)?.sector;
        let target = 1 - old;
        let survey = self.survey().map_err(|_| StoreError)?;
        self.make_blank(target, survey.walks[target].is_blank)?;
        let mut spot = Spot { sector: target, free: target * F::ERASE_SIZE, next: survey.next };
        let setting = survey.newest[place_of(SETTING)].map(Source::Copy);
        for source in setting.into_iter().chain([Source::Bytes(INVENTORY, inventory, true)]) {
            if !self.put(&mut spot, source)? {
                return Err(StoreError);
            }
        }
        self.erase(old)
    }

    /// Finishes a move that was cut, but for the entry of one key; returns where the next entry goes.
    fn settle(&mut self, but: Option<u8>) -> Result<Spot, StoreError> {
        for _ in 0..SECTORS {
            let survey = self.survey().map_err(|_| StoreError)?;
            let mut spot = self.begin(&survey)?;
            if self.copy_from_other(&survey, &mut spot, but)? {
                return Ok(spot);
            }
            // The copies do not fit behind damage. Erased is what the other sector has, too.
            let keys = |sector: usize| survey.walks[sector].keys;
            if keys(spot.sector) & !keys(1 - spot.sector) != 0 {
                return Err(StoreError);
            }
            self.erase(spot.sector)?;
        }
        Err(StoreError)
    }

    /// Returns whether anything is left over in the sector that is not in use.
    pub(crate) fn has_leftovers(&mut self) -> Result<bool, F::Error> {
        let survey = self.survey()?;
        Ok(survey.active.is_some_and(|active| !survey.walks[1 - active].is_blank))
    }

    /// Returns how many bytes are not erased, in whole words.
    pub(crate) fn in_use(&mut self) -> Result<usize, F::Error> {
        let (mut at, mut words) = (0, 0);
        while let Some(next) = self.next_written(at, SECTORS * F::ERASE_SIZE)? {
            words += 1;
            at = next + F::WRITE_SIZE;
        }
        Ok(words * F::WRITE_SIZE)
    }

    /// Returns where the next entry goes. A sector without entries and without room is erased.
    fn begin(&mut self, survey: &Survey) -> Result<Spot, StoreError> {
        let holds = |sector: usize| survey.newest.iter().flatten().any(|found| found.at / F::ERASE_SIZE == sector);
        let sector = survey.active.unwrap_or_else(|| usize::from(holds(0)));
        let Walk { sequences, mut free, is_blank, .. } = survey.walks[sector];
        let has_room = free + BUFFER * KEYS <= (sector + 1) * F::ERASE_SIZE;
        if sequences.is_none() && !is_blank && !has_room {
            self.erase(sector)?;
            free = sector * F::ERASE_SIZE;
        }
        Ok(Spot { sector, free, next: survey.next })
    }

    /// Copies what counts of the other sector, but for one key; returns whether there was room for it.
    fn copy_from_other(&mut self, survey: &Survey, spot: &mut Spot, but: Option<u8>) -> Result<bool, StoreError> {
        for found in survey.newest.iter().flatten() {
            let is_there = self.sector_of(found.at) == spot.sector;
            if !is_there && Some(found.key) != but && !self.put(spot, Source::Copy(*found))? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Moves to the other sector with an entry: copies what counts, and erases the full sector when all of it reads back.
    fn move_on(&mut self, key: u8, source: Source<'_>) -> Result<(), StoreError> {
        let survey = self.survey().map_err(|_| StoreError)?;
        let old = survey.active.ok_or(StoreError)?;
        let target = 1 - old;
        self.make_blank(target, survey.walks[target].is_blank)?;
        let mut spot = Spot { sector: target, free: target * F::ERASE_SIZE, next: survey.next };
        if self.copy_from_other(&survey, &mut spot, Some(key))? && self.put(&mut spot, source)? {
            return self.erase(old);
        }
        Err(StoreError)
    }

    /// Writes an entry and reads it back; returns false when there is no room for it.
    fn put(&mut self, spot: &mut Spot, source: Source<'_>) -> Result<bool, StoreError> {
        let end = (spot.sector + 1) * F::ERASE_SIZE;
        for _ in 0..ATTEMPTS {
            let (key, length, is_beginning) = match source {
                Source::Bytes(key, bytes, is_beginning) => {
                    let room = self.buffer.get_mut(HEADER..HEADER + bytes.len()).ok_or(StoreError)?;
                    room.copy_from_slice(bytes);
                    (key, bytes.len(), is_beginning)
                }
                Source::Copy(found) => {
                    self.read_item(&found).map_err(|_| StoreError)?;
                    // The copy of a beginning is none: what was copied before it, or will be after it, counts.
                    (found.key, found.length, false)
                }
            };
            let size = (HEADER + length).next_multiple_of(F::WRITE_SIZE);
            if spot.free + size > end {
                return Ok(false);
            }
            self.buffer[HEADER + length..size].fill(0);
            self.buffer[..4].copy_from_slice(&[MARK, key, length as u8, u8::from(is_beginning)]);
            self.buffer[4..8].copy_from_slice(&spot.next.to_le_bytes());
            let checksum = self.checksum(length);
            self.buffer[CHECKSUM].copy_from_slice(&checksum);
            let at = spot.free;
            self.flash.write(at as u32, &self.buffer[..size]).map_err(|_| StoreError)?;
            if self.entry_at(at, end).map_err(|_| StoreError)?.is_some_and(|found| found.sequence == spot.next) {
                spot.free += size;
                spot.next += 1;
                return Ok(true);
            }
            spot.free = at + BUFFER;
        }
        Err(StoreError)
    }

    /// Puts the content of an item behind the place of a header in the buffer.
    fn read_item(&mut self, found: &Found) -> Result<(), F::Error> {
        if found.sequence == 0 {
            return self.read_legacy(found.at, found.length);
        }
        let size = (HEADER + found.length).next_multiple_of(F::WRITE_SIZE);
        self.read(found.at, size)
    }

    fn make_blank(&mut self, sector: usize, is_blank: bool) -> Result<(), StoreError> {
        if is_blank { Ok(()) } else { self.erase(sector) }
    }

    fn erase(&mut self, sector: usize) -> Result<(), StoreError> {
        let start = sector * F::ERASE_SIZE;
        self.flash.erase(start as u32, (start + F::ERASE_SIZE) as u32).map_err(|_| StoreError)
    }

    const fn sector_of(&self, at: usize) -> usize {
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
            [None, None] => self.is_legacy_full(1)? && !self.is_legacy_full(0)?,
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
        let blank = |sector| Walk { free: sector * F::ERASE_SIZE, is_blank: true, ..Walk::default() };
        let mut survey = Survey { newest: [None; KEYS], walks: [0, 1].map(blank), next: 1, active: None };
        let order = self.order()?;
        for sector in order.into_iter().flatten() {
            let newest = &mut survey.newest;
            self.legacy_items(sector, &mut |at, key, bytes| {
                let length = bytes.len();
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
            if let Some((_, last)) = walk.sequences
                && last >= survey.next
            {
                survey.next = last.saturating_add(1);
                survey.active = Some(sector);
            }
            survey.walks[sector] = walk;
        }
        for found in survey.newest.iter().flatten().filter(|found| found.sequence == 0) {
            survey.walks[found.at / F::ERASE_SIZE].keys |= 1 << place_of(found.key);
        }
        Ok(survey)
    }

    /// Goes through the entries of a sector, from the oldest to the newest.
    fn walk(&mut self, sector: usize, visit: &mut dyn FnMut(Found, &[u8])) -> Result<Walk, F::Error> {
        let (start, end) = (sector * F::ERASE_SIZE, (sector + 1) * F::ERASE_SIZE);
        let mut walk = Walk { free: start, is_blank: true, ..Walk::default() };
        let (mut at, mut damage) = (start, None);
        while let Some(next) = self.next_written(at, end)? {
            walk.is_blank = false;
            if let Some(found) = self.entry_at(next, end)? {
                let first = walk.sequences.map_or(found.sequence, |(first, _)| first);
                walk.sequences = Some((first, found.sequence));
                walk.keys |= 1 << place_of(found.key);
                visit(found, &self.buffer[HEADER..HEADER + found.length]);
                at = next + (HEADER + found.length).next_multiple_of(F::WRITE_SIZE);
                (walk.free, damage) = (at, None);
            } else {
                // An entry that was cut ends in words that may have been written, and read as erased ones.
                at = next + F::WRITE_SIZE;
                let begin = *damage.get_or_insert(next);
                walk.free = at.max(begin + BUFFER);
            }
        }
        Ok(walk)
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
        let found = Found { at, sequence, key, length, is_beginning: is_beginning == 1 };
        Ok(Some(found).filter(|_| is_intact && sequence != 0))
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
