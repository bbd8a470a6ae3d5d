//! The pending transmit frames of a port: device mailboxes, client queue or external controller's offer.

use std::collections::VecDeque;
use std::convert::Infallible;

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

#[derive(Clone, Debug)]
pub(super) enum Transmit {
    /// The mailboxes of a device's controller, which sends the most urgent frame first.
    Mailboxes(Mailboxes),
    /// The unlimited FIFO queue of a client.
    Queue(VecDeque<Frame>),
    /// The offer of an external controller: its most urgent frame, if any, and whether that frame is on the wire.
    Offer(Option<Frame>, bool),
}

impl Transmit {
    /// Sets the offer of an external controller, unless its frame is on the wire.
    pub(super) const fn set_offer(&mut self, frame: Option<Frame>) {
        if let Self::Offer(offer, false) = self {
            *offer = frame;
        }
    }

    pub(super) fn takes(&self, frame: &Frame) -> bool {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.takes(frame),
            Self::Queue(_) => true,
            Self::Offer(..) => false,
        }
    }

    /// Stores a frame. Returns the less urgent frame that it displaces, if any.
    ///
    /// # Errors
    /// `WouldBlock` if the frame is not accepted now.
    pub(super) fn put(&mut self, frame: Frame) -> nb::Result<Option<Frame>, Infallible> {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.put(frame),
            Self::Queue(queue) => {
                queue.push_back(frame);
                Ok(None)
            }
            Self::Offer(..) => Err(nb::Error::WouldBlock),
        }
    }

    /// Returns the frame for the next arbitration.
    pub(super) fn head(&self) -> Option<&Frame> {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.head(),
            Self::Queue(queue) => queue.front(),
            Self::Offer(offer, _) => offer.as_ref(),
        }
    }

    /// Marks the head as on the wire: it cannot be displaced.
    pub(super) fn sending(&mut self) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.sending(),
            Self::Queue(_) => {}
            Self::Offer(_, on_wire) => *on_wire = true,
        }
    }

    /// Ends the attempt on the wire. Removes a sent or aborted frame; keeps a failed frame for a retry. The offer of an
    /// external controller is removed in any case.
    pub(super) fn sent(&mut self, success: bool) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.sent(success),
            Self::Queue(queue) => {
                if success {
                    queue.pop_front();
                }
            }
            Self::Offer(..) => *self = Self::Offer(None, false),
        }
    }

    /// Drops the pending frames that pass `which`. A mailbox frame on the wire is not retransmitted if it fails.
    pub(super) fn abort(&mut self, which: Filter) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.abort(which),
            Self::Queue(queue) => queue.retain(|frame| !which.passes(frame)),
            Self::Offer(..) => {}
        }
    }

    /// Drops the queued frames of a client except the frame on the wire.
    pub(super) fn drop_waiting(&mut self, is_sending: bool) {
        if let Self::Queue(queue) = self {
            queue.truncate(usize::from(is_sending));
        }
    }

    pub(super) fn clear(&mut self) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.waiting.clear(),
            Self::Queue(queue) => queue.clear(),
            Self::Offer(..) => *self = Self::Offer(None, false),
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.waiting.len(),
            Self::Queue(queue) => queue.len(),
            Self::Offer(offer, _) => usize::from(offer.is_some()),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.head().is_none()
    }
}

const MAILBOXES: usize = 3;

/// The transmit mailboxes of a device's controller, modelled on bxCAN and its driver (RM0090 32.7.1).
///
/// bxCAN sends frames with equal identifiers in mailbox order, not in request order. To preserve the order of requests,
/// the driver accepts a frame only if it is strictly more urgent than all pending frames.
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

impl Mailboxes {
    /// Returns whether the mailboxes accept a frame, which must be more urgent than all pending frames.
    fn takes(&self, frame: &Frame) -> bool {
        self.head().is_none_or(|head| head.arbitration() > frame.arbitration())
    }

    /// Stores a frame. If all mailboxes are full, removes and returns the least urgent frame that is not on the wire.
    fn put(&mut self, frame: Frame) -> nb::Result<Option<Frame>, Infallible> {
        if !self.takes(&frame) {
            return Err(nb::Error::WouldBlock);
        }
        let full = self.waiting.len() >= MAILBOXES;
        let least = self.waiting.iter().position(|mailbox| !mailbox.on_wire).filter(|_| full);
        let overtaken = least.map(|least| self.waiting.remove(least).frame);
        self.waiting.push(Mailbox { frame, on_wire: false, aborted: false });
        Ok(overtaken)
    }

    fn head(&self) -> Option<&Frame> {
        self.waiting.last().map(|mailbox| &mailbox.frame)
    }

    /// Marks the most urgent frame as on the wire.
    fn sending(&mut self) {
        if let Some(head) = self.waiting.last_mut() {
            head.on_wire = true;
        }
    }

    /// Ends the attempt on the wire. Removes the frame if it was sent or aborted, otherwise keeps it for a retry.
    fn sent(&mut self, success: bool) {
        self.waiting.retain_mut(|mailbox| {
            let done = std::mem::take(&mut mailbox.on_wire) && (success || mailbox.aborted);
            !done
        });
    }

    /// Drops the pending frames that pass `which`. A frame on the wire is not retransmitted if it fails.
    fn abort(&mut self, which: Filter) {
        self.waiting.retain_mut(|mailbox| {
            let meant = which.passes(&mailbox.frame);
            mailbox.aborted |= meant;
            !meant || mailbox.on_wire
        });
    }
}
