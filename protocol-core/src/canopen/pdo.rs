//! The PDO: communication and mapping parameters, and the packing of objects into frames (CiA 301 7.2.2, 7.5.2.35–38).
//!
//! The mapping is checked and resolved when the PDO is switched on, not for every frame.

use core::ops::RangeInclusive;

use heapless::Vec;

use super::dictionary::{Entries, Mappable, Place};
use super::transmission::Transmission;
pub(crate) use super::transmission::{AtSync, EVENT_DRIVEN, MANUFACTURER, ON_CHANGE};
use crate::frame::{Frame, Id, MAX_LEN};
use crate::time::Instant;
use crate::wire::cob_id::CobId;
use crate::wire::pdo_mapping::MappingEntry;
use crate::wire::sdo::{AbortCode, Multiplexer};

/// The maximum number of objects in a PDO of these devices (SPEC 4.1).
pub(crate) const ENTRIES: usize = 8;

/// The maximum number of bits in a PDO.
const MAX_BITS: u8 = 64;

/// A product's rules for the PDOs of one direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// The direction of the PDOs. Mapped objects must be mappable in this direction.
    pub(crate) direction: Mappable,
    /// The permitted transmission types.
    pub(crate) transmission_types: &'static [RangeInclusive<u8>],
    /// Whether 29-bit identifiers are permitted.
    pub(crate) extended_ids: bool,
    /// Whether a PDO without mapped objects can be switched on.
    pub(crate) may_be_empty: bool,
    /// Whether dummies can be mapped.
    pub(crate) dummies: bool,
    /// Whether mapping entries can be written while sub-index 0 is not 0.
    pub(crate) entries_while_counted: bool,
    /// Whether the PDO has an inhibit time and an event timer.
    pub(crate) timers: bool,
    /// True if a TPDO carries the values at its due time, false if it carries the values at its transmission.
    pub(crate) sampled_when_due: bool,
}

impl Rules {
    /// The rules of a product without this PDO.
    pub(crate) const NONE: Self = Self {
        direction: Mappable::No,
        transmission_types: &[],
        extended_ids: false,
        may_be_empty: false,
        dummies: false,
        entries_while_counted: false,
        timers: false,
        sampled_when_due: false,
    };
}

/// A PDO.
#[derive(Clone, Debug)]
pub(crate) struct Pdo {
    cob_id: CobId,
    transmission: Transmission,
    count: u8,
    entries: [MappingEntry; ENTRIES],
    /// The frame with zeros as data. Its length is 0 while the PDO is off or maps nothing.
    blank: Frame,
    /// The mapped objects of a PDO that is on.
    slots: Vec<Slot, ENTRIES>,
    /// The last sent data; `None` if no frame was sent or the last frame may be lost.
    last: Option<Sample>,
}

/// The data of a PDO: the values of the mapped objects at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sample(u64);

impl Sample {
    /// The data of a PDO without objects.
    pub(crate) const NOTHING: Self = Self(0);
}

/// A mapped object in the frame. Dummies have no slot.
#[derive(Clone, Copy, Debug)]
struct Slot {
    /// The position of the object in the dictionary.
    position: u8,
    /// The position of the object's lowest bit in the frame, below 64.
    shift: u8,
    mask: u32,
}

impl Pdo {
    /// Creates a PDO that is off and maps nothing, for loading.
    #[must_use]
    // Inlining builds the device in its final place, which saves the smallest image 1.2 KiB of stack.
    #[inline(always)]
    pub(crate) const fn new() -> Self {
        Self {
            cob_id: CobId::new(CobId::OFF),
            transmission: Transmission::new(),
            count: 0,
            entries: [MappingEntry::UNUSED; ENTRIES],
            blank: Frame::EMPTY,
            slots: Vec::new(),
            last: None,
        }
    }

    /// Returns the COB-ID as written, sub-index 1 of the communication parameter.
    #[must_use]
    pub(crate) const fn cob_id(&self) -> CobId {
        self.cob_id
    }

    /// Returns the transmission parameters, sub-indices 2, 3 and 5 of the communication parameter.
    #[must_use]
    pub(crate) const fn transmission(&self) -> &Transmission {
        &self.transmission
    }

    /// Returns the number of mapped objects, sub-index 0 of the mapping parameter.
    #[must_use]
    pub(crate) const fn count(&self) -> u8 {
        self.count
    }

    /// Returns a mapping entry, sub-index 1–8.
    ///
    /// # Errors
    /// Returns [`AbortCode::NO_SUB`] for any other sub-index.
    pub(crate) fn entry(&self, sub: u8) -> Result<u32, AbortCode> {
        let position = usize::from(sub).checked_sub(1);
        let entry = position.and_then(|position| self.entries.get(position));
        entry.map(|entry| entry.emit()).ok_or(AbortCode::NO_SUB)
    }

    /// Writes the COB-ID. Bit 31 switches the PDO off. The other bits are then not checked, and read back as written
    /// (A). While the PDO is on, only bits 30 and 31 can change. A change of bit 30 alone does not restart the PDO.
    ///
    /// # Errors
    /// - [`AbortCode::INVALID_VALUE`] for an identifier that may not be used, and for switching on without mapped
    ///   objects.
    /// - [`AbortCode::DEVICE_STATE`] for another identifier while the PDO is on.
    /// - [`AbortCode::PDO_TOO_LONG`] for switching on with more than 64 bits.
    /// - [`AbortCode::NOT_MAPPABLE`] for switching on with a loaded mapping that is invalid.
    pub(crate) fn write_cob_id(
        &mut self,
        raw: u32,
        rules: &Rules,
        objects: Entries,
        now: Instant,
    ) -> Result<(), AbortCode> {
        let cob_id = CobId::new(raw);
        let stays_on = self.is_on() && !cob_id.is_off();
        if cob_id == self.cob_id || stays_on && cob_id.key() == self.cob_id.key() {
            self.cob_id = cob_id;
            return Ok(());
        }
        if cob_id.is_off() {
            self.blank = Frame::EMPTY;
        } else if !cob_id.is_usable(rules.extended_ids) {
            return Err(AbortCode::INVALID_VALUE);
        } else if stays_on {
            return Err(AbortCode::DEVICE_STATE);
        } else {
            self.switch_on(cob_id.id(), rules, objects)?;
        }
        self.cob_id = cob_id;
        self.restart(now);
        Ok(())
    }

    /// Writes the transmission type, and restarts the SYNC count and the event timer. The value takes effect at once.
    ///
    /// # Errors
    /// Returns [`AbortCode::INVALID_VALUE`] for a type that the product does not permit.
    pub(crate) fn write_transmission_type(&mut self, value: u8, rules: &Rules, now: Instant) -> Result<(), AbortCode> {
        if !rules.transmission_types.iter().any(|types| types.contains(&value)) {
            return Err(AbortCode::INVALID_VALUE);
        }
        self.transmission.set_kind(value);
        self.restart(now);
        Ok(())
    }

    /// Writes the inhibit time. The same value does not affect a running inhibit time.
    ///
    /// # Errors
    /// Returns [`AbortCode::DEVICE_STATE`] for another value while the PDO is on.
    pub(crate) fn write_inhibit(&mut self, value: u16) -> Result<(), AbortCode> {
        if value == self.transmission.inhibit() {
            return Ok(());
        }
        if self.is_on() {
            return Err(AbortCode::DEVICE_STATE);
        }
        self.transmission.set_inhibit(value);
        Ok(())
    }

    /// Writes the event timer. The value takes effect at once. The first period begins at `now`.
    pub(crate) fn write_event_timer(&mut self, value: u16, now: Instant) {
        self.transmission.set_event_timer(value);
        self.transmission.restart_timer(now, self.sends());
    }

    /// Writes the number of mapped objects.
    ///
    /// # Errors
    /// - [`AbortCode::PDO_TOO_LONG`] above 8 entries or 64 bits.
    /// - [`AbortCode::DEVICE_STATE`] while the PDO is on.
    /// - [`AbortCode::NOT_MAPPABLE`] if a counted entry cannot be mapped.
    pub(crate) fn write_count(&mut self, count: u8, rules: &Rules, objects: Entries) -> Result<(), AbortCode> {
        if count == self.count {
            return Ok(());
        }
        let entries = self.entries.get(..usize::from(count)).ok_or(AbortCode::PDO_TOO_LONG)?;
        if self.is_on() {
            return Err(AbortCode::DEVICE_STATE);
        }
        bits(entries)?;
        entries.iter().try_for_each(|entry| mapped(*entry, rules, objects).map(drop))?;
        self.count = count;
        Ok(())
    }

    /// Writes a mapping entry, sub-index 1–8. While the PDO is off, an entry beyond the count can become
    /// [unused](MappingEntry::UNUSED).
    ///
    /// # Errors
    /// - [`AbortCode::NOT_MAPPABLE`] for an object that does not exist or has another direction or length, and for an
    ///   unused entry within the count.
    /// - [`AbortCode::DEVICE_STATE`] while the PDO is on, and for some products while the count is not 0.
    /// - [`AbortCode::NO_SUB`] for any other sub-index.
    pub(crate) fn write_entry(&mut self, sub: u8, raw: u32, rules: &Rules, objects: Entries) -> Result<(), AbortCode> {
        if self.entry(sub)? == raw {
            return Ok(());
        }
        let entry = MappingEntry::parse(raw);
        let becomes_unused = entry == MappingEntry::UNUSED && sub > self.count;
        if !becomes_unused {
            mapped(entry, rules, objects)?;
        }
        if self.is_on() || self.count != 0 && !becomes_unused && !rules.entries_while_counted {
            return Err(AbortCode::DEVICE_STATE);
        }
        self.put_entry(sub, entry);
        Ok(())
    }

    /// Loads a stored COB-ID, which takes effect at [`start`](Self::start).
    pub(crate) const fn load_cob_id(&mut self, raw: u32) {
        self.cob_id = CobId::new(raw);
    }

    pub(crate) const fn load_transmission_type(&mut self, value: u8) {
        self.transmission.set_kind(value);
    }

    pub(crate) const fn load_inhibit(&mut self, value: u16) {
        self.transmission.set_inhibit(value);
    }

    pub(crate) const fn load_event_timer(&mut self, value: u16) {
        self.transmission.set_event_timer(value);
    }

    pub(crate) const fn load_count(&mut self, count: u8) {
        self.count = count;
    }

    pub(crate) fn load_entry(&mut self, sub: u8, raw: u32) {
        self.put_entry(sub, MappingEntry::parse(raw));
    }

    /// Switches the PDO on or off, as its loaded COB-ID says. A PDO with invalid parameters stays off.
    pub(crate) fn start(&mut self, rules: &Rules, objects: Entries) {
        self.blank = Frame::EMPTY;
        if self.cob_id.is_off() || self.switch_on(self.cob_id.id(), rules, objects).is_err() {
            self.cob_id = CobId::new(self.cob_id.raw() | CobId::OFF);
        }
    }

    /// Returns the [key](crate::frame::key) of the PDO's frames; `None` while the PDO is off.
    #[must_use]
    pub(crate) fn key(&self) -> Option<u32> {
        self.is_on().then(|| self.blank.key())
    }

    /// Returns the mapped objects in the order of the frame, dummies included. A PDO that is off maps nothing.
    #[must_use]
    pub(crate) fn mapping(&self) -> &[MappingEntry] {
        let count = if self.is_on() { usize::from(self.count) } else { 0 };
        self.entries.get(..count).unwrap_or_default()
    }

    /// Unpacks a received frame into the dictionary position and the value of each object, without dummies. Returns
    /// `None` if the PDO is off, or if the frame is shorter than the mapping.
    pub(crate) fn unpack(&self, frame: &Frame) -> Option<impl Iterator<Item = (u8, u32)>> {
        if !self.is_on() || frame.len() < self.blank.len() {
            return None;
        }
        let bits = u64::from_le_bytes(*frame.bytes());
        Some(self.slots.iter().map(move |slot| {
            let value = bits.wrapping_shr(u32::from(slot.shift)) as u32 & slot.mask;
            (slot.position, value)
        }))
    }

    /// Packs the mapped objects. `read` returns the value of the object at a dictionary position.
    #[inline]
    pub(crate) fn sample(&self, mut read: impl FnMut(u8) -> u32) -> Sample {
        Sample(self.slots.iter().fold(0, |bits, slot| {
            bits | u64::from(read(slot.position) & slot.mask).wrapping_shl(u32::from(slot.shift))
        }))
    }

    /// Returns the frame with this sample. The PDO must be on.
    #[inline]
    pub(crate) fn frame(&self, sample: Sample) -> Frame {
        self.blank.carrying(sample.0.to_le_bytes())
    }

    /// Counts a SYNC. Returns its effect on the TPDO.
    #[inline]
    pub(crate) const fn sync(&mut self) -> AtSync {
        if self.sends() { self.transmission.sync() } else { AtSync::Nothing }
    }

    /// Returns whether a sample differs from the last sent sample.
    #[inline]
    pub(crate) fn has_changed(&self, sample: Sample) -> bool {
        self.last != Some(sample)
    }

    #[inline]
    pub(crate) const fn sent(&mut self, sample: Sample) {
        self.last = Some(sample);
    }

    /// Records that a frame in the controller may be lost, so that its sample no longer counts as sent.
    pub(crate) const fn lost(&mut self) {
        self.last = None;
    }

    /// Restarts the SYNC count and the event timer. The next sample counts as changed.
    pub(crate) fn restart(&mut self, now: Instant) {
        self.last = None;
        self.transmission.restart(now, self.sends());
    }

    /// Returns the due time of a transmission, if the event timer has ended and no inhibit time runs.
    #[inline]
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Instant> {
        self.transmission.poll(now)
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) fn deadline(&self) -> Instant {
        self.transmission.deadline()
    }

    /// Returns whether the PDO is sent and its transmission type is event-driven.
    #[must_use]
    pub(crate) const fn is_event_driven(&self) -> bool {
        self.sends() && self.transmission.kind() == EVENT_DRIVEN
    }

    /// Returns whether the PDO is sent: it must be on and map at least one object.
    const fn sends(&self) -> bool {
        !self.blank.is_empty()
    }

    const fn is_on(&self) -> bool {
        !self.cob_id.is_off()
    }

    fn put_entry(&mut self, sub: u8, entry: MappingEntry) {
        let position = usize::from(sub).checked_sub(1);
        if let Some(slot) = position.and_then(|position| self.entries.get_mut(position)) {
            *slot = entry;
        }
    }

    /// Checks and resolves the mapping, for frames with the identifier `id`. An error changes nothing.
    fn switch_on(&mut self, id: Id, rules: &Rules, objects: Entries) -> Result<(), AbortCode> {
        let entries = self.entries.get(..usize::from(self.count)).ok_or(AbortCode::PDO_TOO_LONG)?;
        if entries.is_empty() && !rules.may_be_empty {
            return Err(AbortCode::INVALID_VALUE);
        }
        let len = bits(entries)?.div_ceil(8);
        let mut slots = Vec::new();
        let mut shift: u8 = 0;
        for entry in entries {
            if let Some(position) = mapped(*entry, rules, objects)? {
                let mask = u32::MAX.unbounded_shr(32_u32.saturating_sub(u32::from(entry.bits)));
                slots.push(Slot { position, shift, mask }).map_err(|_| AbortCode::PDO_TOO_LONG)?;
            }
            shift = shift.saturating_add(entry.bits);
        }
        self.slots = slots;
        self.blank = Frame::with_len(id, [0; MAX_LEN], len);
        Ok(())
    }
}

/// Returns the dictionary position of a mapped object; `None` for a dummy.
fn mapped(entry: MappingEntry, rules: &Rules, objects: Entries) -> Result<Option<u8>, AbortCode> {
    if rules.dummies && entry.is_valid_dummy() {
        return Ok(None);
    }
    match objects.find(Multiplexer::new(entry.index, entry.sub)) {
        Ok(Place { entry: object, position })
            if object.mappable() == rules.direction && object.size().saturating_mul(8) == entry.bits =>
        {
            Ok(Some(position))
        }
        _ => Err(AbortCode::NOT_MAPPABLE),
    }
}

/// Returns the number of bits of the entries. More than 64 bits are an error.
fn bits(entries: &[MappingEntry]) -> Result<u8, AbortCode> {
    let sum = entries.iter().fold(0_u8, |sum, entry| sum.saturating_add(entry.bits));
    if sum <= MAX_BITS { Ok(sum) } else { Err(AbortCode::PDO_TOO_LONG) }
}
