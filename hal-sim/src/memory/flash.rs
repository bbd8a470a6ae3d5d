//! A NOR flash in RAM, with the board's geometry, that can fail as a real one does.

use embedded_storage_async::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// The bytes of a sector: what is erased at once. Sectors 12 and 13 of the board's STM32F429.
pub const SECTOR: usize = 16 * 1024;
/// The bytes of the whole flash.
pub const SIZE: usize = 2 * SECTOR;
/// The bytes of a word: what is written at once.
pub const WORD: usize = 4;
/// What an erased byte reads.
pub const ERASED: u8 = 0xFF;

/// A NOR flash in RAM: two sectors, words of four bytes, bits that writing only clears.
#[derive(Clone, Debug)]
pub struct Flash {
    cells: Vec<u8>,
    word_writes: u64,
    erases: u64,
    faults: Faults,
    /// The bits that a write or an erase leaves behind that the power cut.
    noise: fastrand::Rng,
}

/// What is wrong with a flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Faults {
    /// Writes and erases fail and change nothing.
    write_fails: bool,
    /// How many more word writes and erases succeed before the power is cut.
    power_for: Option<u64>,
    /// The power was cut.
    dead: bool,
}

/// Why the flash did not do what it was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FlashError {
    /// Not on word or sector boundaries.
    #[error("not aligned")]
    NotAligned,
    /// Beyond the end.
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
    /// An erased flash.
    #[must_use]
    pub fn new() -> Self {
        Self::of(vec![ERASED; SIZE])
    }

    /// A flash that holds `image`; `None` unless that has the right size.
    #[must_use]
    pub fn from_image(image: Vec<u8>) -> Option<Self> {
        (image.len() == SIZE).then(|| Self::of(image))
    }

    fn of(cells: Vec<u8>) -> Self {
        Self { cells, word_writes: 0, erases: 0, faults: Faults::default(), noise: fastrand::Rng::with_seed(0) }
    }

    /// Everything in it.
    #[must_use]
    pub fn image(&self) -> &[u8] {
        &self.cells
    }

    /// How many words were written since it was made.
    #[must_use]
    pub const fn word_writes(&self) -> u64 {
        self.word_writes
    }

    /// How many sectors were erased since it was made.
    #[must_use]
    pub const fn erases(&self) -> u64 {
        self.erases
    }

    /// How many words are not erased.
    #[must_use]
    pub fn words_in_use(&self) -> usize {
        self.cells.chunks_exact(WORD).filter(|word| *word != [ERASED; WORD]).count()
    }

    /// From now on writes and erases fail, or do so no longer.
    pub const fn set_write_fails(&mut self, fails: bool) {
        self.faults.write_fails = fails;
    }

    /// Cuts the power after `operations` more word writes and sector erases: the one after them is torn, and nothing
    /// works any more until [`restore_power`](Self::restore_power).
    pub const fn cut_power_after(&mut self, operations: u64) {
        self.faults.power_for = Some(operations);
    }

    /// The power is back, and no cut is planned.
    pub const fn restore_power(&mut self) {
        self.faults.power_for = None;
        self.faults.dead = false;
    }

    /// Whether a planned power cut has happened.
    #[must_use]
    pub const fn is_dead(&self) -> bool {
        self.faults.dead
    }

    /// Whether writes and erases have a chance.
    pub(super) const fn can_be_written(&self) -> bool {
        !self.faults.dead && !self.faults.write_fails
    }

    /// Other noise in what a power cut tears.
    pub fn seed_noise(&mut self, seed: u64) {
        self.noise = fastrand::Rng::with_seed(seed);
    }

    /// Turns a bit over, counted from 0; beyond the end nothing happens.
    pub fn flip_bit(&mut self, bit: usize) {
        if let Some(cell) = self.cells.get_mut(bit / 8) {
            *cell ^= 1 << (bit % 8);
        }
    }

    /// Overwrites everything, as a hand with a programmer would.
    pub fn fill(&mut self, content: impl FnMut(usize) -> u8) {
        self.cells = (0..SIZE).map(content).collect();
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

    /// Whether there is power for one more operation.
    fn power(&mut self) -> Result<Power, FlashError> {
        if self.faults.dead {
            return Err(FlashError::PowerCut);
        }
        if self.faults.write_fails {
            return Err(FlashError::WriteFailed);
        }
        match &mut self.faults.power_for {
            None => Ok(Power::On),
            Some(0) => {
                self.faults.dead = true;
                Ok(Power::Cut)
            }
            Some(left) => {
                *left -= 1;
                Ok(Power::On)
            }
        }
    }
}

/// Whether an operation is completed.
#[derive(PartialEq, Eq)]
enum Power {
    On,
    Cut,
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        if self.faults.dead {
            return Err(FlashError::PowerCut);
        }
        bytes.copy_from_slice(&self.cells[Self::range(offset, bytes.len(), 1)?]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    /// A cut erase has erased the front of the sector, leaves noise in one word and the rest as it was (A).
    ///
    /// `sequential-storage` recovers from that. It would not from an erase that leaves the whole sector as noise or zeros:
    /// with both of its marks set it passes for a full sector, whose copy is then thrown away to be made again.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let len = to.checked_sub(from).ok_or(FlashError::OutOfBounds)? as usize;
        for start in Self::range(from, len, SECTOR)?.step_by(SECTOR) {
            if self.power()? == Power::On {
                self.erases += 1;
                self.cells[start..start + SECTOR].fill(ERASED);
                continue;
            }
            let reached = start + self.noise.usize(..SECTOR / WORD) * WORD;
            self.cells[start..reached].fill(ERASED);
            for cell in &mut self.cells[reached..reached + WORD] {
                *cell |= self.noise.u8(..);
            }
            return Err(FlashError::PowerCut);
        }
        Ok(())
    }

    /// A cut write has cleared some of the bits of its word.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let range = Self::range(offset, bytes.len(), WORD)?;
        for (start, word) in range.step_by(WORD).zip(bytes.chunks_exact(WORD)) {
            let power = self.power()?;
            for (cell, byte) in self.cells[start..start + WORD].iter_mut().zip(word) {
                *cell &= if power == Power::On { *byte } else { *byte | self.noise.u8(..) };
            }
            if power == Power::Cut {
                return Err(FlashError::PowerCut);
            }
            self.word_writes += 1;
        }
        Ok(())
    }
}

/// The STM32F4's flash has no error correction: a word may be written again, which clears more bits.
impl MultiwriteNorFlash for Flash {}
