//! A log of entries in a NOR flash of two sectors. New entries are appended. For each key, the newest intact entry
//! counts.
//!
//! An entry has a sequence number and a checksum, and begins at a word. The log searches sectors word by word, so that
//! damage affects only the damaged entries.
//!
//! When the sector in use is full, the log moves. It erases the other sector, copies the newest entry of each key into
//! that sector, and finally writes the new entry, which completes the move. The full sector does not change until the
//! next move. A sector with only copies shows that a move was interrupted. The move then starts again with the erase.
//!
//! No word is written twice between two erases. An unreadable word counts as damage. In a flash with error correction,
//! an interrupted write leaves such words.

use core::ops::Range;

use crc::{CRC_32_ISCSI, Crc};
use embedded_storage::nor_flash::NorFlash;
use protocol_core::memory::StoreError;

use crate::{BUFFER, ERASED, INVENTORY, ITEM_MAX, KEYS, SECTORS, SETTING, WORD_MAX, index_of};

/// The CRC of entries. Its polynomial differs from the polynomial of the record CRC, because a CRC over data that ends
/// in its own CRC is constant. The table takes 1.2 KiB of flash. It shortens a start with a full sector from 11.6 ms to
/// 3.3 ms on the STM32F429.
static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);

/// The length of an entry header: mark, key, length, kind, sequence number and checksum.
pub(crate) const HEADER: usize = 12;

/// The first byte of every entry. No erased word begins with it.
pub(crate) const MARK: u8 = 0x4E;
const CHECKSUM: Range<usize> = 8..HEADER;

/// The maximum number of attempts to write an entry. An entry that does not read back, for example because of a flipped
/// bit, is written again at a later address.
const ATTEMPTS: usize = 3;

/// A log of entries in a flash.
pub(crate) struct Log<'buffer, F> {
    flash: F,
    pub(crate) buffer: &'buffer mut [u8; BUFFER],
}

/// The kind of an entry.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A copy of an older entry. Either the sector of the older entry will be erased, or a newer version is damaged.
    Copy = 0,
    /// New content.
    Stored = 1,
    /// New content. This entry invalidates all older entries except the setting.
    Beginning = 2,
}

/// An entry found in the flash.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Found {
    at: usize,
    /// The sequence number. An item of the previous layout, which is older than every entry, has 0.
    sequence: u32,
    key: u8,
    length: u8,
    kind: Kind,
}

/// The newest entry of each key.
type Newest = [Option<Found>; KEYS];

/// The result of scanning a sector.
#[derive(Clone, Copy)]
struct Walk {
    /// The sequence number of the last entry; 0 for none.
    last: u32,
    /// The sequence number of the last entry that is not a copy; 0 for none.
    last_new: u32,
    /// The address of the next entry, and the end of the free space.
    room: (usize, usize),
    is_blank: bool,
}

/// The state of the entire flash.
struct Survey {
    /// The newest valid entry of each key.
    newest: Newest,
    walks: [Walk; SECTORS],
    /// The index of the sector in use.
    home: usize,
    /// Set if no entry may be appended to the sector in use: a move from this sector was interrupted, or the sector has
    /// the previous layout.
    is_move_due: bool,
}

impl Survey {
    /// Returns the slot of the next entry in a sector.
    fn slot_in(&self, sector: usize) -> Slot {
        let (free, end) = self.walks[sector].room;
        let last = self.walks.iter().map(|walk| walk.last).max().unwrap_or(0);
        Slot { free, end, next: last + 1 }
    }
}

/// The free space of a sector, and the sequence number of the next entry.
struct Slot {
    free: usize,
    end: usize,
    next: u32,
}

/// The source of an entry to write.
#[derive(Clone, Copy)]
enum Source<'a> {
    New(Kind, u8, &'a [u8]),
    /// The content of another entry.
    Copy(Found),
}

impl<'buffer, F: NorFlash> Log<'buffer, F> {
    pub(crate) const fn new(flash: F, buffer: &'buffer mut [u8; BUFFER]) -> Self {
        const { assert!(F::WRITE_SIZE <= WORD_MAX && F::WRITE_SIZE.is_multiple_of(F::READ_SIZE)) }
        Self { flash, buffer }
    }

    /// Visits the items of the previous layout, then the intact entries, the older sector first. The last visited entry
    /// of a key is therefore the newest. `visit` receives the key, the content, and whether the entry is a beginning. A
    /// beginning invalidates all earlier entries except the setting.
    pub(crate) fn scan(&mut self, visit: &mut dyn FnMut(u8, &[u8], bool)) -> Result<(), F::Error> {
        let order = self.order()?;
        for sector in order.into_iter().flatten() {
            self.legacy_items(sector, &mut |_, key, bytes| visit(key, bytes, false))?;
        }
        for sector in order.into_iter().flatten() {
            self.walk(sector, &mut |found, bytes| visit(found.key, bytes, found.kind == Kind::Beginning))?;
        }
        Ok(())
    }

    /// Appends an entry. The previous entry of its key stays valid until the new entry is complete.
    pub(crate) fn append(&mut self, key: u8, bytes: &[u8]) -> Result<(), StoreError> {
        let source = Source::New(Kind::Stored, key, bytes);
        let survey = self.gather()?;
        if !survey.is_move_due && self.put(&mut survey.slot_in(survey.home), source)? {
            return Ok(());
        }
        self.move_from(survey.home, &|found| found.key != key, source)
    }

    /// Removes all entries except the setting. A power cut leaves all entries, or the setting and the inventory.
    pub(crate) fn begin_anew(&mut self, inventory: &[u8]) -> Result<(), StoreError> {
        let old = self.gather()?.home;
        let beginning = Source::New(Kind::Beginning, INVENTORY, inventory);
        self.move_from(old, &|found| found.key == SETTING, beginning)?;
        self.erase(old)
    }

    /// Copies the newest entries that lie in the other sector into the sector in use, unless a move is due. Such
    /// entries are older versions of damaged entries, or the rest of a move in the previous layout. Entries that do not
    /// fit are lost in the next move. Returns the resulting state of the flash.
    fn gather(&mut self) -> Result<Survey, StoreError> {
        for _ in 0..KEYS {
            let survey = self.survey().map_err(|_| StoreError)?;
            let is_left = |found: &&Found| !survey.is_move_due && Self::sector_of(found.at) != survey.home;
            let Some(left) = survey.newest.iter().flatten().find(is_left) else { return Ok(survey) };
            if !self.put(&mut survey.slot_in(survey.home), Source::Copy(*left))? {
                return Ok(survey);
            }
        }
        self.survey().map_err(|_| StoreError)
    }

    /// Moves to the other sector: erases it, copies the entries to keep, and writes the entry that completes the move.
    /// The erase is never skipped, because a sector can read as erased after an interrupted erase.
    fn move_from(&mut self, home: usize, is_kept: &dyn Fn(&Found) -> bool, last: Source<'_>) -> Result<(), StoreError> {
        self.erase(1 - home)?;
        let survey = self.survey().map_err(|_| StoreError)?;
        // The slot extends over words that do not read as erased. An entry that meets such a word is written again at a
        // later address.
        let mut slot = Slot { end: (2 - home) * F::ERASE_SIZE, ..survey.slot_in(1 - home) };
        let kept = survey.newest.iter().flatten().filter(|found| is_kept(found));
        for source in kept.copied().map(Source::Copy).chain([last]) {
            if !self.put(&mut slot, source)? {
                return Err(StoreError);
            }
        }
        Ok(())
    }

    /// Returns whether the flash holds more than the entries of the sector in use: data in the other sector, or damage
    /// without an intact entry.
    pub(crate) fn has_leftovers(&mut self) -> Result<bool, F::Error> {
        let Survey { newest, walks, home, .. } = self.survey()?;
        Ok(!walks[1 - home].is_blank || (newest.iter().all(Option::is_none) && !walks[home].is_blank))
    }

    /// Returns the number of bytes in written words. A sector whose erase was interrupted does not count.
    pub(crate) fn in_use(&mut self) -> Result<usize, F::Error> {
        let mut words = 0;
        for sector in 0..SECTORS {
            let (mut at, end) = (sector * F::ERASE_SIZE, (sector + 1) * F::ERASE_SIZE);
            if self.is_being_erased(sector)? {
                continue;
            }
            while let Some(next) = self.next_written(at, end)? {
                words += 1;
                at = next + F::WRITE_SIZE;
            }
        }
        Ok(words * F::WRITE_SIZE)
    }

    /// Writes an entry into the slot and reads it back, in up to [`ATTEMPTS`] attempts. The slot then begins after the
    /// entry. Returns `false` if the entry does not fit.
    fn put(&mut self, slot: &mut Slot, source: Source<'_>) -> Result<bool, StoreError> {
        for _ in 0..ATTEMPTS {
            let (kind, key, length) = match source {
                Source::New(kind, key, bytes) => {
                    let room = self.buffer.get_mut(HEADER..HEADER + bytes.len()).ok_or(StoreError)?;
                    room.copy_from_slice(bytes);
                    (kind, key, bytes.len())
                }
                Source::Copy(found) => {
                    if !self.read_item(&found).map_err(|_| StoreError)? {
                        return Err(StoreError);
                    }
                    (Kind::Copy, found.key, usize::from(found.length))
                }
            };
            let size = (HEADER + length).next_multiple_of(F::WRITE_SIZE);
            if slot.free + size > slot.end {
                return Ok(false);
            }
            self.buffer[HEADER + length..size].fill(0);
            self.buffer[..4].copy_from_slice(&[MARK, key, length as u8, kind as u8]);
            self.buffer[4..8].copy_from_slice(&slot.next.to_le_bytes());
            let checksum = self.checksum(length);
            self.buffer[CHECKSUM].copy_from_slice(&checksum);
            let at = slot.free;
            self.flash.write(at as u32, &self.buffer[..size]).map_err(|_| StoreError)?;
            if self.entry_at(at, slot.end).map_err(|_| StoreError)?.is_some_and(|found| found.sequence == slot.next) {
                slot.free += size;
                slot.next += 1;
                return Ok(true);
            }
            slot.free = at + BUFFER;
        }
        Err(StoreError)
    }

    /// Reads the content of an entry or of a previous-layout item into the buffer, after the space for a header.
    /// Returns whether the content is intact.
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

    /// Returns the sectors that are not blank, the older sector first.
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

    /// Returns the address of the first written word of a sector, and the end of the sector; `None` for a blank sector.
    fn first_written(&mut self, sector: usize) -> Result<Option<(usize, usize)>, F::Error> {
        let end = (sector + 1) * F::ERASE_SIZE;
        Ok(self.next_written(sector * F::ERASE_SIZE, end)?.map(|at| (at, end)))
    }

    /// Returns the sequence number of the first intact entry at or after an address.
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
        let blank = |sector| Walk {
            last: 0,
            last_new: 0,
            room: (sector * F::ERASE_SIZE, (sector + 1) * F::ERASE_SIZE),
            is_blank: true,
        };
        let (mut newest, mut walks): (Newest, _) = ([None; KEYS], [0, 1].map(blank));
        let order = self.order()?;
        for sector in order.into_iter().flatten() {
            self.legacy_items(sector, &mut |at, key, bytes| {
                let length = bytes.len() as u8;
                newest[index_of(key)] = Some(Found { at, sequence: 0, key, length, kind: Kind::Copy });
            })?;
        }
        let has_legacy = [0, 1].map(|sector| newest.iter().flatten().any(|found| Self::sector_of(found.at) == sector));
        for sector in order.into_iter().flatten() {
            walks[sector] = self.walk(sector, &mut |found, _| {
                if found.kind == Kind::Beginning {
                    newest.iter_mut().for_each(|newest| *newest = newest.filter(|newest| newest.key == SETTING));
                }
                newest[index_of(found.key)] = Some(found);
            })?;
        }
        let (lasts, last_news) = (walks.map(|walk| walk.last), walks.map(|walk| walk.last_new));
        let (home, is_move_due) = match (last_news, has_legacy) {
            // An erase in the previous layout was interrupted. It is repeated before its announcement is erased.
            ([0, 0], [false, false]) if lasts == [0, 0] && self.is_being_erased(0)? => (1, true),
            ([0, 0], [false, false]) if lasts == [0, 0] && self.is_being_erased(1)? => (0, true),
            ([0, 0], [false, false]) => (usize::from(lasts[1] > lasts[0]), false),
            // A move in the previous layout was interrupted. The newer sector still has room.
            ([0, 0], [true, true]) => (usize::from(!self.is_legacy_newer_in_front()?), false),
            ([0, 0], [_, second]) => (usize::from(second), true),
            ([first, second], _) => {
                let home = usize::from(second > first);
                (home, lasts[1 - home] > lasts[home])
            }
        };
        Ok(Survey { newest, walks, home, is_move_due })
    }

    /// Visits the entries of a sector from the oldest to the newest.
    fn walk(&mut self, sector: usize, visit: &mut dyn FnMut(Found, &[u8])) -> Result<Walk, F::Error> {
        let (start, end) = (sector * F::ERASE_SIZE, (sector + 1) * F::ERASE_SIZE);
        let (mut last, mut last_new, mut is_blank, mut gap) = (0, 0, true, None);
        let (mut at, mut free) = (start, start);
        while let Some(next) = self.next_written(at, end)? {
            is_blank = false;
            if let Some(found) = self.entry_at(next, end)? {
                last = found.sequence;
                if found.kind != Kind::Copy {
                    last_new = last;
                }
                let length = usize::from(found.length);
                visit(found, &self.buffer[HEADER..HEADER + length]);
                at = next + (HEADER + length).next_multiple_of(F::WRITE_SIZE);
                (free, gap) = (at, None);
            } else {
                if free + BUFFER <= next {
                    gap.get_or_insert((free, next));
                }
                // An interrupted entry can end in words that were written but read as erased.
                at = next + F::WRITE_SIZE;
                free = next + BUFFER;
            }
        }
        Ok(Walk { last, last_new, room: gap.unwrap_or((free, end)), is_blank })
    }

    /// Reads the entry at a word into the buffer. Returns its header fields; `None` unless an intact entry begins at
    /// the word.
    fn entry_at(&mut self, at: usize, end: usize) -> Result<Option<Found>, F::Error> {
        let head = HEADER.next_multiple_of(F::WRITE_SIZE);
        if at + head > end {
            return Ok(None);
        }
        self.read(at, head)?;
        let [MARK, key, length, kind, s0, s1, s2, s3, ..] = *self.buffer else { return Ok(None) };
        let kinds = [Kind::Copy, Kind::Stored, Kind::Beginning];
        let Some(kind) = kinds.get(usize::from(kind)).copied() else { return Ok(None) };
        let length = usize::from(length);
        let size = (HEADER + length).next_multiple_of(F::WRITE_SIZE);
        if length > ITEM_MAX || at + size > end || !crate::is_key(key) {
            return Ok(None);
        }
        self.read(at, size)?;
        let is_intact = self.checksum(length) == self.buffer[CHECKSUM];
        let sequence = u32::from_le_bytes([s0, s1, s2, s3]);
        let found = Found { at, sequence, key, length: length as u8, kind };
        // The highest sequence number is invalid, because no entry could follow it.
        Ok(Some(found).filter(|_| is_intact && sequence != 0 && sequence != u32::MAX))
    }

    /// Returns the checksum of the entry in the buffer. `length` is the length of the entry's content.
    fn checksum(&self, length: usize) -> [u8; 4] {
        let mut digest = CRC.digest();
        digest.update(&self.buffer[..CHECKSUM.start]);
        digest.update(&self.buffer[HEADER..HEADER + length]);
        digest.finalize().to_le_bytes()
    }

    /// Returns the address of the first word at or after `at` that is not erased.
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

    /// Reads words into the buffer. Unreadable words become zeros, unless the entire flash has failed.
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
        // If neither these words nor the ends of the sectors can be read, the entire flash has failed.
        let mut word = [0; WORD_MAX];
        let mut can_read = |at: usize| self.flash.read(at as u32, &mut word[..F::WRITE_SIZE]).is_ok();
        let ends = [0, F::ERASE_SIZE - F::WRITE_SIZE, F::ERASE_SIZE, 2 * F::ERASE_SIZE - F::WRITE_SIZE];
        if is_alive || ends.into_iter().any(&mut can_read) { Ok(()) } else { Err(error) }
    }
}

/// Returns whether all bytes are erased. Four bytes are checked at a time, because each start of the board scans the
/// entire memory.
fn is_blank(bytes: &[u8]) -> bool {
    let (words, rest) = bytes.as_chunks::<4>();
    words.iter().all(|word| *word == [ERASED; 4]) && rest.iter().all(|byte| *byte == ERASED)
}
