//! The three transmit mailboxes (RM0090 32.7.1): priority, abort, what became of a request.

use super::message::Message;
use super::registers::{ir, tsr};

/// How many there are.
pub(super) const MAILBOXES: usize = 3;

#[derive(Clone, Debug, Default)]
struct Mailbox {
    registers: [u32; 4],
    pending: bool,
    /// It is to be emptied when the attempt that is on the wire fails.
    aborting: bool,
    /// Numbers the requests.
    request: u64,
    /// RQCP, TXOK, ALST and TERR.
    status: u32,
}

/// How an attempt ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Attempt {
    Sent,
    LostArbitration,
    Failed,
}

/// The mailboxes.
#[derive(Clone, Debug, Default)]
pub(super) struct Mailboxes {
    boxes: [Mailbox; MAILBOXES],
    requests: u64,
    /// The one whose message the bus was offered.
    offered: Option<usize>,
    on_wire: Option<usize>,
}

impl Mailboxes {
    /// Register 0 to 3 of a mailbox: identifier, length, data.
    pub(super) fn read(&self, mailbox: usize, register: usize) -> u32 {
        let found = &self.boxes[mailbox];
        found.registers[register] | if register == 0 && found.pending { ir::TXRQ } else { 0 }
    }

    /// Those of a mailbox that is not empty cannot be written. Says whether it was.
    pub(super) fn write(&mut self, mailbox: usize, register: usize, value: u32) -> bool {
        let target = &mut self.boxes[mailbox];
        if target.pending {
            return false;
        }
        target.registers[register] = if register == 0 { value & !ir::TXRQ } else { value };
        if register == 0 && value & ir::TXRQ != 0 {
            self.requests += 1;
            (target.pending, target.aborting, target.request, target.status) = (true, false, self.requests, 0);
        }
        true
    }

    /// The transmit status register; `by_request` when priority goes by the order of requests.
    pub(super) fn status(&self, by_request: bool) -> u32 {
        let mut value = 0;
        for (number, found) in self.boxes.iter().enumerate() {
            value |= found.status << (8 * number);
            value |= if found.aborting { tsr::ABRQ << (8 * number) } else { 0 };
            value |= u32::from(!found.pending) << (tsr::TME as usize + number);
        }
        let lowest = self.pending().max_by_key(|number| self.priority(*number, by_request));
        let next = self.boxes.iter().position(|found| !found.pending).or(lowest).unwrap_or(0);
        value |= (next as u32) << tsr::CODE;
        if let (Some(lowest), true) = (lowest, self.pending().count() > 1) {
            value |= 1 << (tsr::LOW as usize + lowest);
        }
        value
    }

    /// Flags are cleared by ones; the request flag takes the others along.
    pub(super) fn write_status(&mut self, value: u32) {
        for number in 0..MAILBOXES {
            let written = value >> (8 * number) & 0xFF;
            let target = &mut self.boxes[number];
            target.status &= if written & tsr::RQCP == 0 { !written } else { 0 };
            if written & tsr::ABRQ != 0 && target.pending {
                if self.on_wire == Some(number) {
                    target.aborting = true;
                } else {
                    // How an earlier attempt failed stands on.
                    target.pending = false;
                    target.status |= tsr::RQCP;
                }
            }
        }
    }

    /// The message that takes part in the next arbitration.
    pub(super) fn offer(&mut self, by_request: bool) -> Option<Message> {
        if self.on_wire.is_none() {
            self.offered = self.pending().min_by_key(|number| self.priority(*number, by_request));
        }
        self.offered.map(|number| Message::of_registers(self.boxes[number].registers))
    }

    /// The offered message is on the wire.
    pub(super) fn begin(&mut self) {
        self.on_wire = self.offered;
    }

    pub(super) const fn is_sending(&self) -> bool {
        self.on_wire.is_some()
    }

    /// An attempt with the offered message has ended. What was not sent is tried again, unless only `once` was wanted.
    pub(super) fn end(&mut self, attempt: Attempt, once: bool) {
        let Some(number) = self.on_wire.take().or(self.offered) else { return };
        self.offered = None;
        let target = &mut self.boxes[number];
        if !target.pending {
            return;
        }
        let done = attempt == Attempt::Sent || once || target.aborting;
        target.status = match attempt {
            Attempt::Sent => tsr::TXOK,
            Attempt::LostArbitration => tsr::ALST,
            Attempt::Failed => tsr::TERR,
        };
        if done {
            target.status |= tsr::RQCP;
            (target.pending, target.aborting) = (false, false);
        }
    }

    /// Whether a request was carried out and not yet acknowledged by software.
    pub(super) fn is_completed(&self) -> bool {
        self.boxes.iter().any(|found| found.status & tsr::RQCP != 0)
    }

    fn pending(&self) -> impl Iterator<Item = usize> {
        (0..MAILBOXES).filter(|number| self.boxes[*number].pending)
    }

    /// The lower, the earlier: by the order of requests, or by identifier and then by number.
    fn priority(&self, number: usize, by_request: bool) -> (u64, usize) {
        let found = &self.boxes[number];
        let arbitration = || u64::from(Message::of_registers(found.registers).frame.arbitration());
        (if by_request { found.request } else { arbitration() }, number)
    }
}
