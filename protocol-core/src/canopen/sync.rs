//! The SYNC consumer (CiA 301 7.2.5, object 0x1005).

use crate::wire::cob_id::CobId;
use crate::wire::sdo::AbortCode;

/// The SYNC consumer, which holds the COB-ID of SYNC.
#[derive(Clone, Debug)]
pub(crate) struct SyncConsumer {
    cob_id: CobId,
}

impl SyncConsumer {
    /// The default of object 0x1005.
    pub(crate) const DEFAULT: u32 = 0x80;

    /// Creates a consumer with the default identifier.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { cob_id: CobId::new(Self::DEFAULT) }
    }

    /// Returns object 0x1005 as written.
    #[must_use]
    pub(crate) const fn cob_id(&self) -> CobId {
        self.cob_id
    }

    /// Writes object 0x1005. The value takes effect at once.
    ///
    /// # Errors
    /// Returns [`AbortCode::INVALID_VALUE`] for bit 30 (a SYNC producer), for a restricted identifier, and for a 29-bit
    /// identifier without `extended_ids`.
    pub(crate) fn write(&mut self, raw: u32, extended_ids: bool) -> Result<(), AbortCode> {
        let cob_id = CobId::new(raw);
        if cob_id != self.cob_id && (cob_id.has_bit_30() || !cob_id.is_usable(extended_ids)) {
            return Err(AbortCode::INVALID_VALUE);
        }
        self.cob_id = cob_id;
        Ok(())
    }

    /// Loads a stored or default COB-ID.
    pub(crate) const fn load(&mut self, raw: u32) {
        self.cob_id = CobId::new(raw);
    }

    /// Returns the [key](crate::frame::key) of SYNC frames.
    #[must_use]
    pub(crate) const fn key(&self) -> u32 {
        self.cob_id.key()
    }
}
