//! The flash interface and the sectors of the memory, of an STM32F429ZI (RM0090 chapter 3, DS9405 for the times) or an
//! STM32F446RE (RM0390 chapter 3, DS10693). The model programs and erases the memory.
//!
//! To the emulator the sectors of the image are plain memory, and programming or erasing them causes a complaint. With
//! two banks, so does an access that stalls the processor on silicon: to bank 2 or to the control register during an
//! operation there. The same holds for a data cache that would return wrong data: with two banks an operation while the
//! cache is on (ES0206); with one or two a cached read of data that changed since its reset (RM0090 3.6.4, RM0390
//! 3.5.4). Any complaint fails the harness.
//!
//! With one bank the processor [is held](Flash::holds) from the instruction that begins an operation to its end. On
//! silicon it can execute some more instructions from the caches (A).
//!
//! Left out: option bytes, protection, an instruction fetch from the memory.

mod array;
pub mod registers;

#[cfg(test)]
mod tests;

pub use array::{ERASED, Layout, SECTOR_SIZE};

use array::Array;
use registers::*;

/// A time in nanoseconds since the power came.
pub type Nanos = u64;

/// The duration of programming, whatever the width (DS9405 and DS10693, typical).
pub const PROGRAM_TIME: Nanos = 16_000;
/// The maximum duration of programming.
const LONGEST_PROGRAM_TIME: Nanos = 100_000;
/// The ratio of the longest erase to the typical one, for all sectors and widths.
const LONGEST_ERASE: Nanos = 2;
/// A time that is never reached.
const FOR_EVER: Nanos = 1 << 60;

/// An operation that has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Operation {
    what: What,
    /// The beginning of the operation.
    pub from: Nanos,
    /// The end of the operation, unless it is cut.
    pub until: Nanos,
}

impl Operation {
    /// Returns whether the operation is an erase, not the write of a word.
    #[must_use]
    pub const fn is_erase(&self) -> bool {
        self.erased().is_some()
    }

    /// Returns the offset of the erased sector in the memory.
    #[must_use]
    pub const fn erased(&self) -> Option<usize> {
        if let What::Erase { from, .. } = self.what { Some(from) } else { None }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    Program { offset: usize, bytes: usize, value: u64 },
    Erase { from: usize, size: usize },
}

/// The flash interface with its memory, whose content outlives resets and power cuts.
#[derive(Clone, Debug)]
pub struct Flash {
    layout: Layout,
    array: Array,
    keys: Keys,
    access: u32,
    /// Whether the data cache may hold data that have changed since.
    stale: bool,
    control: u32,
    status: u32,
    operation: Option<Operation>,
    fails: bool,
    slow: bool,
    stuck: bool,
    complaints: Vec<String>,
    programs: u64,
    erases: u64,
    journal: Vec<Operation>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keys {
    None,
    First,
    /// A wrong key has locked the register until the next reset.
    Wrong,
}

impl Default for Flash {
    fn default() -> Self {
        Self {
            layout: Layout::TWO_BANKS,
            array: Array::erased(&Layout::TWO_BANKS),
            keys: Keys::None,
            access: 0,
            stale: false,
            control: cr::LOCK,
            status: 0,
            operation: None,
            fails: false,
            slow: false,
            stuck: false,
            complaints: Vec::new(),
            programs: 0,
            erases: 0,
            journal: Vec::new(),
        }
    }
}

/// The side of a test.
impl Flash {
    /// Creates a flash whose memory begins with these bytes.
    #[must_use]
    pub fn of(layout: Layout, content: &[u8]) -> Self {
        let mut flash = Self { layout, ..Self::default() };
        flash.restore(content);
        flash
    }

    /// Replaces the memory by these bytes, as a programming adapter does. The rest is erased.
    pub fn restore(&mut self, content: &[u8]) {
        self.array = Array::erased(&self.layout);
        self.array.fill(0, content);
    }

    /// Makes programming and erasing take the maximum time of the data sheet, or the typical one.
    pub const fn set_slow(&mut self, slow: bool) {
        self.slow = slow;
    }

    /// Makes erases last until a reset, or end again.
    pub const fn set_stuck(&mut self, stuck: bool) {
        self.stuck = stuck;
    }

    /// Returns the first `size` bytes of the memory.
    #[must_use]
    pub fn content(&self, size: usize) -> &[u8] {
        self.array.bytes(0, size)
    }

    /// Makes programming and erasing fail as on protected sectors, or succeed again.
    pub const fn set_fails(&mut self, fails: bool) {
        self.fails = fails;
    }

    /// Takes the complaints about the firmware.
    pub fn take_complaints(&mut self) -> Vec<String> {
        std::mem::take(&mut self.complaints)
    }

    /// Returns the number of programmed words and of erased sectors.
    #[must_use]
    pub const fn wear(&self) -> (u64, u64) {
        (self.programs, self.erases)
    }

    /// Returns all operations since the power came or the last reset.
    #[must_use]
    pub fn journal(&self) -> &[Operation] {
        &self.journal
    }

    /// Returns the end of the operation in progress.
    #[must_use]
    pub fn due(&self) -> Option<Nanos> {
        self.operation.map(|operation| operation.until)
    }

    /// Handles a reset or a loss of the supply. An operation in progress is torn, in a way that depends on the seed.
    pub fn reset(&mut self, now: Nanos, seed: u64) {
        self.settle(now);
        let mut random = fastrand::Rng::with_seed(seed ^ now);
        match self.operation.take().map(|operation| operation.what) {
            None => {}
            // Some of the bits have changed.
            Some(What::Program { offset, bytes, value }) => {
                let value = value | random.u64(..);
                self.array.program(offset, bytes, value);
            }
            Some(What::Erase { from, size }) => self.array.erase_partly(from, size, &mut random),
        }
        let Self { layout, array, fails, slow, stuck, complaints, programs, erases, .. } = std::mem::take(self);
        *self = Self { layout, array, fails, slow, stuck, complaints, programs, erases, ..Self::default() };
    }
}

/// The side of the processor.
impl Flash {
    /// Reads the register at an offset of the interface; `None` for one that only stores its value.
    pub fn read_register(&mut self, offset: u32, now: Nanos) -> Option<u32> {
        self.settle(now);
        match offset {
            ACR => Some(self.access),
            KEYR | OPTKEYR => Some(0),
            SR => Some(self.status | if self.operation.is_some() { sr::BSY } else { 0 }),
            CR => Some(self.control),
            _ => None,
        }
    }

    /// Writes the register at an offset of the interface.
    pub fn write_register(&mut self, offset: u32, value: u32, now: Nanos) {
        self.settle(now);
        match offset {
            ACR => self.set_access(value & acr::ALL, now),
            KEYR => self.unlock(value),
            SR => self.status &= !value,
            CR if self.operation.is_some() => {
                self.complain(now, "CR is written while BSY: silicon stalls the processor");
            }
            CR if self.control & cr::LOCK == 0 => {
                self.control = value & cr::ALL;
                if value & cr::LOCK != 0 {
                    self.keys = Keys::None;
                } else if value & cr::STRT != 0 {
                    self.erase(now);
                }
            }
            _ => {}
        }
    }

    /// Reads at an offset into the memory.
    pub fn read(&mut self, offset: usize, bytes: usize, now: Nanos) -> u64 {
        self.settle(now);
        if self.operation.is_some() {
            self.complain(
                now,
                &format!("the memory is read at {offset:#x} while it is busy: silicon stalls the processor"),
            );
        }
        if self.stale && self.access & acr::DCEN != 0 {
            self.complain(now, "the memory is read through a data cache that was not reset since it was changed");
        }
        self.array.read(offset, bytes)
    }

    /// Writes at an offset into the memory.
    pub fn write(&mut self, offset: usize, bytes: usize, value: u64, now: Nanos) {
        self.settle(now);
        if self.operation.is_some() {
            self.complain(now, "the memory is written while it is busy: silicon stalls the processor");
            return;
        }
        let width = 1 << (self.control >> cr::PSIZE & 3);
        if self.control & (cr::LOCK | cr::PG | cr::SER | cr::MER | cr::MER1) != cr::PG {
            self.fail(sr::PGSERR);
        } else if bytes != width {
            self.fail(sr::PGPERR);
        } else if self.fails {
            self.fail(sr::WRPERR);
        } else {
            let what = What::Program { offset, bytes, value };
            let time = if self.slow { LONGEST_PROGRAM_TIME } else { PROGRAM_TIME };
            self.begin(Operation { what, from: now, until: now + time });
        }
    }

    /// Returns whether the processor stalls, because an operation is in progress in the bank from which it runs.
    #[must_use]
    pub fn holds(&self, now: Nanos) -> bool {
        !self.layout.two_banks && self.operation.is_some_and(|operation| operation.until > now)
    }

    /// Returns the level of the interrupt line.
    #[must_use]
    pub const fn interrupt(&self) -> bool {
        self.status & sr::EOP != 0 && self.control & cr::EOPIE != 0
            || self.status & sr::OPERR != 0 && self.control & cr::ERRIE != 0
    }

    /// Ends the operations that are due by `now`.
    pub fn settle(&mut self, now: Nanos) {
        let Some(Operation { what, .. }) = self.operation.take_if(|operation| operation.until <= now) else { return };
        self.stale = true;
        match what {
            What::Program { offset, bytes, value } => {
                self.array.program(offset, bytes, value);
                self.programs += 1;
            }
            What::Erase { from, size } => {
                self.array.erase(from, size);
                self.erases += 1;
                self.control &= !cr::STRT;
            }
        }
        if self.control & cr::EOPIE != 0 {
            self.status |= sr::EOP;
        }
    }

    fn set_access(&mut self, value: u32, now: Nanos) {
        if value & acr::DCRST != 0 {
            if self.access & acr::DCEN != 0 {
                self.complain(now, "the data cache is reset while it is on");
            } else {
                self.stale = false;
            }
        }
        self.access = value;
    }

    fn begin(&mut self, operation: Operation) {
        if self.layout.two_banks && self.access & acr::DCEN != 0 {
            self.complain(
                operation.from,
                "bank 2 is changed while the data cache is on: reads may be corrupt (ES0206)",
            );
        }
        self.operation = Some(operation);
        self.journal.push(operation);
    }

    fn unlock(&mut self, key: u32) {
        self.keys = match (self.keys, key) {
            (Keys::None, KEY1) => Keys::First,
            (Keys::First, KEY2) => {
                self.control &= !cr::LOCK;
                Keys::None
            }
            _ => Keys::Wrong,
        };
    }

    fn erase(&mut self, now: Nanos) {
        let parallelism = self.control >> cr::PSIZE & 3;
        let sector = self.control >> cr::SNB & 0x1F;
        if self.control & (cr::MER | cr::MER1) != 0 || self.control & cr::SER == 0 {
            self.complain(now, "an erase other than that of a sector of the memory is started");
        } else if let Some((from, size)) = self.layout.sector(sector) {
            if self.fails {
                self.control &= !cr::STRT;
                self.fail(sr::WRPERR);
                return;
            }
            let typical = array::erase_time(size, parallelism);
            let until = match (self.stuck, self.slow) {
                (true, _) => FOR_EVER,
                (false, true) => now + LONGEST_ERASE * typical,
                (false, false) => now + typical,
            };
            self.begin(Operation { what: What::Erase { from, size }, from: now, until });
            return;
        } else {
            self.complain(now, &format!("SNB {sector:#x} is erased, which is no sector of the memory"));
        }
        self.control &= !cr::STRT;
        self.fail(sr::WRPERR);
    }

    fn fail(&mut self, error: u32) {
        self.status |= error;
        if self.control & cr::ERRIE != 0 {
            self.status |= sr::OPERR;
        }
    }

    fn complain(&mut self, now: Nanos, what: &str) {
        self.complaints.push(format!("flash, {} us after power-up: {what}", now / 1000));
    }
}
