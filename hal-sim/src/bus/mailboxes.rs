//! The transmit mailboxes of a device's controller, as bxCAN and its driver use them (RM0090 32.7.1).
//!
//! bxCAN sends equal identifiers in the order of the mailboxes' numbers. So that frames keep their order, the driver
//! takes a frame beyond the first one only if it is strictly more urgent than every other: the last one taken goes
//! first.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

/// How many there are.
pub(super) const MAILBOXES: usize = 3;

/// Three mailboxes.
#[derive(Clone, Debug, Default)]
pub(super) struct Mailboxes {
    /// The frames that wait, each more urgent than the one before.
    waiting: Vec<Mailbox>,
}

#[derive(Clone, Debug)]
struct Mailbox {
    frame: Frame,
    /// The frame is on the wire, and cannot be handed back.
    on_wire: bool,
    /// The frame is not repeated when its attempt fails.
    aborted: bool,
}

/// The frame has to wait: there is no room for it now.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Full;

impl Mailboxes {
    /// Takes a frame. Returns the least urgent one when all mailboxes are full, but never the one on the wire.
    ///
    /// # Errors
    /// [`Full`] when a frame waits that is as urgent, or more.
    pub(super) fn put(&mut self, frame: Frame) -> Result<Option<Frame>, Full> {
        if self.head().is_some_and(|head| head.arbitration() <= frame.arbitration()) {
            return Err(Full);
        }
        let full = self.waiting.len() >= MAILBOXES;
        let least = self.waiting.iter().position(|mailbox| !mailbox.on_wire).filter(|_| full);
        let overtaken = least.map(|least| self.waiting.remove(least).frame);
        self.waiting.push(Mailbox { frame, on_wire: false, aborted: false });
        Ok(overtaken)
    }

    /// Returns the most urgent frame.
    #[inline]
    pub(super) fn head(&self) -> Option<&Frame> {
        self.waiting.last().map(|mailbox| &mailbox.frame)
    }

    /// Notes that the most urgent frame is on the wire now.
    pub(super) fn sending(&mut self) {
        if let Some(head) = self.waiting.last_mut() {
            head.on_wire = true;
        }
    }

    /// Notes that the frame on the wire was sent, or has to be tried again.
    pub(super) fn sent(&mut self, success: bool) {
        self.waiting.retain_mut(|mailbox| {
            let done = std::mem::take(&mut mailbox.on_wire) && (success || mailbox.aborted);
            !done
        });
    }

    /// Drops the frames of these identifiers that wait; one on the wire is not repeated.
    pub(super) fn abort(&mut self, which: Filter) {
        self.waiting.retain_mut(|mailbox| {
            let meant = which.passes(&mailbox.frame);
            mailbox.aborted |= meant;
            !meant || mailbox.on_wire
        });
    }

    /// Drops everything.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
    }

    #[inline]
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    #[inline]
    pub(super) const fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }
}
