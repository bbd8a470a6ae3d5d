//! The cells of a flash, as far as they were ever written: hundreds of devices on one host use little of theirs.

use super::flash::{ERASED, SECTOR, SIZE};

/// The cells of each sector up to the last one that was written; the rest is erased and takes no room.
#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    sectors: [Vec<u8>; SIZE / SECTOR],
}

impl Cells {
    /// The cells that hold `image`, as long as a flash.
    pub(super) fn of(image: &[u8]) -> Self {
        let mut cells = Self::default();
        for (sector, content) in cells.sectors.iter_mut().zip(image.chunks(SECTOR)) {
            let used = content.iter().rposition(|cell| *cell != ERASED).map_or(0, |last| last + 1);
            sector.extend_from_slice(&content[..used]);
        }
        cells
    }

    /// Copies the cells from `start` on.
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

    /// Cells of one sector, to be changed.
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
