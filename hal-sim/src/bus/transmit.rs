//! The pending transmit frames of a port: device mailboxes, client queue or external controller's offer.

use std::collections::VecDeque;

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

use super::mailboxes::{Full, Mailboxes};

/// The pending transmit frames of a port.
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

    /// Returns whether a frame would be accepted.
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
    /// [`Full`] when the frame is not accepted now.
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
            Self::Offer(..) => *self = Self::offer(),
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
