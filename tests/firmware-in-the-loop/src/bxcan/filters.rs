//! The filter banks (RM0090 32.7.4 and 32.9.4).

use super::registers::{F0R1, FA1R, FFA1R, FM1R, FMR, FS1R, ir};

/// The number of banks that CAN1 and CAN2 share.
const BANKS: usize = 28;
/// Filter initialization, in which nothing is received.
const FINIT: u32 = 1;
/// The bit position of the first bank of CAN2 in FMR.
const CAN2SB: u32 = 8;
const FMR_AT_RESET: u32 = 0x2A1C_0E01;
const FMR_WRITABLE: u32 = 0x3F01;
const ALL_BANKS: u32 = (1 << BANKS) - 1;

/// The banks, from the view of CAN1.
#[derive(Clone, Debug)]
pub(super) struct Filters {
    master: u32,
    list: u32,
    wide: u32,
    fifo: u32,
    active: u32,
    banks: [[u32; 2]; BANKS],
    /// The contents of a bank at its deactivation.
    before: [Option<[u32; 2]>; BANKS],
    /// The number of changes in which frames that were wanted before and after could be lost, for tests.
    pub(super) gaps: u32,
}

/// The destination of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Match {
    pub(super) fifo: usize,
    /// The filter match index: the number of the filter among those of its FIFO.
    pub(super) index: u8,
}

impl Default for Filters {
    fn default() -> Self {
        Self {
            master: FMR_AT_RESET,
            list: 0,
            wide: 0,
            fifo: 0,
            active: 0,
            banks: [[0; 2]; BANKS],
            before: [None; BANKS],
            gaps: 0,
        }
    }
}

impl Filters {
    pub(super) fn read(&self, offset: u32) -> u32 {
        match offset {
            FMR => self.master,
            FM1R => self.list,
            FS1R => self.wide,
            FFA1R => self.fifo,
            FA1R => self.active,
            _ => bank_register(offset).map_or(0, |(bank, register)| self.banks[bank][register]),
        }
    }

    /// Writes a register. Returns whether it was writable.
    pub(super) fn write(&mut self, offset: u32, value: u32) -> bool {
        let initializing = self.master & FINIT != 0;
        match offset {
            FMR => {
                self.gaps += u32::from(!initializing && value & FINIT != 0 && self.active != 0);
                self.master = self.master & !FMR_WRITABLE | value & FMR_WRITABLE;
            }
            FM1R if initializing => self.list = value & ALL_BANKS,
            FS1R if initializing => self.wide = value & ALL_BANKS,
            FFA1R if initializing => self.fifo = value & ALL_BANKS,
            FA1R => {
                self.note_gaps(value);
                self.active = value & ALL_BANKS;
            }
            FM1R | FS1R | FFA1R => return false,
            _ => match bank_register(offset) {
                Some((bank, register)) if initializing || self.active >> bank & 1 == 0 => {
                    self.banks[bank][register] = value;
                }
                Some(_) => return false,
                None => {}
            },
        }
        true
    }

    /// Counts banks that are activated again with the same contents, because frames were lost meanwhile.
    fn note_gaps(&mut self, active: u32) {
        for (bank, registers) in self.banks.iter().enumerate() {
            match (self.active >> bank & 1, active >> bank & 1) {
                (1, 0) => self.before[bank] = Some(*registers),
                (0, 1) => self.gaps += u32::from(self.before[bank].take() == Some(*registers)),
                _ => {}
            }
        }
    }

    /// Returns the filter that accepts a message with this identifier register. A wider filter goes first, then a list
    /// before a mask, then the lower number.
    pub(super) fn find(&self, identifier: u32) -> Option<Match> {
        if self.master & FINIT != 0 {
            return None;
        }
        let first_of_can2 = (self.master >> CAN2SB & 0x3F) as usize;
        let mut numbers = [0u8; 2];
        let mut best: Option<((bool, bool), Match)> = None;
        for bank in 0..first_of_can2.min(BANKS) {
            let is = |bits: u32| bits >> bank & 1 == 1;
            let (wide, list, fifo) = (is(self.wide), is(self.list), usize::from(is(self.fifo)));
            let (place, filters) = accepts(self.banks[bank], wide, list, identifier);
            let rank = (!wide, !list);
            if let Some(place) = place
                && is(self.active)
                && best.is_none_or(|(found, _)| rank < found)
            {
                best = Some((rank, Match { fifo, index: numbers[fifo] + place }));
            }
            // Inactive filters are numbered, too.
            numbers[fifo] += filters;
        }
        best.map(|(_, found)| found)
    }
}

/// Returns the filter of a bank that accepts the identifier, and the number of filters in the bank.
fn accepts([first, second]: [u32; 2], wide: bool, list: bool, identifier: u32) -> (Option<u8>, u8) {
    let position = |filters: &[bool]| filters.iter().position(|filter| *filter).map(|place| place as u8);
    if wide {
        // Bit 0 does not belong to the identifier.
        let equal = |other: u32, mask: u32| (identifier ^ other) & mask & !1 == 0;
        return if list {
            (position(&[equal(first, u32::MAX), equal(second, u32::MAX)]), 2)
        } else {
            (position(&[equal(first, second)]), 1)
        };
    }
    let narrow = narrow(identifier);
    let halves = |register: u32| [register as u16, (register >> 16) as u16];
    let ([a, b], [c, d]) = (halves(first), halves(second));
    if list {
        (position(&[a, b, c, d].map(|filter| filter == narrow)), 4)
    } else {
        (position(&[(a ^ narrow) & b == 0, (c ^ narrow) & d == 0]), 2)
    }
}

/// Returns the 16 bits of an identifier register that a filter of 16 bits compares: STID[10:0], RTR, IDE, EXID[17:15].
fn narrow(identifier: u32) -> u16 {
    let base = identifier >> ir::STID;
    let extension = identifier >> (ir::EXID + 15) & 0b111;
    let flag = |bit: u32, place: u32| if identifier & bit == 0 { 0 } else { 1 << place };
    (base << 5 | flag(ir::RTR, 4) | flag(ir::IDE, 3) | extension) as u16
}

fn bank_register(offset: u32) -> Option<(usize, usize)> {
    let place = offset.checked_sub(F0R1)? as usize / 4;
    (place < 2 * BANKS).then_some((place / 2, place % 2))
}
