//! The frames that a port has to send: the mailboxes of a device, the queue of a client, the offer of an external
//! controller.

use std::collections::VecDeque;

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

use super::mailboxes::{Full, Mailboxes};

/// Frames that wait for the bus.
#[derive(Clone, Debug)]
pub(super) enum Transmit {
    /// Mailboxes of a device's controller: the most urgent frame goes first.
    Mailboxes(Mailboxes),
    /// Unlimited queue of a client: first in, first out.
    Queue(VecDeque<Frame>),
    /// Offer of an external controller: its most urgent frame, and whether it is on the wire.
    Offer(Option<Frame>, bool),
}

impl Transmit {
    pub(super) fn mailboxes() -> Self {
        Self::Mailboxes(Mailboxes::default())
    }

    pub(super) const fn queue() -> Self {
        Self::Queue(VecDeque::new())
    }

    pub(super) const fn offer() -> Self {
        Self::Offer(None, false)
    }

    /// Sets the offer of an external controller, unless its frame is on the wire.
    pub(super) const fn set_offer(&mut self, frame: Option<Frame>) {
        if let Self::Offer(offer, false) = self {
            *offer = frame;
        }
    }

    /// Returns whether it would take a frame.
    pub(super) fn takes(&self, frame: &Frame) -> bool {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.takes(frame),
            Self::Queue(_) => true,
            Self::Offer(..) => false,
        }
    }

    /// Stores a frame; may return a less urgent one.
    ///
    /// # Errors
    /// [`Full`] when the frame has to wait.
    pub(super) fn put(&mut self, frame: Frame) -> Result<Option<Frame>, Full> {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.put(frame),
            Self::Queue(queue) => {
                queue.push_back(frame);
                Ok(None)
            }
            Self::Offer(..) => Err(Full),
        }
    }

    /// Returns the frame that takes part in the next arbitration.
    pub(super) fn head(&self) -> Option<&Frame> {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.head(),
            Self::Queue(queue) => queue.front(),
            Self::Offer(offer, _) => offer.as_ref(),
        }
    }

    /// Marks the head as on the wire: it cannot be handed back.
    pub(super) fn sending(&mut self) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.sending(),
            Self::Queue(_) => {}
            Self::Offer(_, on_wire) => *on_wire = true,
        }
    }

    /// Ends the attempt on the wire: the frame was sent, or waits for a retry.
    pub(super) fn sent(&mut self, success: bool) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.sent(success),
            Self::Queue(queue) => {
                if success {
                    queue.pop_front();
                }
            }
            Self::Offer(..) => *self = Self::offer(),
        }
    }

    /// Drops the waiting frames with these identifiers; the frame on the wire is not repeated.
    pub(super) fn abort(&mut self, which: Filter) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.abort(which),
            Self::Queue(queue) => queue.retain(|frame| !which.passes(frame)),
            Self::Offer(..) => {}
        }
    }

    /// Drops what waits in a client's queue, but not a frame on the wire.
    pub(super) fn drop_waiting(&mut self, is_sending: bool) {
        if let Self::Queue(queue) = self {
            queue.truncate(usize::from(is_sending));
        }
    }

    pub(super) fn clear(&mut self) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.clear(),
            Self::Queue(queue) => queue.clear(),
            Self::Offer(..) => *self = Self::offer(),
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.len(),
            Self::Queue(queue) => queue.len(),
            Self::Offer(offer, _) => usize::from(offer.is_some()),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.is_empty(),
            Self::Queue(queue) => queue.is_empty(),
            Self::Offer(offer, _) => offer.is_none(),
        }
    }
}
