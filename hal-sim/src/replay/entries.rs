//! The entries of a log, without the jumps of its clock.
//!
//! A jump is a gap of more than a day, or a step back by more than a day: the clock was set, the bus was silent for
//! days, or the time is wrong. The replay continues at the time of the last entry. Otherwise it would simulate the gap,
//! which may be years.

use std::io;
use std::path::Path;

use crate::log::Timestamp;
use crate::recording::{Logged, ReadError, Reader};

/// The minimum length of a jump, in microseconds.
const JUMP: u64 = 24 * 60 * 60 * 1_000_000;

/// An entry whose time is free of jumps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) logged: Logged,
    /// The difference between this time and the time in the log, in microseconds.
    pub(super) shift: i64,
    /// The description of a jump immediately before this entry.
    pub(super) jump: Option<&'static str>,
}

/// A reader of a log that closes the jumps.
pub(super) struct Entries {
    reader: Reader,
    /// The latest time so far, free of jumps.
    last: Option<i64>,
    shift: i64,
    /// The shift before the last jump. The clock returns to it after a single wrong time.
    earlier: i64,
}

impl Entries {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        Ok(Self { reader: Reader::open(path)?, last: None, shift: 0, earlier: 0 })
    }

    fn place(&mut self, logged: Logged) -> Placed {
        let at = micros(logged.record.at);
        let last = self.last.unwrap_or(at);
        let is_near = |shift| at.saturating_add(shift).abs_diff(last) <= JUMP;
        let mut jump = None;
        if !is_near(self.shift) {
            let is_back = is_near(self.earlier);
            if !is_back {
                let is_later = at.saturating_add(self.shift) > last;
                let later = "time more than a day after the previous entry";
                jump = Some(if is_later { later } else { "time more than a day before the previous entry" });
            }
            // One microsecond later, so that each time has one shift.
            let shift = if is_back { self.earlier } else { last.saturating_add(1).saturating_sub(at) };
            self.earlier = std::mem::replace(&mut self.shift, shift);
        }
        let at = at.saturating_add(self.shift);
        self.last = Some(last.max(at));
        let mut logged = logged;
        logged.record.at = Timestamp::from_micros(u64::try_from(at).unwrap_or(0));
        Placed { logged, shift: self.shift, jump }
    }
}

impl Iterator for Entries {
    type Item = Result<Placed, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(self.reader.next()?.map(|logged| self.place(logged)))
    }
}

/// Returns a log time in microseconds, up to 292,000 years.
pub(super) fn micros(at: Timestamp) -> i64 {
    i64::try_from(at.as_micros()).unwrap_or(i64::MAX - 1)
}
