//! The transmission of frames: the most urgent frame first, and frames back to back (RM0090 32.7.1).
//!
//! `bxcan` holds up to three frames. While frames are pending, it accepts only a more urgent frame. A fourth frame
//! replaces the least urgent frame, which `bxcan` returns. The next frame in the order of arbitration is *staged* here;
//! the transmit interrupt loads it within the intermission.

use core::cell::RefCell;
use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering};

use bxcan::Tx;
use critical_section::Mutex;
use embassy_stm32::interrupt;
use embassy_stm32::pac::CAN1;
use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

use super::Registers;
use super::frames::{convert, identifier};
use crate::board::wake_up::{Event, notify};

/// The three flags of the transmit status register that mark a mailbox as empty.
const ALL_EMPTY: u32 = 0b111 << 26;

/// The transmit half, which the transmit interrupt and the device task share. [`Tx::transmit`] reads flags that
/// the interrupt clears, in order to abort a mailbox. Without a critical section a frame could be sent twice.
static TRANSMISSION: Mutex<RefCell<Option<Transmission>>> = Mutex::new(RefCell::new(None));

/// Whether the staged frame waits for a mailbox whose release may cause no interrupt.
static BLOCKED: AtomicBool = AtomicBool::new(false);

/// The transmit half of the controller.
pub(super) struct Transmission {
    tx: Tx<Registers>,
    /// The next frame to load. It waits while a frame in a mailbox is at least as urgent.
    staged: Option<Frame>,
}

#[interrupt]
fn CAN1_TX() {
    with(|transmission| {
        transmission.tx.clear_interrupt_flags();
        transmission.load();
    });
    notify(Event::Sent);
}

/// Hands the transmit half of the controller to the interrupt.
pub(super) fn start(tx: Tx<Registers>) {
    critical_section::with(|cs| TRANSMISSION.replace(cs, Some(Transmission { tx, staged: None })));
}

/// Calls `act` without preemption by the transmit interrupt. Returns `None` before [`start`].
pub(super) fn with<R>(act: impl FnOnce(&mut Transmission) -> R) -> Option<R> {
    critical_section::with(|cs| TRANSMISSION.borrow_ref_mut(cs).as_mut().map(act))
}

/// Tries to load a blocked frame, because no interrupt may report that its mailbox is free. Returns whether the frame
/// is still blocked.
pub(in crate::board) fn retry() -> bool {
    if BLOCKED.load(Ordering::Relaxed) {
        with(Transmission::load);
    }
    BLOCKED.load(Ordering::Relaxed)
}

impl Transmission {
    /// Returns whether a frame that passes a filter is pending.
    pub(super) fn holds(&self, which: Filter) -> bool {
        if self.tx.is_idle() && self.staged.is_none() {
            return false;
        }
        which == Filter::ALL
            || self.staged.is_some_and(|frame| which.passes(&frame))
            || occupied().any(|mailbox| passes(which, mailbox))
    }

    /// Accepts a frame for transmission. Returns the less urgent frame that the new frame displaces, if any.
    ///
    /// # Errors Returns [`nb::Error::WouldBlock`] if the staged frame is at least as urgent.
    pub(super) fn put(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        // A mailbox that has just become free takes the staged frame first, because it is older than an equally urgent
        // new frame.
        self.load();
        if self.staged.is_some_and(|staged| staged.arbitration() <= frame.arbitration()) {
            return Err(nb::Error::WouldBlock);
        }
        match self.offer(frame) {
            Ok(None) => Ok(None),
            // The more urgent of the displaced and the staged frame is staged. Of equally urgent frames this is the
            // displaced frame, which is older.
            Ok(Some(displaced)) => match self.staged {
                Some(staged) if staged.arbitration() < displaced.arbitration() => Ok(Some(displaced)),
                _ => Ok(self.staged.replace(displaced)),
            },
            Err(_) => Ok(self.staged.replace(*frame)),
        }
    }

    /// Drops the frames that pass a filter. A frame on the wire is not repeated after an error.
    pub(super) fn abort(&mut self, which: Filter) {
        self.staged.take_if(|frame| which.passes(frame));
        for mailbox in occupied().filter(|mailbox| passes(which, *mailbox)) {
            // `bxcan` would busy-wait for the end of a frame on the wire.
            CAN1.tsr().write(|tsr| tsr.set_abrq(mailbox, true));
        }
    }

    /// Loads the staged frame if the controller accepts it. A displaced frame is then staged.
    fn load(&mut self) {
        if let Some(staged) = self.staged
            && let Ok(displaced) = self.offer(&staged)
        {
            self.staged = displaced;
        }
    }

    /// Loads a frame into a mailbox through `bxcan`. Returns the frame displaced from the mailbox, if any.
    fn offer(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        // With all mailboxes full, `bxcan` aborts a mailbox, and would busy-wait for the end of a frame on the wire. No
        // interrupt reports that this frame has lost arbitration.
        let blocked = CAN1.tsr().read().0 & ALL_EMPTY == 0 && CAN1.msr().read().txm();
        BLOCKED.store(blocked, Ordering::Relaxed);
        if blocked {
            return Err(nb::Error::WouldBlock);
        }
        let Some(frame) = convert(frame) else { return Ok(None) };
        let status = self.tx.transmit(&frame)?;
        Ok(status.dequeued_frame().and_then(convert))
    }
}

/// Returns the mailboxes that hold a frame.
fn occupied() -> impl Iterator<Item = usize> {
    let status = CAN1.tsr().read();
    (0..3).filter(move |mailbox| !status.tme(*mailbox))
}

/// Returns whether the frame in a mailbox passes a filter.
fn passes(which: Filter, mailbox: usize) -> bool {
    which.passes(&Frame::remote(identifier(mailbox), 0))
}
