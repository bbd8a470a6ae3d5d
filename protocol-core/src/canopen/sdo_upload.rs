//! The segments of an SDO upload (CiA 301 7.2.4.3.6).

use heapless::Vec;

use super::dictionary::TEXT_MAX;
use crate::wire::sdo::{AbortCode, Multiplexer, Segment};

/// A segmented upload in progress. It copies the value, so that all segments are consistent.
#[derive(Clone, Debug)]
pub(super) struct Upload {
    object: Multiplexer,
    data: Vec<u8, TEXT_MAX>,
    sent: usize,
    toggle: bool,
}

impl Upload {
    pub(super) fn new(object: Multiplexer, value: &[u8]) -> Result<Self, AbortCode> {
        let data = Vec::from_slice(value).map_err(|_| AbortCode::OUT_OF_MEMORY)?;
        Ok(Self { object, data, sent: 0, toggle: false })
    }

    pub(super) const fn object(&self) -> Multiplexer {
        self.object
    }

    /// Returns the next segment for a request with this toggle bit.
    pub(super) fn segment(&mut self, toggle: bool) -> Result<Segment, AbortCode> {
        if toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        let rest = self.data.get(self.sent..).unwrap_or(&[]);
        let mut data = [0; Segment::MAX];
        let count = data.iter_mut().zip(rest).map(|(to, from)| *to = *from).count();
        let last = rest.len() <= Segment::MAX;
        self.sent = self.sent.saturating_add(count);
        self.toggle = !toggle;
        Ok(Segment { toggle, last, len: u8::try_from(count).unwrap_or(0), data })
    }
}
