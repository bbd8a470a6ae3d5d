//! Who listens at one bit rate, and to what: a frame costs those whose filters let it through.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use protocol_core::controller::{BitRate, Filters};
use protocol_core::frame::Frame;

use super::PortId;

/// The ports that take part at one bit rate.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) rate: BitRate,
    /// Its members, in the order of their numbers.
    pub(super) members: Vec<PortId>,
    /// How many of them acknowledge: all but silent ones.
    pub(super) audible: usize,
    /// How many of those are error-active: their error flags destroy a frame.
    pub(super) active: usize,
    /// The members whose receive error counter is above 0: what is received changes no other.
    pub(super) counting: Vec<PortId>,
    /// The members that hear everything.
    open: Vec<PortId>,
    /// What the others hear, by the bits that their filters look at.
    masks: Vec<Mask>,
}

/// The filters that look at the same bits of an identifier.
#[derive(Debug)]
struct Mask {
    bits: u32,
    /// Who wants to find what there.
    wanted: HashMap<u32, Vec<PortId>, BuildHasherDefault<Multiply>>,
}

/// A hasher for identifiers: a multiplication.
#[derive(Default)]
struct Multiply(u64);

impl Hasher for Multiply {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u32((*byte).into()));
    }

    #[inline]
    fn write_u32(&mut self, number: u32) {
        // 2 to the power of 64 by the golden ratio: neighbours go far from each other.
        self.0 = (self.0 ^ u64::from(number)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 ^= self.0 >> 32;
    }
}

/// What a port is to hear.
#[derive(Clone, Copy, Debug)]
pub(super) enum Hears<'a> {
    /// Nothing is kept of what it hears.
    Nothing,
    /// Every frame.
    Everything,
    /// The data frames that one of the filters lets through.
    Filtered(&'a Filters),
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
            masks: Vec::new(),
        }
    }

    /// Adds the members that are to hear a frame, in the order of their numbers, its sender perhaps among them.
    pub(super) fn hearers(&self, frame: &Frame, into: &mut Vec<PortId>) {
        into.extend_from_slice(&self.open);
        if !frame.is_remote() {
            for Mask { bits, wanted } in &self.masks {
                if let Some(ports) = wanted.get(&(frame.key() & bits)) {
                    into.extend_from_slice(ports);
                }
            }
        }
        if into.len() > 1 {
            into.sort_unstable();
            into.dedup();
        }
    }

    /// Lists what a port is to hear.
    pub(super) fn list(&mut self, id: PortId, hears: Hears<'_>) {
        match hears {
            Hears::Nothing => {}
            Hears::Everything => self.open.push(id),
            Hears::Filtered(filters) => {
                for filter in filters {
                    self.mask(filter.mask).wanted.entry(filter.key & filter.mask).or_default().push(id);
                }
            }
        }
    }

    /// Takes from the lists what a port was to hear.
    pub(super) fn unlist(&mut self, id: PortId, hears: Hears<'_>) {
        match hears {
            Hears::Nothing => {}
            Hears::Everything => self.open.retain(|other| *other != id),
            Hears::Filtered(filters) => {
                for filter in filters {
                    let key = filter.key & filter.mask;
                    let wanted = &mut self.mask(filter.mask).wanted;
                    if let Some(ports) = wanted.get_mut(&key) {
                        ports.retain(|other| *other != id);
                        if ports.is_empty() {
                            wanted.remove(&key);
                        }
                    }
                }
            }
        }
    }

    fn mask(&mut self, bits: u32) -> &mut Mask {
        let place = self.masks.iter().position(|mask| mask.bits == bits).unwrap_or_else(|| {
            self.masks.push(Mask { bits, wanted: HashMap::default() });
            self.masks.len() - 1
        });
        &mut self.masks[place]
    }
}

#[cfg(test)]
mod tests {
    use protocol_core::controller::Filter;

    use super::*;

    /// A master may give a valve one identifier after the other, for years.
    #[test]
    fn what_nobody_wants_any_more_takes_no_room() {
        let mut group = Group::new(BitRate::Kbit250);
        for key in 1..=100 {
            let mut filters = Filters::new();
            let _ = filters.push(Filter::exactly(key));
            group.list(PortId(0), Hears::Filtered(&filters));
            group.unlist(PortId(0), Hears::Filtered(&filters));
        }
        assert!(group.masks.iter().all(|mask| mask.wanted.is_empty()));
    }
}
