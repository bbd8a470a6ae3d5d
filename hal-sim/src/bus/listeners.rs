//! The listeners at one bit rate, indexed by filter, so that only the ports whose filters accept a frame are visited.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use protocol_core::controller::{BitRate, Filter};
use protocol_core::frame::Frame;

use super::PortId;

/// The ports of one bit rate that have completed bus integration.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) rate: BitRate,
    /// The members, sorted by port number.
    pub(super) members: Vec<PortId>,
    /// The number of members that acknowledge: all except members in listen-only mode.
    pub(super) audible: usize,
    /// The number of error-active members that are not in listen-only mode. Their error flags destroy a frame.
    pub(super) active: usize,
    /// The members with a receive error counter above 0: a successful reception lowers only their counters.
    pub(super) counting: Vec<PortId>,
    /// The members that receive every frame, because they have no filters.
    open: Vec<PortId>,
    /// The listeners of each standard identifier, for filters that accept exactly one identifier: the usual case in
    /// CANopen.
    standard: Vec<Vec<PortId>>,
    /// The listeners of all other filters, grouped by the identifier bits that the filters compare.
    masks: Vec<Mask>,
}

/// The number of standard identifiers.
const STANDARD: usize = 1 << 11;

/// The listeners of filters that compare the same identifier bits.
#[derive(Clone, Debug)]
struct Mask {
    bits: u32,
    /// The listeners by the value of the compared bits; each list is sorted by port number.
    wanted: HashMap<u32, Vec<PortId>, BuildHasherDefault<Multiply>>,
}

/// A multiplicative hasher for identifiers.
#[derive(Default)]
struct Multiply(u64);

impl Hasher for Multiply {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u32((*byte).into()));
    }

    fn write_u32(&mut self, number: u32) {
        // 2^64 divided by the golden ratio: spreads adjacent values.
        self.0 = (self.0 ^ u64::from(number)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 ^= self.0 >> 32;
    }
}

impl Group {
    pub(super) const fn new(rate: BitRate) -> Self {
        Self {
            rate,
            members: Vec::new(),
            audible: 0,
            active: 0,
            counting: Vec::new(),
            open: Vec::new(),
            standard: Vec::new(),
            masks: Vec::new(),
        }
    }

    /// Calls `tell` with lists of the members that receive a frame. The sender may be among them, and a member with
    /// several matching filters can be in several lists.
    pub(super) fn hearers(&self, frame: &Frame, mut tell: impl FnMut(&[PortId])) {
        if !self.open.is_empty() {
            tell(&self.open);
        }
        // Filters accept data frames only.
        if frame.is_remote() {
            return;
        }
        if let Some(ports) = self.standard.get(frame.key() as usize).filter(|ports| !ports.is_empty()) {
            tell(ports);
        }
        for mask in &self.masks {
            if let Some(ports) = mask.wanted.get(&(frame.key() & mask.bits)) {
                tell(ports);
            }
        }
    }

    /// Adds a port to the listener lists of its filters; with `None`, the port receives every frame.
    pub(super) fn list(&mut self, id: PortId, filters: Option<&[Filter]>) {
        let Some(filters) = filters else { return self.open.push(id) };
        for filter in filters {
            let ports = self.wanted(*filter);
            if let Err(place) = ports.binary_search(&id) {
                ports.insert(place, id);
            }
        }
    }

    /// Removes a port from the listener lists of its filters.
    pub(super) fn unlist(&mut self, id: PortId, filters: Option<&[Filter]>) {
        let Some(filters) = filters else { return self.open.retain(|other| *other != id) };
        for filter in filters {
            let ports = self.wanted(*filter);
            ports.retain(|other| *other != id);
            if ports.is_empty() {
                self.forget(*filter);
            }
        }
    }

    /// Returns the listener list of a filter, and creates the list if necessary.
    fn wanted(&mut self, filter: Filter) -> &mut Vec<PortId> {
        if let Some(id) = standard(filter) {
            self.standard.resize(STANDARD, Vec::new());
            return &mut self.standard[id];
        }
        let place = self.masks.iter().position(|mask| mask.bits == filter.mask).unwrap_or_else(|| {
            self.masks.push(Mask { bits: filter.mask, wanted: HashMap::default() });
            self.masks.len() - 1
        });
        self.masks[place].wanted.entry(filter.key & filter.mask).or_default()
    }

    fn forget(&mut self, filter: Filter) {
        if let Some(mask) = self.masks.iter_mut().find(|mask| mask.bits == filter.mask) {
            mask.wanted.remove(&(filter.key & filter.mask));
        }
    }
}

/// Returns the identifier of a filter that accepts exactly one standard identifier.
fn standard(filter: Filter) -> Option<usize> {
    let id = filter.key as usize;
    (filter.mask == u32::MAX && id < STANDARD).then_some(id)
}

#[cfg(test)]
mod tests {
    use protocol_core::controller::Filters;
    use protocol_core::frame::{extended, key};

    use super::*;

    /// A master may assign many identifiers to a valve one after another; the lists must not grow without limit.
    #[test]
    fn what_nobody_wants_any_more_takes_no_room() {
        let mut group = Group::new(BitRate::Kbit250);
        for number in 1..=100 {
            let mut filters = Filters::new();
            let _ = filters.push(Filter::exactly(key(extended(number).into())));
            group.list(PortId(0), Some(&filters));
            group.unlist(PortId(0), Some(&filters));
        }
        assert!(group.masks.iter().all(|mask| mask.wanted.is_empty()));
    }
}
