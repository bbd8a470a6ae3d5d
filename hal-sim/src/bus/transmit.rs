//! The pending transmit frames of a port: device mailboxes, client queue or external controller's offer.

use std::collections::VecDeque;
use std::convert::Infallible;

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

/// The kind of a port's transmit buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TransmitKind {
    /// The mailboxes of a device's controller, modelled on bxCAN and its driver (RM0090 32.7.1).
    ///
    /// bxCAN sends frames with equal identifiers in mailbox order, not in request order. To preserve the order of
    /// requests, the driver accepts a frame only if it is strictly more urgent than all pending frames.
    Mailboxes,
    /// The unlimited FIFO queue of a client.
    Queue,
    /// The offer of an external controller: its most urgent frame, if any.
    Offer,
}

const MAILBOXES: usize = 3;

/// The pending transmit frames of a port.
#[derive(Clone, Debug)]
pub(super) struct Transmit {
    pub(super) kind: TransmitKind,
    /// The frames in the order of transmission.
    pending: VecDeque<Pending>,
}

#[derive(Clone, Debug)]
struct Pending {
    frame: Frame,
    /// True if the frame is on the wire and cannot be displaced.
    on_wire: bool,
    /// True if the frame was aborted on the wire and is dropped if this attempt fails.
    aborted: bool,
}

impl Transmit {
    pub(super) const fn new(kind: TransmitKind) -> Self {
        Self { kind, pending: VecDeque::new() }
    }

    /// Sets the offer of an external controller, unless its frame is on the wire.
    pub(super) fn set_offer(&mut self, frame: Option<Frame>) {
        if !self.pending.front().is_some_and(|pending| pending.on_wire) {
            self.pending = frame.map(Pending::new).into_iter().collect();
        }
    }

    pub(super) fn takes(&self, frame: &Frame) -> bool {
        match self.kind {
            TransmitKind::Mailboxes => self.head().is_none_or(|head| head.arbitration() > frame.arbitration()),
            TransmitKind::Queue => true,
            TransmitKind::Offer => false,
        }
    }

    /// Stores a frame. If all mailboxes are full, removes and returns the least urgent frame that is not on the wire.
    ///
    /// # Errors
    /// `WouldBlock` if the frame is not accepted now.
    pub(super) fn put(&mut self, frame: Frame) -> nb::Result<Option<Frame>, Infallible> {
        if !self.takes(&frame) {
            return Err(nb::Error::WouldBlock);
        }
        if self.kind == TransmitKind::Queue {
            self.pending.push_back(Pending::new(frame));
            return Ok(None);
        }
        let mut overtaken = None;
        if self.pending.len() >= MAILBOXES {
            let least = self.pending.iter().rposition(|pending| !pending.on_wire);
            overtaken = least.and_then(|least| self.pending.remove(least)).map(|pending| pending.frame);
        }
        self.pending.push_front(Pending::new(frame));
        Ok(overtaken)
    }

    /// Returns the frame for the next arbitration.
    pub(super) fn head(&self) -> Option<&Frame> {
        self.pending.front().map(|pending| &pending.frame)
    }

    /// Marks the head as on the wire. A marked frame cannot be displaced.
    pub(super) fn sending(&mut self) {
        if let Some(head) = self.pending.front_mut() {
            head.on_wire = true;
        }
    }

    /// Ends the attempt on the wire. Removes a sent or aborted frame; keeps a failed frame for a retry. The offer of an
    /// external controller is removed in any case.
    pub(super) fn sent(&mut self, success: bool) {
        if self.kind == TransmitKind::Offer {
            return self.clear();
        }
        let is_sent = |pending: &mut Pending| std::mem::take(&mut pending.on_wire) && (success || pending.aborted);
        // Usually the frame on the wire is the first, whose removal moves no other frame.
        if self.pending.front().is_some_and(|head| head.on_wire) {
            self.pending.pop_front_if(is_sent);
        } else {
            self.pending.retain_mut(|pending| !is_sent(pending));
        }
    }

    /// Drops the pending frames that pass `which`. A matching frame on the wire is not retransmitted if this attempt
    /// fails.
    pub(super) fn abort(&mut self, which: Filter) {
        self.pending.retain_mut(|pending| {
            let meant = which.passes(&pending.frame);
            pending.aborted |= meant;
            !meant || pending.on_wire
        });
    }

    /// Drops all pending frames except the frame on the wire.
    pub(super) fn drop_waiting(&mut self) {
        self.pending.retain(|pending| pending.on_wire);
    }

    pub(super) fn clear(&mut self) {
        self.pending.clear();
    }

    pub(super) fn len(&self) -> usize {
        self.pending.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.pending.is_empty()
    }

    /// Returns whether a frame that passes `which` is pending.
    pub(super) fn holds(&self, which: Filter) -> bool {
        self.pending.iter().any(|pending| which.passes(&pending.frame))
    }
}

impl Pending {
    const fn new(frame: Frame) -> Self {
        Self { frame, on_wire: false, aborted: false }
    }
}
