//! The transmit mailboxes of a device's controller, modelled on bxCAN and its driver (RM0090 32.7.1).
//!
//! bxCAN sends frames with equal identifiers in mailbox order, not in request order. To preserve the order of requests,
//! the driver accepts a frame only if it is strictly more urgent than all pending frames.

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

/// The number of mailboxes.
pub(super) const MAILBOXES: usize = 3;

/// A set of [`MAILBOXES`] mailboxes.
#[derive(Clone, Debug, Default)]
pub(super) struct Mailboxes {
    /// The pending frames, in ascending order of urgency.
    waiting: Vec<Mailbox>,
}

#[derive(Clone, Debug)]
struct Mailbox {
    frame: Frame,
    /// Whether the frame is on the wire and cannot be displaced.
    on_wire: bool,
    /// Whether the frame was aborted on the wire and is dropped if this attempt fails.
    aborted: bool,
}

/// The mailboxes do not accept the frame now.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Full;

impl Mailboxes {
    /// Returns whether the mailboxes accept a frame: it must be more urgent than all pending frames.
    pub(super) fn takes(&self, frame: &Frame) -> bool {
        self.head().is_none_or(|head| head.arbitration() > frame.arbitration())
    }

    /// Stores a frame. If all mailboxes are full, removes and returns the least urgent frame that is not on the wire.
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

    /// Ends the attempt on the wire. Removes the frame if it was sent or aborted, otherwise keeps it for a retry.
    pub(super) fn sent(&mut self, success: bool) {
        self.waiting.retain_mut(|mailbox| {
            let done = std::mem::take(&mut mailbox.on_wire) && (success || mailbox.aborted);
            !done
        });
    }

    /// Drops the pending frames that pass `which`. A frame on the wire is not retransmitted if it fails.
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
