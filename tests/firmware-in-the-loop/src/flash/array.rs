//! The cells of the memory and their sectors (RM0090 table 6, 2 Mbyte; RM0390 table 4).

use super::Nanos;

/// The size of the first four sectors of a bank, in bytes.
pub const SECTOR_SIZE: usize = 16 << 10;
/// The value of an erased byte.
pub const ERASED: u8 = 0xFF;

/// The modelled sectors: those of the memory, in a bank of their own or in that of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// The address of the first sector.
    pub base: u64,
    /// The size of all sectors, in bytes.
    pub size: usize,
    /// The SNB of the first sector.
    first_snb: u32,
    /// Whether the image is in another bank.
    pub two_banks: bool,
}

impl Layout {
    /// The memory in bank 2 of an STM32F429ZI.
    pub const TWO_BANKS: Self = Self { base: 0x0810_0000, size: 1 << 20, first_snb: 0x10, two_banks: true };
    /// The memory in sectors 1 and 2 of an STM32F446RE.
    pub const ONE_BANK: Self = Self { base: 0x0800_4000, size: 2 * SECTOR_SIZE, first_snb: 1, two_banks: false };

    /// Returns the offset and the size of the sector of an SNB; `None` for other sectors.
    pub(super) const fn sector(&self, snb: u32) -> Option<(usize, usize)> {
        const K: usize = 1 << 10;
        let (from, size) = match snb.checked_sub(self.first_snb) {
            Some(number @ 0..=3) => (number as usize * SECTOR_SIZE, SECTOR_SIZE),
            Some(4) => (64 * K, 64 * K),
            Some(number @ 5..=11) => ((number as usize - 4) * 128 * K, 128 * K),
            _ => return None,
        };
        if from + size <= self.size { Some((from, size)) } else { None }
    }
}

/// The bytes of the memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Array(Vec<u8>);

/// Returns the duration of the erase of a sector, by PSIZE: 8, 16, 32 bits (DS9405 and DS10693, typical).
pub(super) const fn erase_time(size: usize, parallelism: u32) -> Nanos {
    let milliseconds: [Nanos; 3] = match size >> 10 {
        16 => [400, 300, 250],
        64 => [1200, 700, 550],
        _ => [2000, 1300, 1000],
    };
    let place = if parallelism < 2 { parallelism as usize } else { 2 };
    milliseconds[place] * 1_000_000
}

impl Array {
    pub(super) fn erased(layout: &Layout) -> Self {
        Self(vec![ERASED; layout.size])
    }

    pub(super) fn bytes(&self, from: usize, size: usize) -> &[u8] {
        &self.0[from..from + size]
    }

    pub(super) fn fill(&mut self, from: usize, content: &[u8]) {
        self.0[from..from + content.len()].copy_from_slice(content);
    }

    pub(super) fn read(&self, offset: usize, bytes: usize) -> u64 {
        let byte = |place: usize| self.0.get(offset + place).copied().unwrap_or(ERASED);
        (0..bytes).fold(0, |value, place| value | u64::from(byte(place)) << (8 * place))
    }

    /// Programs bytes. Bits change from 1 to 0 only.
    pub(super) fn program(&mut self, offset: usize, bytes: usize, value: u64) {
        for place in 0..bytes {
            if let Some(byte) = self.0.get_mut(offset + place) {
                *byte &= (value >> (8 * place)) as u8;
            }
        }
    }

    pub(super) fn erase(&mut self, from: usize, size: usize) {
        self.0[from..from + size].fill(ERASED);
    }

    /// Leaves an interrupted erase: some words unchanged, some erased, some neither.
    pub(super) fn erase_partly(&mut self, from: usize, size: usize, random: &mut fastrand::Rng) {
        let progress = random.u8(..);
        for byte in &mut self.0[from..from + size] {
            *byte = match random.u8(..) {
                point if point < progress => ERASED,
                point if point < progress.saturating_add(16) => *byte | random.u8(..),
                _ => *byte,
            };
        }
    }
}
