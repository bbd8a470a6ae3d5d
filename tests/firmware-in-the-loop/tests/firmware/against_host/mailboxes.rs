//! The host device's CAN controller: the mailboxes of the board's, without registers and interrupts.
//!
//! Of three mailboxes, each frame beyond the first is more urgent than all others. The next frame is staged.

use std::convert::Infallible;

use protocol_core::controller::{Controller, Filter, Filters};
use protocol_core::frame::Frame;

use super::host::REACTION;

const MAILBOXES: usize = 3;
/// The difference that a position may have: the path of a shaft at 3000 turns a minute in [`REACTION`].
const MOVED: u16 = 40;
/// The least position that cannot be taken for another number in a frame.
const UNMISTAKABLE: u16 = 0x100 + MOVED;

/// A frame that waits for the bus.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    frame: Frame,
    since: u64,
    /// The position of the device then, if the frame may tell another one.
    position: Option<i16>,
    on_wire: bool,
    /// The frame is not repeated.
    aborted: bool,
}

impl Waiting {
    /// Returns whether another frame is the same, but for a position that differs by [`MOVED`] at the most.
    fn is_like(&self, other: &Frame) -> bool {
        let is_near = |at: usize, position: i16| {
            let number = |frame: &Frame| i16::from_le_bytes([frame.bytes()[at], frame.bytes()[at + 1]]);
            let mut bytes = *self.frame.bytes();
            bytes[at..at + 2].copy_from_slice(&other.bytes()[at..at + 2]);
            [&self.frame, other].iter().all(|frame| number(frame).abs_diff(position) <= MOVED)
                && self.frame.refilled(bytes) == *other
        };
        self.frame == *other || self.position.is_some_and(|position| (0..7).any(|at| is_near(at, position)))
    }
}

/// The controller.
#[derive(Debug, Default)]
pub struct Mailboxes {
    /// Each more urgent than the one before.
    mailboxes: Vec<Waiting>,
    staged: Option<Waiting>,
    /// The time, in microseconds.
    now: u64,
    position: Option<i16>,
}

impl Mailboxes {
    /// Sets the time and the position of what is put into the mailboxes from now on. A shaft that `turned` has no
    /// position that is known to the microsecond.
    pub fn set(&mut self, now: u64, position: i16, turned: bool) {
        self.now = now;
        self.position = Some(position).filter(|_| turned || position.unsigned_abs() >= UNMISTAKABLE);
    }

    /// Returns the most urgent frame.
    pub fn head(&self) -> Option<&Frame> {
        self.mailboxes.last().map(|waiting| &waiting.frame)
    }

    /// Returns the instant since which a frame waits.
    pub fn since(&self) -> Option<u64> {
        self.mailboxes.iter().chain(&self.staged).map(|waiting| waiting.since).min()
    }

    /// Begins to send a frame: the most urgent one, or the one that was so less than [`REACTION`] ago. Returns false
    /// for any other frame.
    pub fn begin(&mut self, frame: &Frame, now: u64) -> bool {
        let is_late = |waiting: &&mut Waiting| !waiting.is_like(frame) && waiting.since + REACTION >= now;
        let head = self.mailboxes.iter_mut().rev().find(|waiting| !is_late(waiting));
        head.filter(|head| head.is_like(frame)).map(|head| head.on_wire = true).is_some()
    }

    /// Ends the frame on the wire.
    pub fn end(&mut self, sent: bool) {
        self.mailboxes.retain_mut(|waiting| {
            let was_on_wire = std::mem::take(&mut waiting.on_wire);
            !(was_on_wire && (sent || waiting.aborted))
        });
        self.load();
    }

    /// Drops all frames.
    pub fn clear(&mut self) {
        self.mailboxes.clear();
        self.staged = None;
    }

    /// Loads the staged frame into a mailbox, if there is one for it.
    fn load(&mut self) {
        if let Some(staged) = self.staged.take() {
            self.staged = self.offer(staged).unwrap_or_else(Some);
        }
    }

    /// Puts a frame into a mailbox, perhaps in the place of the least urgent one, which is returned.
    ///
    /// # Errors
    /// The frame itself when it has to wait.
    fn offer(&mut self, waiting: Waiting) -> Result<Option<Waiting>, Waiting> {
        let is_full = self.mailboxes.len() == MAILBOXES;
        let is_sending = self.mailboxes.iter().any(|waiting| waiting.on_wire);
        if is_full && is_sending || self.head().is_some_and(|head| head.arbitration() <= waiting.frame.arbitration()) {
            return Err(waiting);
        }
        let displaced = is_full.then(|| self.mailboxes.remove(0));
        self.mailboxes.push(waiting);
        Ok(displaced)
    }
}

impl embedded_can::nb::Can for Mailboxes {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        let is_before = |staged: Waiting, frame: &Frame| staged.frame.arbitration() < frame.arbitration();
        if self.staged.is_some_and(|staged| staged.frame.arbitration() <= frame.arbitration()) {
            return Err(nb::Error::WouldBlock);
        }
        let (since, position) = (self.now, self.position);
        let left = match self.offer(Waiting { frame: *frame, since, position, on_wire: false, aborted: false }) {
            Ok(Some(displaced)) if self.staged.is_some_and(|staged| is_before(staged, &displaced.frame)) => {
                Some(displaced)
            }
            Ok(None) => None,
            Ok(Some(next)) | Err(next) => self.staged.replace(next),
        };
        Ok(left.map(|left| left.frame))
    }

    /// Returns nothing: the host hands received frames to the device itself.
    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        Err(nb::Error::WouldBlock)
    }
}

impl Controller for Mailboxes {
    fn holds(&self, which: Filter) -> bool {
        let mut held = self.mailboxes.iter().chain(&self.staged);
        held.any(|waiting| which.passes(&waiting.frame))
    }

    fn abort(&mut self, which: Filter) {
        self.staged.take_if(|staged| which.passes(&staged.frame));
        self.mailboxes.retain_mut(|waiting| {
            let is_meant = which.passes(&waiting.frame);
            waiting.aborted |= is_meant;
            !is_meant || waiting.on_wire
        });
        self.load();
    }

    fn set_filters(&mut self, _: &Filters) {}
}
