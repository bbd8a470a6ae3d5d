//! Transmission: three mailboxes, the most urgent frame first (RM0090 32.7.1).
//!
//! The controller sends what is in its mailboxes in the order of arbitration. A more urgent frame that finds them full
//! takes the place of the least urgent one, which goes back to the device.

use core::sync::atomic::{AtomicU8, Ordering};

use embassy_stm32::interrupt;
use embassy_stm32::pac::CAN1;
use embassy_stm32::pac::can::regs;
use protocol_core::controller::Filter;
use protocol_core::frame::{Frame, Id};

use super::super::attention::{Caller, call};

const COUNT: usize = 3;

/// The flags of the transmit status register that say that a mailbox is empty, all three.
const ALL_EMPTY: u32 = 0b111 << 26;
/// These, and the flags that say that a request was carried out and nobody took note of it.
const PENDING_OR_COMPLETED: u32 = ALL_EMPTY | 1 << 16 | 1 << 8 | 1;

/// The mailboxes that were emptied without their frame having been sent: bits by number.
static ABORTED: AtomicU8 = AtomicU8::new(0);

#[interrupt]
fn CAN1_TX() {
    note_completed();
    call(Caller::Sent);
}

/// Takes note of what became of the mailboxes whose request was carried out.
fn note_completed() {
    let status = CAN1.tsr().read();
    let mut aborted = 0;
    CAN1.tsr().write(|clear| {
        for number in (0..COUNT).filter(|number| status.rqcp(*number)) {
            clear.set_rqcp(number, true);
            aborted |= u8::from(!status.txok(number)) << number;
        }
    });
    if aborted != 0 {
        ABORTED.fetch_or(aborted, Ordering::Relaxed);
    }
}

/// The mailboxes, and what is in them.
pub(super) struct Mailboxes {
    frames: [Option<Frame>; COUNT],
    /// A frame that was to be overtaken while it was on the wire, and then was not sent: it waits for another mailbox.
    recalled: Option<Frame>,
    /// One on the wire is to be overtaken, if it is not sent.
    recalling: bool,
}

impl Mailboxes {
    pub(super) const fn new() -> Self {
        Self { frames: [None; COUNT], recalled: None, recalling: false }
    }

    /// Takes a frame, perhaps handing back a less urgent one.
    ///
    /// # Errors
    /// [`Full`] when it has to wait: all mailboxes hold more urgent frames, or one holds a frame with the same identifier,
    /// which must go first.
    pub(super) fn put(&mut self, frame: &Frame) -> Result<Option<Frame>, Full> {
        self.collect();
        let waiting = self.frames.iter().flatten().chain(&self.recalled);
        if waiting.clone().any(|waiting| waiting.key() == frame.key()) {
            return Err(Full);
        }
        if let Some(free) = self.free() {
            self.load(free, *frame);
            return Ok(self.recalled.take());
        }
        // The least urgent one may be on the wire just now: then it is the turn of the next.
        for number in self.least_urgent_first() {
            let Some(held) = self.frames[number].filter(|held| frame.arbitration() < held.arbitration()) else { break };
            if abort(number) {
                self.load(number, *frame);
                return Ok(Some(held));
            }
            self.recalling = true;
        }
        Err(Full)
    }

    /// Puts a frame that lost its mailbox into a free one: nothing more urgent has come.
    pub(super) fn resume(&mut self) {
        if !self.recalling {
            return;
        }
        self.collect();
        if let (Some(frame), Some(free)) = (self.recalled, self.free()) {
            self.recalled = None;
            self.load(free, frame);
        }
        self.recalling = self.recalled.is_some() || !self.are_empty();
    }

    /// Whether all that was put in was sent, or handed back.
    pub(super) fn are_empty(&self) -> bool {
        CAN1.tsr().read().0 & PENDING_OR_COMPLETED == ALL_EMPTY
            && self.recalled.is_none()
            && ABORTED.load(Ordering::Relaxed) == 0
    }

    /// Drops the frames of these identifiers; one on the wire is not repeated when that attempt fails.
    pub(super) fn abort(&mut self, which: Filter) {
        self.collect();
        self.recalled.take_if(|frame| which.passes(frame));
        for number in 0..COUNT {
            if self.frames[number].take_if(|frame| which.passes(frame)).is_some() {
                // What becomes of one on the wire is nobody's concern any more.
                abort(number);
            }
        }
    }

    /// Forgets everything but what is on the wire.
    pub(super) fn clear(&mut self) {
        CAN1.tsr().write(|tsr| (0..COUNT).for_each(|number| tsr.set_abrq(number, true)));
        self.frames = [None; COUNT];
        self.recalled = None;
        ABORTED.store(0, Ordering::Relaxed);
        // What becomes of a frame on the wire is found out later.
        self.recalling = true;
    }

    /// Finds out what became of the frames whose mailbox is empty.
    fn collect(&mut self) {
        // In this order: what is empty now was taken note of before.
        let empty = (0..COUNT).filter(|number| is_empty(*number)).fold(0, |empty, number| empty | 1 << number);
        let aborted = ABORTED.fetch_and(!empty, Ordering::Relaxed) & empty;
        for number in (0..COUNT).filter(|number| empty & 1 << number != 0) {
            if let Some(frame) = self.frames[number].take()
                && aborted & 1 << number != 0
                && let Some(earlier) = self.recalled.replace(frame)
            {
                self.load(number, earlier);
            }
        }
    }

    fn free(&self) -> Option<usize> {
        (0..COUNT).find(|number| self.frames[*number].is_none() && is_empty(*number))
    }

    fn least_urgent_first(&self) -> [usize; COUNT] {
        let mut numbers = [0, 1, 2];
        let urgency = |number: &usize| self.frames[*number].map_or(0, |frame| frame.arbitration());
        numbers.sort_unstable_by_key(|number| core::cmp::Reverse(urgency(number)));
        numbers
    }

    fn load(&mut self, number: usize, frame: Frame) {
        let identifier = match frame.id() {
            Id::Standard(id) => u32::from(id.as_raw()) << 21,
            Id::Extended(id) => id.as_raw() << 3 | 1 << 2,
        };
        let [a, b, c, d, e, f, g, h] = *frame.bytes();
        let mailbox = CAN1.tx(number);
        mailbox.tdtr().write_value(regs::Tdtr(frame.len().into()));
        mailbox.tdlr().write_value(regs::Tdlr(u32::from_le_bytes([a, b, c, d])));
        mailbox.tdhr().write_value(regs::Tdhr(u32::from_le_bytes([e, f, g, h])));
        ABORTED.fetch_and(!(1 << number), Ordering::Relaxed);
        self.frames[number] = Some(frame);
        mailbox.tir().write_value(regs::Tir(identifier | u32::from(frame.is_remote()) << 1 | 1));
    }
}

/// There is no room.
pub(super) struct Full;

/// Whether a mailbox is empty, and what became of its last frame was taken note of.
fn is_empty(number: usize) -> bool {
    let status = CAN1.tsr().read();
    status.tme(number) && !status.rqcp(number)
}

/// Empties a mailbox, if its frame is not on the wire, and says whether it did. One on the wire is emptied when that
/// attempt fails.
fn abort(number: usize) -> bool {
    critical_section::with(|_| {
        if CAN1.tsr().read().tme(number) {
            // It ended since it was last looked at, and the interrupt has cleared what says how.
            return false;
        }
        CAN1.tsr().write(|tsr| tsr.set_abrq(number, true));
        let status = CAN1.tsr().read();
        // It may have been sent a moment ago: that is the interrupt's to find out.
        let aborted = status.tme(number) && !status.txok(number);
        if aborted {
            CAN1.tsr().write(|tsr| tsr.set_rqcp(number, true));
        }
        aborted
    })
}
