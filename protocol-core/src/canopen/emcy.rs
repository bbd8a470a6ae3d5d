//! EMCY (CiA 301 7.2.7): the error history (0x1003), the queue of unsent messages, the producer (0x1014) and the
//! consumer (0x1028).

use heapless::Vec;

use crate::controller::MAILBOXES;
use crate::frame::Id;
use crate::wire::cob_id::CobId;
use crate::wire::emcy::{Emcy, NO_ERROR};
use crate::wire::sdo::AbortCode;

/// The maximum number of errors in the history (SPEC 4.1).
pub(crate) const HISTORY: usize = 8;

/// The capacity of the queue (A). It is enough for the beginning and the end of every fault of a device.
const QUEUE: usize = 16;

/// The error history, object 0x1003. It is volatile (A).
#[derive(Clone, Debug)]
pub(crate) struct ErrorHistory {
    /// The errors, newest first.
    fields: [u32; HISTORY],
    count: u8,
}

impl ErrorHistory {
    /// Creates an empty history.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { fields: [0; HISTORY], count: 0 }
    }

    /// Returns the number of errors, sub-index 0.
    #[must_use]
    pub(crate) const fn count(&self) -> u8 {
        self.count
    }

    /// Removes all errors.
    pub(crate) const fn clear(&mut self) {
        *self = Self::new();
    }

    /// Adds an error: the EMCY code, with the manufacturer-specific number in the upper 16 bits. A ninth error
    /// displaces the oldest.
    pub(crate) fn enter(&mut self, code: u16, manufacturer: u16) {
        let newest = u32::from(manufacturer) << 16 | u32::from(code);
        let [a, b, c, d, e, f, g, _] = self.fields;
        self.fields = [newest, a, b, c, d, e, f, g];
        self.count = self.count.saturating_add(1).min(HISTORY as u8);
    }

    /// Removes the newest error with this code.
    pub(crate) fn withdraw(&mut self, code: u16) {
        let entered = self.fields.iter().take(self.count.into());
        let Some(position) = entered.map(|field| *field as u16).position(|entered| entered == code) else { return };
        if let Some(later) = self.fields.get_mut(position..) {
            later.rotate_left(1);
        }
        self.count = self.count.saturating_sub(1);
    }

    /// Returns the number of errors with this code and manufacturer-specific number.
    #[must_use]
    pub(crate) fn times(&self, code: u16, manufacturer: u16) -> u8 {
        let field = u32::from(manufacturer) << 16 | u32::from(code);
        let entered = self.fields.iter().take(self.count.into());
        entered.filter(|entered| **entered == field).fold(0, |times, _| times.saturating_add(1))
    }

    /// Returns the error of a sub-index; 1 is the newest.
    ///
    /// # Errors
    /// Returns [`AbortCode::NO_DATA`] beyond the number of errors.
    pub(crate) fn field(&self, sub: u8) -> Result<u32, AbortCode> {
        let age = sub.checked_sub(1).filter(|age| *age < self.count).ok_or(AbortCode::NO_DATA)?;
        self.fields.get(usize::from(age)).copied().ok_or(AbortCode::NO_DATA)
    }

    /// Writes sub-index 0. The value 0 clears the history.
    ///
    /// # Errors
    /// Returns [`AbortCode::INVALID_VALUE`] for any other value.
    pub(crate) fn write_count(&mut self, count: u8) -> Result<(), AbortCode> {
        if count != 0 {
            return Err(AbortCode::INVALID_VALUE);
        }
        self.clear();
        Ok(())
    }
}

/// An unsent EMCY.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    message: Emcy,
    /// Whether the error history has an entry for the message.
    entered: bool,
}

/// The unsent EMCYs in order. A full queue drops its oldest message, so that the newest message is always queued.
///
/// A message in the controller stays in the queue until it is known to be sent.
#[derive(Clone, Debug)]
pub(crate) struct EmcyQueue {
    messages: Vec<Waiting, QUEUE>,
    /// The number of messages in the controller. They are the first of the queue.
    taken: usize,
}

impl EmcyQueue {
    /// Creates an empty queue.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { messages: Vec::new(), taken: 0 }
    }

    /// Appends a message. `entered` is true if the error history has an entry for the error. Returns `false` if a full
    /// queue has dropped its oldest message unsent.
    #[must_use]
    pub(crate) fn push(&mut self, message: Emcy, entered: bool) -> bool {
        let mut kept = true;
        if self.messages.is_full() {
            self.messages.remove(0);
            kept = self.taken > 0;
            self.taken = self.taken.saturating_sub(1);
        }
        // Cannot fail, because there is room.
        let _ = self.messages.push(Waiting { message, entered });
        kept
    }

    /// Returns whether a message waits for the controller.
    #[inline]
    #[must_use]
    pub(crate) fn is_pending(&self) -> bool {
        self.messages.len() > self.taken
    }

    /// Returns whether the controller may hold a message.
    #[must_use]
    pub(crate) const fn is_taken(&self) -> bool {
        self.taken > 0
    }

    /// Returns whether every message is known to be sent.
    #[must_use]
    pub(crate) fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// Returns the oldest message that waits for the controller, and marks it as taken.
    pub(crate) fn hand_out(&mut self) -> Option<Emcy> {
        let Waiting { message, .. } = *self.messages.get(self.taken)?;
        if self.taken == MAILBOXES {
            self.messages.remove(0);
        } else {
            self.taken = self.taken.saturating_add(1);
        }
        Some(message)
    }

    /// Requeues a message that the controller returned, ahead of the messages that wait. Returns `false` if the queue
    /// no longer lists the message as in the controller, for example because newer messages have displaced it.
    #[must_use]
    pub(crate) fn give_back(&mut self, message: Emcy) -> bool {
        let is_it = |position: &usize| self.messages.get(*position).is_some_and(|waiting| waiting.message == message);
        let position = (0..self.taken).rev().find(is_it);
        let Some(position) = position else { return false };
        self.taken = self.taken.saturating_sub(1);
        for later in position..self.taken {
            self.messages.swap(later, later.saturating_add(1));
        }
        true
    }

    /// Removes the unsent messages of an error. The controller must not hold messages. Returns the number of their
    /// history entries.
    ///
    /// An error has a message for its beginning and another for its end. The end is the first later message with code
    /// 0000 whose error register lacks a bit of `register`. An end whose beginning is not in the queue stays.
    pub(crate) fn withdraw(&mut self, code: u16, register: u8) -> u8 {
        let mut entries: u8 = 0;
        let mut lasts = false;
        self.messages.retain(|Waiting { message, entered }| {
            let begins = message.code == code;
            let ends = lasts && message.code == NO_ERROR && message.register & register != register;
            entries = entries.saturating_add((begins && *entered).into());
            lasts = begins || lasts && !ends;
            !begins && !ends
        });
        entries
    }

    /// Requeues all messages of a controller that has dropped its frames.
    pub(crate) const fn take_back(&mut self) {
        self.taken = 0;
    }

    /// Removes the messages in the controller, which has sent all its frames.
    pub(crate) fn sent(&mut self) {
        if self.taken > 0 {
            self.drop_taken();
        }
    }

    fn drop_taken(&mut self) {
        // The controller holds at most three messages. A rotation instead of the loop would cost 200 more bytes of
        // code.
        for _ in 0..core::mem::take(&mut self.taken) {
            self.messages.remove(0);
        }
    }

    /// Removes all messages.
    pub(crate) fn clear(&mut self) {
        self.messages.clear();
        self.taken = 0;
    }
}

/// The EMCY producer, which holds the COB-ID of the node's EMCYs, object 0x1014.
#[derive(Clone, Debug)]
pub(crate) struct EmcyProducer {
    cob_id: CobId,
}

impl EmcyProducer {
    /// Creates a producer that is off.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { cob_id: CobId::new(CobId::OFF) }
    }

    /// Returns object 0x1014 as written.
    #[must_use]
    pub(crate) const fn cob_id(&self) -> CobId {
        self.cob_id
    }

    /// Writes object 0x1014. The value takes effect at once. Bit 31 switches EMCYs off. The identifier is then not
    /// checked, and can differ from the previous identifier.
    ///
    /// # Errors
    /// - [`AbortCode::INVALID_VALUE`] for bit 30. Without bit 31, also for a restricted identifier, and for a 29-bit
    ///   identifier without `extended_ids`.
    /// - [`AbortCode::DEVICE_STATE`] for another identifier without bit 31 while EMCYs are on.
    pub(crate) fn write(&mut self, raw: u32, extended_ids: bool) -> Result<(), AbortCode> {
        let cob_id = CobId::new(raw);
        if cob_id.has_bit_30() {
            return Err(AbortCode::INVALID_VALUE);
        }
        if !cob_id.is_off() && cob_id != self.cob_id {
            if !cob_id.is_usable(extended_ids) {
                return Err(AbortCode::INVALID_VALUE);
            }
            if !self.cob_id.is_off() && cob_id.key() != self.cob_id.key() {
                return Err(AbortCode::DEVICE_STATE);
            }
        }
        self.cob_id = cob_id;
        Ok(())
    }

    /// Loads a stored or default COB-ID.
    pub(crate) const fn load(&mut self, raw: u32) {
        self.cob_id = CobId::new(raw);
    }

    /// Returns the identifier of the node's EMCYs; `None` while they are off.
    #[must_use]
    pub(crate) fn id(&self) -> Option<Id> {
        (!self.cob_id.is_off()).then(|| self.cob_id.id())
    }

    /// Returns the [key](crate::frame::key) of the node's EMCYs; `None` while they are off.
    #[must_use]
    pub(crate) fn key(&self) -> Option<u32> {
        (!self.cob_id.is_off()).then(|| self.cob_id.key())
    }
}

/// The EMCY consumer, which holds the COB-ID of another node's EMCYs, object 0x1028:1.
#[derive(Clone, Debug)]
pub(crate) struct EmcyConsumer {
    cob_id: CobId,
}

impl EmcyConsumer {
    /// The default of object 0x1028:1: off.
    pub(crate) const DEFAULT: u32 = CobId::OFF;

    /// Creates a consumer that is off.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { cob_id: CobId::new(Self::DEFAULT) }
    }

    /// Returns object 0x1028:1 as written.
    #[must_use]
    pub(crate) const fn cob_id(&self) -> CobId {
        self.cob_id
    }

    /// Writes object 0x1028:1. The value takes effect at once. Bit 31 switches the consumer off. The other bits are
    /// then not checked, and read back as written (A).
    ///
    /// # Errors
    /// Returns [`AbortCode::INVALID_VALUE`] for a restricted identifier, and for a 29-bit identifier without
    /// `extended_ids`.
    pub(crate) fn write(&mut self, raw: u32, extended_ids: bool) -> Result<(), AbortCode> {
        let cob_id = CobId::new(raw);
        if !cob_id.is_off() && cob_id != self.cob_id && !cob_id.is_usable(extended_ids) {
            return Err(AbortCode::INVALID_VALUE);
        }
        self.cob_id = cob_id;
        Ok(())
    }

    /// Loads a stored or default COB-ID.
    pub(crate) const fn load(&mut self, raw: u32) {
        self.cob_id = CobId::new(raw);
    }

    /// Returns the [key](crate::frame::key) of the EMCYs to consume; `None` while the consumer is off.
    #[must_use]
    pub(crate) fn key(&self) -> Option<u32> {
        (!self.cob_id.is_off()).then(|| self.cob_id.key())
    }
}
