//! What a port has to send: three mailboxes as a CAN controller has them, or the queue of a client.

use std::collections::VecDeque;

use protocol_core::controller::Filter;
use protocol_core::frame::Frame;

/// How many mailboxes a device's controller has, as bxCAN.
const MAILBOXES: usize = 3;

/// Frames that wait for the bus.
#[derive(Debug)]
pub(super) enum Transmit {
    /// A device's controller: the most urgent frame goes first, equal identifiers in the order they came in.
    Mailboxes(Mailboxes),
    /// A client: everything in the order it came in, however much.
    Queue(VecDeque<Frame>),
    /// A controller that lives elsewhere: its most urgent frame, and whether that is on the wire.
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

    /// What a controller that lives elsewhere would send next; one whose frame is on the wire is not asked.
    pub(super) const fn set_offer(&mut self, frame: Option<Frame>) {
        if let Self::Offer(offer, false) = self {
            *offer = frame;
        }
    }

    /// Takes a frame, perhaps giving back a less urgent one.
    ///
    /// # Errors
    /// When there is no room and nothing less urgent.
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

    /// The frame that takes part in the next arbitration.
    pub(super) fn head(&self) -> Option<&Frame> {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.head().and_then(|slot| mailboxes.slots[slot].frame.as_ref()),
            Self::Queue(queue) => queue.front(),
            Self::Offer(offer, _) => offer.as_ref(),
        }
    }

    /// The head is on the wire now and cannot be given back.
    pub(super) fn sending(&mut self) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.on_wire = mailboxes.head(),
            Self::Queue(_) => {}
            Self::Offer(_, on_wire) => *on_wire = true,
        }
    }

    /// The frame on the wire was sent, or has to be tried again.
    pub(super) fn sent(&mut self, success: bool) {
        match self {
            Self::Mailboxes(mailboxes) => {
                if let Some(slot) = mailboxes.on_wire.take()
                    && (success || mailboxes.slots[slot].aborted)
                {
                    mailboxes.slots[slot] = Mailbox::default();
                }
            }
            Self::Queue(queue) => {
                if success {
                    queue.pop_front();
                }
            }
            Self::Offer(..) => *self = Self::offer(),
        }
    }

    /// Drops the frames of these identifiers that wait; one on the wire is not repeated.
    pub(super) fn abort(&mut self, which: Filter) {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.abort(which),
            Self::Queue(queue) => queue.retain(|frame| !which.passes(frame)),
            Self::Offer(..) => {}
        }
    }

    pub(super) fn clear(&mut self) {
        match self {
            Self::Mailboxes(mailboxes) => *mailboxes = Mailboxes::default(),
            Self::Queue(queue) => queue.clear(),
            Self::Offer(..) => *self = Self::offer(),
        }
    }

    #[inline]
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.slots.iter().filter(|slot| slot.frame.is_some()).count(),
            Self::Queue(queue) => queue.len(),
            Self::Offer(offer, _) => usize::from(offer.is_some()),
        }
    }

    #[inline]
    pub(super) fn is_empty(&self) -> bool {
        match self {
            Self::Mailboxes(mailboxes) => mailboxes.slots.iter().all(|slot| slot.frame.is_none()),
            Self::Queue(queue) => queue.is_empty(),
            Self::Offer(offer, _) => offer.is_none(),
        }
    }
}

/// There is no room for a frame that is no more urgent than those that wait.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Full;

#[derive(Debug, Default)]
pub(super) struct Mailboxes {
    slots: [Mailbox; MAILBOXES],
    on_wire: Option<usize>,
    /// Numbers the frames in the order they came in.
    taken: u64,
}

#[derive(Debug, Default)]
struct Mailbox {
    frame: Option<Frame>,
    order: u64,
    /// The frame is on the wire, and goes no other time.
    aborted: bool,
}

impl Mailboxes {
    fn abort(&mut self, which: Filter) {
        for (number, slot) in self.slots.iter_mut().enumerate() {
            if slot.frame.is_none_or(|frame| !which.passes(&frame)) {
                continue;
            }
            if self.on_wire == Some(number) {
                slot.aborted = true;
            } else {
                *slot = Mailbox::default();
            }
        }
    }

    fn put(&mut self, frame: Frame) -> Result<Option<Frame>, Full> {
        let slot = match self.slots.iter().position(|slot| slot.frame.is_none()) {
            Some(free) => free,
            None => self.overtaken_by(&frame).ok_or(Full)?,
        };
        self.taken += 1;
        let overtaken = self.slots[slot].frame.replace(frame);
        self.slots[slot].order = self.taken;
        Ok(overtaken)
    }

    /// The most urgent frame; of equal identifiers the oldest.
    fn head(&self) -> Option<usize> {
        self.urgencies().min().map(|(_, _, slot)| slot)
    }

    /// The least urgent frame, of equal identifiers the youngest, if it is not on the wire and less urgent than `frame`.
    fn overtaken_by(&self, frame: &Frame) -> Option<usize> {
        let waiting = self.urgencies().filter(|(_, _, slot)| self.on_wire != Some(*slot));
        waiting.max().filter(|(arbitration, ..)| frame.arbitration() < *arbitration).map(|(_, _, slot)| slot)
    }

    fn urgencies(&self) -> impl Iterator<Item = (u32, u64, usize)> {
        let filled = |(slot, mailbox): (usize, &Mailbox)| Some((mailbox.frame?.arbitration(), mailbox.order, slot));
        self.slots.iter().enumerate().filter_map(filled)
    }
}
