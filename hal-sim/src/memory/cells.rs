//! The cells of a flash. Only the cells up to the last written cell of each sector are stored, which saves RAM with
//! hundreds of devices.

/// The size of a sector, the unit of erasing, in bytes: sectors 12 and 13 of the board's STM32F429.
pub const SECTOR: usize = 16 * 1024;
/// The size of the whole flash, in bytes.
pub const SIZE: usize = 2 * SECTOR;
/// The value of an erased byte.
pub const ERASED: u8 = 0xFF;

/// The cells of each sector up to the last written cell. All further cells are erased.
#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    sectors: [Vec<u8>; SIZE / SECTOR],
}

impl Cells {
    /// Creates the cells from an image of the complete flash.
    pub(super) fn of(image: &[u8]) -> Self {
        let mut cells = Self::default();
        for (sector, content) in cells.sectors.iter_mut().zip(image.chunks(SECTOR)) {
            let used = content.iter().rposition(|cell| *cell != ERASED).map_or(0, |last| last + 1);
            sector.extend_from_slice(&content[..used]);
        }
        cells
    }

    /// Copies the cells from offset `start` into `bytes`.
    pub(super) fn read(&self, start: usize, bytes: &mut [u8]) {
        let mut done = 0;
        while done < bytes.len() {
            let (sector, place) = ((start + done) / SECTOR, (start + done) % SECTOR);
            let part = (SECTOR - place).min(bytes.len() - done);
            let written = self.sectors[sector].get(place..).unwrap_or_default();
            let held = written.len().min(part);
            let into = &mut bytes[done..done + part];
            into[..held].copy_from_slice(&written[..held]);
            into[held..].fill(ERASED);
            done += part;
        }
    }

    /// Returns the `len` cells from offset `start`, for writing. All of them must be in the same sector.
    pub(super) fn change(&mut self, start: usize, len: usize) -> &mut [u8] {
        let (sector, place) = (&mut self.sectors[start / SECTOR], start % SECTOR);
        if sector.len() < place + len {
            sector.resize(place + len, ERASED);
        }
        &mut sector[place..place + len]
    }

    /// Erases the sector that begins at `start`.
    pub(super) fn erase(&mut self, start: usize) {
        self.sectors[start / SECTOR] = Vec::new();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(cells: &Cells) -> usize {
        cells.sectors.iter().map(Vec::capacity).sum()
    }

    #[test]
    fn only_what_was_written_takes_room() {
        let mut cells = Cells::default();
        assert_eq!(held(&cells), 0);
        cells.change(SECTOR + 8, 4).copy_from_slice(&[1, 2, 3, 4]);
        assert!(held(&cells) < 64, "{}", held(&cells));
        let mut bytes = [0; 16];
        cells.read(SECTOR - 2, &mut bytes);
        assert_eq!(bytes, [[ERASED; 10].as_slice(), &[1, 2, 3, 4], &[ERASED; 2]].concat()[..]);
        cells.erase(SECTOR);
        assert_eq!(held(&cells), 0);
        assert_eq!(held(&Cells::of(&[ERASED; SIZE])), 0);
    }
}
