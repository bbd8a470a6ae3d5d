//! The transmit mailboxes of a device's controller, as bxCAN and its driver use them (RM0090 32.7.1).
//!
//! bxCAN sends equal identifiers in the order of the mailboxes' numbers. To keep the order of frames, the driver
//! accepts a further frame only if it is strictly more urgent than all waiting ones: the last one accepted goes first.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

/// The number of mailboxes.
pub(super) const MAILBOXES: usize = 3;

/// Three mailboxes.
#[derive(Clone, Debug, Default)]
pub(super) struct Mailboxes {
    /// The waiting frames, each more urgent than the one before.
    waiting: Vec<Mailbox>,
}

#[derive(Clone, Debug)]
struct Mailbox {
    frame: Frame,
    /// The frame is on the wire and cannot be handed back.
    on_wire: bool,
    /// The frame is not repeated when its attempt fails.
    aborted: bool,
}

/// No mailbox is free for the frame now.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Full;

impl Mailboxes {
    /// Returns whether they would take a frame: it is more urgent than all that wait.
    pub(super) fn takes(&self, frame: &Frame) -> bool {
        self.head().is_none_or(|head| head.arbitration() > frame.arbitration())
    }

    /// Stores a frame. Returns the least urgent frame when all mailboxes are full, but never the one on the wire.
    ///
    /// # Errors
    /// [`Full`] when an equally or more urgent frame waits.
    pub(super) fn put(&mut self, frame: Frame) -> Result<Option<Frame>, Full> {
        if !self.takes(&frame) {
            return Err(Full);
        }
        let full = self.waiting.len() >= MAILBOXES;
        let least = self.waiting.iter().position(|mailbox| !mailbox.on_wire).filter(|_| full);
        let overtaken = least.map(|least| self.waiting.remove(least).frame);
        self.waiting.push(Mailbox { frame, on_wire: false, aborted: false });
        Ok(overtaken)
    }

    /// Returns the most urgent frame.
    pub(super) fn head(&self) -> Option<&Frame> {
        self.waiting.last().map(|mailbox| &mailbox.frame)
    }

    /// Marks the most urgent frame as on the wire.
    pub(super) fn sending(&mut self) {
        if let Some(head) = self.waiting.last_mut() {
            head.on_wire = true;
        }
    }

    /// Ends the attempt on the wire: the frame was sent, or waits for a retry.
    pub(super) fn sent(&mut self, success: bool) {
        self.waiting.retain_mut(|mailbox| {
            let done = std::mem::take(&mut mailbox.on_wire) && (success || mailbox.aborted);
            !done
        });
    }

    /// Drops the waiting frames with these identifiers; the frame on the wire is not repeated.
    pub(super) fn abort(&mut self, which: Filter) {
        self.waiting.retain_mut(|mailbox| {
            let meant = which.passes(&mailbox.frame);
            mailbox.aborted |= meant;
            !meant || mailbox.on_wire
        });
    }

    /// Drops all frames.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
    }

    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }
}
