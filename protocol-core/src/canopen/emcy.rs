//! EMCY: the error history (0x1003), what waits to be sent, and the consumer (0x1028) (CiA 301 7.2.7).

use heapless::Deque;

use crate::wire::cob_id::CobId;
use crate::wire::emcy::Emcy;
use crate::wire::sdo::AbortCode;

/// How many errors the history holds (SPEC 4.1).
pub const HISTORY: usize = 8;

/// How many messages can wait until the bus can be used: every fault of a device, and its end, with some room.
const WAITING: usize = 24;

/// The error history, object 0x1003.
#[derive(Debug, Default)]
pub struct ErrorHistory {
    /// The newest first.
    fields: [u32; HISTORY],
    count: u8,
}

impl ErrorHistory {
    /// An empty history.
    #[must_use]
    pub const fn new() -> Self {
        Self { fields: [0; HISTORY], count: 0 }
    }

    /// The number of errors, sub-index 0.
    #[must_use]
    pub const fn count(&self) -> u8 {
        self.count
    }

    /// Enters an error: the EMCY code, and what the manufacturer adds in the upper half. The oldest of nine is lost.
    pub fn enter(&mut self, code: u16, manufacturer: u16) {
        let newest = u32::from(manufacturer) << 16 | u32::from(code);
        let [a, b, c, d, e, f, g, _] = self.fields;
        self.fields = [newest, a, b, c, d, e, f, g];
        self.count = self.count.saturating_add(1).min(HISTORY as u8);
    }

    /// An error, sub-index 1 being the newest.
    ///
    /// # Errors
    /// [`AbortCode::NO_DATA`] beyond the number of errors.
    pub fn field(&self, sub: u8) -> Result<u32, AbortCode> {
        let age = sub.checked_sub(1).filter(|age| *age < self.count).ok_or(AbortCode::NO_DATA)?;
        self.fields.get(usize::from(age)).copied().ok_or(AbortCode::NO_DATA)
    }

    /// Sub-index 0 is written.
    ///
    /// # Errors
    /// [`AbortCode::INVALID_VALUE`] for anything but 0, which clears.
    pub fn write_count(&mut self, count: u8) -> Result<(), AbortCode> {
        if count != 0 {
            return Err(AbortCode::INVALID_VALUE);
        }
        *self = Self::new();
        Ok(())
    }
}

/// Messages that wait until the device may send: behind the boot-up, or until the bus is back.
#[derive(Debug, Default)]
pub struct WaitingEmcys {
    messages: Deque<Emcy, WAITING>,
}

impl WaitingEmcys {
    /// Appends a message; `false` when there is no room.
    #[must_use]
    pub fn push(&mut self, message: Emcy) -> bool {
        self.messages.push_back(message).is_ok()
    }

    /// The message that has waited longest.
    pub fn pop(&mut self) -> Option<Emcy> {
        self.messages.pop_front()
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.messages.clear();
    }
}

/// Listens for the EMCY of one other node, object 0x1028:1.
#[derive(Debug)]
pub struct EmcyConsumer {
    cob_id: CobId,
}

impl EmcyConsumer {
    /// The default of object 0x1028:1: off.
    pub const DEFAULT: u32 = CobId::OFF;

    /// A consumer that is off.
    #[must_use]
    pub const fn new() -> Self {
        Self { cob_id: CobId::new(Self::DEFAULT) }
    }

    /// The COB-ID as written.
    #[must_use]
    pub const fn cob_id(&self) -> CobId {
        self.cob_id
    }

    /// Object 0x1028:1 is written: in force at once. When it is off, the identifier is not looked at.
    ///
    /// # Errors
    /// [`AbortCode::INVALID_VALUE`] for a 29-bit or a reserved identifier.
    pub fn write(&mut self, raw: u32) -> Result<(), AbortCode> {
        let cob_id = CobId::new(raw);
        if !cob_id.is_off() && cob_id != self.cob_id && !cob_id.is_usable_standard() {
            return Err(AbortCode::INVALID_VALUE);
        }
        self.cob_id = cob_id;
        Ok(())
    }

    /// Takes a stored COB-ID, unchecked.
    pub const fn load(&mut self, raw: u32) {
        self.cob_id = CobId::new(raw);
    }

    /// The [key](crate::frame::key) of the EMCY that it listens for; `None` while it is off.
    #[must_use]
    pub fn key(&self) -> Option<u32> {
        (!self.cob_id.is_off()).then(|| self.cob_id.key())
    }
}

impl Default for EmcyConsumer {
    fn default() -> Self {
        Self::new()
    }
}
