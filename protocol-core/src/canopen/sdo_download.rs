//! The segments of an SDO download (CiA 301 7.2.4.3.4).

use heapless::Vec;

use super::dictionary::{DataType, TEXT_MAX};
use crate::wire::sdo::{AbortCode, Multiplexer, Segment};

/// A segmented download in progress. Nothing is written before the last segment.
#[derive(Debug)]
pub(super) struct Download {
    object: Multiplexer,
    data_type: DataType,
    announced: Option<u32>,
    data: Vec<u8, TEXT_MAX>,
    toggle: bool,
}

impl Download {
    /// Begins; a size that was announced must fit the object.
    pub(super) fn new(object: Multiplexer, data_type: DataType, announced: Option<u32>) -> Result<Self, AbortCode> {
        if let Some(size) = announced {
            data_type.check_length(usize::try_from(size).unwrap_or(usize::MAX))?;
        }
        Ok(Self { object, data_type, announced, data: Vec::new(), toggle: false })
    }

    /// The object that is written.
    pub(super) const fn object(&self) -> Multiplexer {
        self.object
    }

    /// Takes a segment; the whole value after the last one.
    pub(super) fn segment(&mut self, segment: &Segment) -> Result<Option<&[u8]>, AbortCode> {
        if segment.toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        self.toggle = !self.toggle;
        self.data.extend_from_slice(segment.bytes()).map_err(|_| AbortCode::TOO_LONG)?;
        if self.data.len() > usize::from(self.data_type.size()) {
            return Err(AbortCode::TOO_LONG);
        }
        if !segment.last {
            return Ok(None);
        }
        if self.announced.is_some_and(|size| usize::try_from(size) != Ok(self.data.len())) {
            return Err(AbortCode::LENGTH);
        }
        self.data_type.check_length(self.data.len())?;
        Ok(Some(&self.data))
    }
}
