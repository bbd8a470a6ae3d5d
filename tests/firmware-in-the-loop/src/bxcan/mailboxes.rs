//! The three transmit mailboxes (RM0090 32.7.1): priority, abort, and the results of requests.

use super::message::Message;
use super::registers::{ir, tsr};

/// The number of mailboxes.
pub(super) const MAILBOXES: usize = 3;

#[derive(Clone, Debug, Default)]
struct Mailbox {
    registers: [u32; 4],
    pending: bool,
    /// Whether the mailbox is emptied if the attempt on the wire fails.
    aborting: bool,
    /// The number of the request.
    request: u64,
    /// RQCP, TXOK, ALST and TERR.
    status: u32,
}

/// The result of an attempt.
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
    /// The mailbox whose message was offered to the bus.
    offered: Option<usize>,
    on_wire: Option<usize>,
}

impl Mailboxes {
    /// Returns register 0 to 3 of a mailbox: identifier, length, data.
    pub(super) fn read(&self, mailbox: usize, register: usize) -> u32 {
        let found = &self.boxes[mailbox];
        found.registers[register] | if register == 0 && found.pending { ir::TXRQ } else { 0 }
    }

    /// Writes a register of an empty mailbox. Returns whether the mailbox was empty.
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

    /// Returns the transmit status register. With `by_request`, the order of requests decides the priority.
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

    /// Writes the transmit status register. Ones clear flags, and the request flag clears the others with it.
    pub(super) fn write_status(&mut self, value: u32) {
        for number in 0..MAILBOXES {
            let written = value >> (8 * number) & 0xFF;
            let target = &mut self.boxes[number];
            target.status &= if written & tsr::RQCP == 0 { !written } else { 0 };
            if written & tsr::ABRQ != 0 && target.pending {
                if self.on_wire == Some(number) {
                    target.aborting = true;
                } else {
                    // The result of an earlier attempt stays.
                    target.pending = false;
                    target.status |= tsr::RQCP;
                }
            }
        }
    }

    /// Returns the message for the next arbitration.
    pub(super) fn offer(&mut self, by_request: bool) -> Option<Message> {
        if self.on_wire.is_none() {
            self.offered = self.pending().min_by_key(|number| self.priority(*number, by_request));
        }
        self.offered.map(|number| Message::of_registers(self.boxes[number].registers))
    }

    /// Records that the offered message is on the wire.
    pub(super) fn begin(&mut self) {
        self.on_wire = self.offered;
    }

    pub(super) const fn is_sending(&self) -> bool {
        self.on_wire.is_some()
    }

    /// Ends an attempt with the offered message. A message that was not sent is tried again, unless `once`.
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

    /// Returns whether a request is completed and software has not acknowledged it.
    pub(super) fn is_completed(&self) -> bool {
        self.boxes.iter().any(|found| found.status & tsr::RQCP != 0)
    }

    fn pending(&self) -> impl Iterator<Item = usize> {
        (0..MAILBOXES).filter(|number| self.boxes[*number].pending)
    }

    /// Returns the priority of a mailbox, lower first: by the order of requests, or by identifier and number.
    fn priority(&self, number: usize, by_request: bool) -> (u64, usize) {
        let found = &self.boxes[number];
        let arbitration = || u64::from(Message::of_registers(found.registers).frame.arbitration());
        (if by_request { found.request } else { arbitration() }, number)
    }
}
