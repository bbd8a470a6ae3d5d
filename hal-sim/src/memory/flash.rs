//! A NOR flash in RAM with the geometry and the failures of the board's flash.

use std::sync::Arc;

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// The size in bytes of a sector, the unit of erasing, as in sectors 12 and 13 of the board's STM32F429.
pub const SECTOR: usize = 16 * 1024;
/// The size of the whole flash, in bytes.
pub const SIZE: usize = 2 * SECTOR;
/// The value of an erased byte.
pub const ERASED: u8 = 0xFF;
/// The size of a word, the unit of writing, in bytes.
pub const WORD: usize = 4;

/// A NOR flash in RAM with two sectors of four-byte words. A write can only clear bits.
#[derive(Clone, Debug)]
pub struct Flash {
    /// The content, which clones share until they write.
    pub(super) cells: Arc<Vec<u8>>,
    reads: u64,
    word_writes: u64,
    erases: u64,
    faults: Faults,
    torn_erase: TornErase,
    /// The random source for torn writes and erases.
    noise: fastrand::Rng,
}

/// The result of an erase interrupted by a power cut or a failure. In a real flash, each cell may have any level
/// between its old value and erased; these variants are the extremes (A).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TornErase {
    /// The front of the sector is erased, followed by one partly erased word; the rest is unchanged.
    #[default]
    Front,
    /// The back of the sector is erased, preceded by one partly erased word; the rest is unchanged.
    Back,
    /// All bits are 0, because an erase starts by programming all bits.
    Zeros,
    /// All bits are random.
    Noise,
    /// Some 0 bits are erased at random, as at the beginning of an erase.
    Faded,
}

impl TornErase {
    /// All possible results of a torn erase.
    pub const ALL: [Self; 5] = [Self::Front, Self::Back, Self::Zeros, Self::Noise, Self::Faded];

    fn tear(self, sector: &mut [u8], noise: &mut fastrand::Rng) {
        let reached = noise.usize(..SECTOR / WORD) * WORD;
        let (erased, torn) = match self {
            Self::Front => (0..reached, reached..reached + WORD),
            Self::Back => (reached + WORD..SECTOR, reached..reached + WORD),
            Self::Zeros | Self::Noise => (0..0, 0..SECTOR),
            Self::Faded => (0..0, 0..0),
        };
        sector[erased].fill(ERASED);
        for cell in &mut sector[torn] {
            *cell = match self {
                Self::Zeros => 0,
                Self::Noise => noise.u8(..),
                _ => *cell | noise.u8(..),
            };
        }
        if self == Self::Faded {
            // Each bit is erased with a probability between 1/2 and 1/256.
            let halvings = noise.u32(1..=8);
            for cell in sector {
                *cell |= (0..halvings).fold(ERASED, |bits, _| bits & noise.u8(..));
            }
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Faults {
    /// True if writes and erases fail without changing the content.
    write_fails: bool,
    /// The number of word writes and erases left before a power cut.
    power_for: Option<u64>,
    /// The number of word writes and erases left before a single failure.
    fails_after: Option<u64>,
    /// True if the power is cut.
    dead: bool,
}

/// The error of a flash operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FlashError {
    /// The address is not on a word or sector boundary.
    #[error("not aligned")]
    NotAligned,
    /// The address is beyond the end of the flash.
    #[error("out of bounds")]
    OutOfBounds,
    /// The write or the erase failed.
    #[error("the write failed")]
    WriteFailed,
    /// The power was cut.
    #[error("the power was cut")]
    PowerCut,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::WriteFailed | Self::PowerCut => NorFlashErrorKind::Other,
        }
    }
}

impl Default for Flash {
    fn default() -> Self {
        Self::new()
    }
}

impl Flash {
    /// Creates an erased flash.
    #[must_use]
    pub fn new() -> Self {
        Self::of(vec![ERASED; SIZE])
    }

    /// Creates a flash from an image; `None` if the size is wrong.
    #[must_use]
    pub fn from_image(image: Vec<u8>) -> Option<Self> {
        (image.len() == SIZE).then(|| Self::of(image))
    }

    fn of(cells: Vec<u8>) -> Self {
        let cells = Arc::new(cells);
        let (torn_erase, noise) = (TornErase::default(), fastrand::Rng::with_seed(0));
        Self { cells, reads: 0, word_writes: 0, erases: 0, faults: Faults::default(), torn_erase, noise }
    }

    /// Returns a copy of the content.
    #[must_use]
    pub fn image(&self) -> Vec<u8> {
        self.cells.to_vec()
    }

    /// Returns the number of reads since the flash was created.
    #[must_use]
    pub const fn reads(&self) -> u64 {
        self.reads
    }

    /// Returns the number of words written since the flash was created.
    #[must_use]
    pub const fn word_writes(&self) -> u64 {
        self.word_writes
    }

    /// Returns the number of sectors erased since the flash was created.
    #[must_use]
    pub const fn erases(&self) -> u64 {
        self.erases
    }

    /// Returns the number of words that are not erased.
    #[must_use]
    pub fn words_in_use(&self) -> usize {
        self.cells.chunks_exact(WORD).filter(|word| *word != [ERASED; WORD]).count()
    }

    /// Sets whether writes and erases fail.
    pub const fn set_write_fails(&mut self, fails: bool) {
        self.faults.write_fails = fails;
    }

    /// Returns whether writes and erases fail.
    #[must_use]
    pub const fn write_fails(&self) -> bool {
        self.faults.write_fails
    }

    /// Plans a power cut after `operations` further word writes and sector erases. The next operation is then torn, and
    /// all later operations fail until [`restore_power`](Self::restore_power).
    pub const fn cut_power_after(&mut self, operations: u64) {
        self.faults.power_for = Some(operations);
    }

    /// Plans a single failure after `operations` further word writes and sector erases. The next operation is then
    /// torn; later operations succeed.
    pub const fn fail_once_after(&mut self, operations: u64) {
        self.faults.fails_after = Some(operations);
    }

    /// Sets the result of torn erases.
    pub const fn set_torn_erase(&mut self, torn_erase: TornErase) {
        self.torn_erase = torn_erase;
    }

    /// Restores the power and cancels a planned power cut.
    pub const fn restore_power(&mut self) {
        self.faults.power_for = None;
        self.faults.dead = false;
    }

    /// Returns whether a planned power cut has occurred and the power has not been restored.
    #[must_use]
    pub const fn is_dead(&self) -> bool {
        self.faults.dead
    }

    pub(super) const fn can_be_written(&self) -> bool {
        !self.faults.dead && !self.faults.write_fails
    }

    /// Seeds the random source for torn operations.
    pub fn seed_noise(&mut self, seed: u64) {
        self.noise = fastrand::Rng::with_seed(seed);
    }

    /// Inverts the bit at an index; no effect beyond the end of the flash.
    pub fn flip_bit(&mut self, bit: usize) {
        if let Some(cell) = Arc::make_mut(&mut self.cells).get_mut(bit / 8) {
            *cell ^= 1 << (bit % 8);
        }
    }

    /// Overwrites the whole flash, as a programmer does.
    pub fn fill(&mut self, content: impl FnMut(usize) -> u8) {
        self.cells = Arc::new((0..SIZE).map(content).collect());
    }

    fn range(offset: u32, len: usize, unit: usize) -> Result<std::ops::Range<usize>, FlashError> {
        let start = offset as usize;
        let end = start.checked_add(len).filter(|end| *end <= SIZE).ok_or(FlashError::OutOfBounds)?;
        if start.is_multiple_of(unit) && len.is_multiple_of(unit) {
            Ok(start..end)
        } else {
            Err(FlashError::NotAligned)
        }
    }

    /// Counts a write or erase towards the planned faults. Returns the error that interrupts the operation part-way, if
    /// any.
    ///
    /// # Errors
    /// The error of an operation that changes nothing.
    fn attempt(&mut self) -> Result<Option<FlashError>, FlashError> {
        if self.faults.dead {
            return Err(FlashError::PowerCut);
        }
        if self.faults.write_fails {
            return Err(FlashError::WriteFailed);
        }
        if count_down(&mut self.faults.power_for) {
            self.faults.dead = true;
            return Ok(Some(FlashError::PowerCut));
        }
        Ok(count_down(&mut self.faults.fails_after).then_some(FlashError::WriteFailed))
    }
}

/// Decrements a fault counter. Returns whether the fault occurs now; a fault occurs only once.
fn count_down(left: &mut Option<u64>) -> bool {
    let is_due = *left == Some(0);
    *left = left.and_then(|count| count.checked_sub(1));
    is_due
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        if self.faults.dead {
            return Err(FlashError::PowerCut);
        }
        bytes.copy_from_slice(&self.cells[Self::range(offset, bytes.len(), 1)?]);
        self.reads += 1;
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let len = to.checked_sub(from).ok_or(FlashError::OutOfBounds)? as usize;
        for start in Self::range(from, len, SECTOR)?.step_by(SECTOR) {
            let torn = self.attempt()?;
            let sector = &mut Arc::make_mut(&mut self.cells)[start..start + SECTOR];
            if let Some(error) = torn {
                self.torn_erase.tear(sector, &mut self.noise);
                return Err(error);
            }
            sector.fill(ERASED);
            self.erases += 1;
        }
        Ok(())
    }

    /// Writes words. A torn write clears only some of the bits that are 0 in `bytes`, and no further word is written.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let range = Self::range(offset, bytes.len(), WORD)?;
        for (start, word) in range.step_by(WORD).zip(bytes.chunks_exact(WORD)) {
            let torn = self.attempt()?;
            let cells = &mut Arc::make_mut(&mut self.cells)[start..start + WORD];
            for (cell, byte) in cells.iter_mut().zip(word) {
                *cell &= if torn.is_none() { *byte } else { *byte | self.noise.u8(..) };
            }
            if let Some(error) = torn {
                return Err(error);
            }
            self.word_writes += 1;
        }
        Ok(())
    }
}

/// The flash of the STM32F4 has no error correction, so a word can be rewritten to clear further bits.
impl MultiwriteNorFlash for Flash {}
