//! Who listens at one bit rate, and to what: a frame costs those whose filters let it through.

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
    /// What they want to find there, and who; in order.
    wanted: Vec<(u32, PortId)>,
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
                let key = frame.key() & bits;
                let first = wanted.partition_point(|(other, _)| *other < key);
                into.extend(wanted[first..].iter().take_while(|(other, _)| *other == key).map(|(_, id)| *id));
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
                    let mask = self.mask(filter.mask);
                    let entry = (filter.key & filter.mask, id);
                    let place = mask.wanted.partition_point(|other| *other < entry);
                    mask.wanted.insert(place, entry);
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
                    let wanted = &mut self.mask(filter.mask).wanted;
                    if let Ok(place) = wanted.binary_search(&(filter.key & filter.mask, id)) {
                        wanted.remove(place);
                    }
                }
            }
        }
    }

    fn mask(&mut self, bits: u32) -> &mut Mask {
        let place = self.masks.iter().position(|mask| mask.bits == bits).unwrap_or_else(|| {
            self.masks.push(Mask { bits, wanted: Vec::new() });
            self.masks.len() - 1
        });
        &mut self.masks[place]
    }
}
