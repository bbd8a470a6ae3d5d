//! Transmission: the most urgent frame first, frames back to back (RM0090 32.7.1).
//!
//! `bxcan` takes one frame and, while that waits, only strictly more urgent ones: up to three, and a fourth in the
//! place of the least urgent, which it hands back. The next frame in the order of arbitration is *staged* here. The
//! transmit interrupt loads it within the intermission.

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

/// The flags of the transmit status register that say that a mailbox is empty, all three.
const ALL_EMPTY: u32 = 0b111 << 26;

/// Shared by the transmit interrupt and the device's task. `bxcan` aborts inside [`Tx::transmit`] by reading flags that
/// the interrupt clears: only a critical section keeps it from sending a frame twice.
static TRANSMISSION: Mutex<RefCell<Option<Transmission>>> = Mutex::new(RefCell::new(None));

/// The staged frame waits for a mailbox, and perhaps no interrupt will tell of one.
static BLOCKED: AtomicBool = AtomicBool::new(false);

/// The transmit half of the controller.
pub(super) struct Transmission {
    tx: Tx<Registers>,
    /// The next frame to be loaded: it has to wait for a more urgent one, or for an equal one.
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

/// Gives the transmit interrupt its half of the controller.
pub(super) fn start(tx: Tx<Registers>) {
    critical_section::with(|cs| TRANSMISSION.replace(cs, Some(Transmission { tx, staged: None })));
}

/// Does something that the transmit interrupt does not interrupt; `None` before the [`start`].
pub(super) fn with<R>(act: impl FnOnce(&mut Transmission) -> R) -> Option<R> {
    critical_section::with(|cs| TRANSMISSION.borrow_ref_mut(cs).as_mut().map(act))
}

/// Tries to load a frame of which no interrupt would tell. Returns whether it still waits: to be called again in a
/// while.
pub(in crate::board) fn retry() -> bool {
    if BLOCKED.load(Ordering::Relaxed) {
        with(Transmission::load);
    }
    BLOCKED.load(Ordering::Relaxed)
}

impl Transmission {
    /// Returns whether everything was sent, or handed back.
    pub(super) fn is_idle(&self) -> bool {
        self.tx.is_idle() && self.staged.is_none()
    }

    /// Takes a frame, perhaps handing back a less urgent one.
    ///
    /// # Errors
    /// [`nb::Error::WouldBlock`] when it has to wait: the staged frame is at least as urgent.
    pub(super) fn put(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        // A frame that ended just now has made room for the staged one, which is earlier than an equal one.
        self.load();
        if self.staged.is_some_and(|staged| staged.arbitration() <= frame.arbitration()) {
            return Err(nb::Error::WouldBlock);
        }
        match self.offer(frame) {
            Ok(None) => Ok(None),
            // Of the displaced frame and the staged one the more urgent stays, or the displaced one: it is the earlier.
            Ok(Some(displaced)) => match self.staged {
                Some(staged) if staged.arbitration() < displaced.arbitration() => Ok(Some(displaced)),
                _ => Ok(self.staged.replace(displaced)),
            },
            Err(_) => Ok(self.staged.replace(*frame)),
        }
    }

    /// Drops the frames that a filter passes; one on the wire is not repeated when that attempt fails.
    pub(super) fn abort(&mut self, which: Filter) {
        self.staged.take_if(|frame| which.passes(frame));
        let status = CAN1.tsr().read();
        for mailbox in (0..3).filter(|mailbox| !status.tme(*mailbox)) {
            if which.passes(&Frame::remote(identifier(mailbox), 0)) {
                // Not by `bxcan`, which spins to the end of a frame on the wire.
                CAN1.tsr().write(|tsr| tsr.set_abrq(mailbox, true));
            }
        }
    }

    /// Loads the staged frame, if the controller takes it.
    fn load(&mut self) {
        if let Some(staged) = self.staged
            && let Ok(displaced) = self.offer(&staged)
        {
            self.staged = displaced;
        }
    }

    /// Has `bxcan` load a frame, perhaps in the place of another one.
    fn offer(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        // With all mailboxes full `bxcan` aborts one, and would spin to the end of a frame on the wire. No interrupt
        // tells when that frame loses arbitration.
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
