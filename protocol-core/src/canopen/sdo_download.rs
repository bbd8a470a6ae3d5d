//! The segments of an SDO download (CiA 301 7.2.4.3.4).

use heapless::Vec;

use super::dictionary::{Place, TEXT_MAX};
use crate::wire::sdo::{AbortCode, Segment};

/// A segmented download in progress. It collects the segments. The object is written after the last segment.
#[derive(Clone, Debug)]
pub(super) struct Download {
    place: Place,
    announced: Option<u32>,
    data: Vec<u8, TEXT_MAX>,
    toggle: bool,
}

impl Download {
    /// Begins a download. Returns an abort code for an announced size that does not fit the object.
    pub(super) fn new(place: Place, announced: Option<u32>) -> Result<Self, AbortCode> {
        if let Some(size) = announced {
            place.entry.check_length(usize::try_from(size).unwrap_or(usize::MAX))?;
        }
        Ok(Self { place, announced, data: Vec::new(), toggle: false })
    }

    pub(super) const fn place(&self) -> Place {
        self.place
    }

    pub(super) fn data(&self) -> &[u8] {
        &self.data
    }

    /// Appends a segment. Returns whether it is the last segment.
    pub(super) fn segment(&mut self, segment: &Segment) -> Result<bool, AbortCode> {
        if segment.toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        self.toggle = !self.toggle;
        self.data.extend_from_slice(segment.bytes()).map_err(|_| AbortCode::TOO_LONG)?;
        let entry = self.place.entry;
        if self.data.len() > usize::from(entry.size()) {
            return Err(AbortCode::TOO_LONG);
        }
        if !segment.last {
            return Ok(false);
        }
        if self.announced.is_some_and(|size| usize::try_from(size) != Ok(self.data.len())) {
            return Err(AbortCode::LENGTH);
        }
        entry.check_length(self.data.len())?;
        Ok(true)
    }
}
