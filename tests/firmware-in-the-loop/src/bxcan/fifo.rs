//! A receive FIFO (RM0090 32.7.3): three messages, overrun, lock.

use std::collections::VecDeque;

use super::message::Message;
use super::registers::rfr;

/// How many messages it stores.
const DEPTH: usize = 3;
/// A release takes so many accesses of the processor to the controller, or until the bus goes on. The manual says no more
/// than that hardware clears RFOM at its end (A).
const RELEASE: u8 = 2;

/// One receive FIFO.
#[derive(Clone, Debug, Default)]
pub(super) struct Fifo {
    /// Each with the index of the filter that it matched.
    messages: VecDeque<(Message, u8)>,
    full: bool,
    overrun: bool,
    /// The accesses to come before the output is released, while that is under way.
    releasing: u8,
    /// How many messages came, for tests.
    pub(super) came: u64,
    /// How many of them were lost, for tests.
    pub(super) lost: u32,
}

impl Fifo {
    /// Stores a message; in a full FIFO it takes the place of the last one, or is lost when that is `locked`.
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

    /// The processor accesses the controller.
    pub(super) fn pass_access(&mut self) {
        if self.releasing == 1 {
            self.messages.pop_front();
        }
        self.releasing = self.releasing.saturating_sub(1);
    }

    /// Time passes on the bus, much more than a release takes.
    pub(super) fn settle(&mut self) {
        (0..RELEASE).for_each(|_| self.pass_access());
    }

    /// Register 0 to 3 of the output mailbox: identifier, length and filter, data.
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
