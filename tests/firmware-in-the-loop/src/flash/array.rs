//! The cells of bank 2, and its sectors (RM0090 table 6, 2 Mbyte).

use super::Nanos;

/// Where bank 2 begins.
pub const BANK2: u64 = 0x0810_0000;
/// Its bytes.
pub const BANK2_SIZE: usize = 1 << 20;
/// The bytes of its first four sectors, 12 to 15.
pub const SECTOR_SIZE: usize = 16 << 10;
/// What an erased byte reads as.
pub const ERASED: u8 = 0xFF;

/// SNB of sector 12, the first one of bank 2.
const FIRST_SNB: u32 = 0x10;

/// The bytes of bank 2.
#[derive(Clone, Debug)]
pub(super) struct Array(Vec<u8>);

impl Default for Array {
    fn default() -> Self {
        Self(vec![ERASED; BANK2_SIZE])
    }
}

/// Where the sector of an SNB begins in bank 2, and its size; `None` when bank 2 has no such sector.
pub(super) const fn sector(snb: u32) -> Option<(usize, usize)> {
    const K: usize = 1 << 10;
    match snb.checked_sub(FIRST_SNB) {
        Some(number @ 0..=3) => Some((number as usize * SECTOR_SIZE, SECTOR_SIZE)),
        Some(4) => Some((64 * K, 64 * K)),
        Some(number @ 5..=11) => Some(((number as usize - 4) * 128 * K, 128 * K)),
        _ => None,
    }
}

/// How long the erase of a sector takes by PSIZE: 8, 16, 32 bits (DS9405, typical).
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

    /// Bits go from 1 to 0 only.
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

    /// An erase that was interrupted: some words are as they were, some erased, some neither.
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
