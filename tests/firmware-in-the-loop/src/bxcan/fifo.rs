//! A receive FIFO (RM0090 32.7.3): three messages, overrun, lock.

use std::collections::VecDeque;

use super::message::Message;
use super::registers::rfr;

/// The number of messages that a FIFO stores.
const DEPTH: usize = 3;
/// The number of accesses of the processor that a release takes, unless the bus goes on before. The manual says only
/// that hardware clears RFOM at the end (A).
const RELEASE: u8 = 2;

/// A receive FIFO.
#[derive(Clone, Debug, Default)]
pub(super) struct Fifo {
    /// The messages, each with the index of the filter that it matched.
    messages: VecDeque<(Message, u8)>,
    full: bool,
    overrun: bool,
    /// The number of accesses until the output is released.
    releasing: u8,
    /// The number of messages so far, for tests.
    pub(super) came: u64,
    /// The number of lost messages, for tests.
    pub(super) lost: u32,
}

impl Fifo {
    /// Stores a message. A full FIFO replaces its last message, or loses the new one if `locked`.
    pub(super) fn store(&mut self, message: Message, filter: u8, locked: bool) {
        self.came += 1;
        if self.messages.len() == DEPTH {
            self.overrun = true;
            self.lost += 1;
            if locked {
                return;
            }
            self.messages.pop_back();
        }
        self.messages.push_back((message, filter));
        self.full |= self.messages.len() == DEPTH;
    }

    pub(super) fn read(&self) -> u32 {
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        let flags = flag(self.full, rfr::FULL) | flag(self.overrun, rfr::FOVR);
        self.messages.len() as u32 | flags | flag(self.is_releasing(), rfr::RFOM)
    }

    pub(super) fn write(&mut self, value: u32) {
        self.full &= value & rfr::FULL == 0;
        self.overrun &= value & rfr::FOVR == 0;
        if value & rfr::RFOM != 0 && self.is_pending() {
            self.releasing = RELEASE;
        }
    }

    pub(super) const fn is_releasing(&self) -> bool {
        self.releasing > 0
    }

    /// Counts an access of the processor to the controller.
    pub(super) fn pass_access(&mut self) {
        if self.releasing == 1 {
            self.messages.pop_front();
        }
        self.releasing = self.releasing.saturating_sub(1);
    }

    /// Ends a release, because time has passed on the bus.
    pub(super) fn settle(&mut self) {
        (0..RELEASE).for_each(|_| self.pass_access());
    }

    /// Returns register 0 to 3 of the output mailbox: identifier, length and filter, data.
    pub(super) fn output(&self, register: usize) -> u32 {
        let Some((message, filter)) = self.messages.front() else { return 0 };
        match register {
            0 => message.identifier(),
            1 => u32::from(*filter) << 8 | u32::from(message.dlc),
            2 => message.data()[0],
            _ => message.data()[1],
        }
    }

    pub(super) fn is_pending(&self) -> bool {
        !self.messages.is_empty()
    }

    pub(super) fn clear(&mut self) {
        *self = Self { came: self.came, lost: self.lost, ..Self::default() };
    }
}
