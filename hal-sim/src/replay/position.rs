//! How much a position in a frame may differ: by where the stand-in comes within the tolerance.
//!
//! A frame of a stand-in is known bit by bit: its mapping, or its message, tells which fields carry the position. A
//! logged frame is like it when every other bit is the same, and one position on the way of the stand-in fills all these
//! fields as they were logged. A device that rests is at one position: then frames are alike when they are equal.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use protocol_core::actuator::{Position, Scale};
use protocol_core::device::Protocol;
use protocol_core::encoder::{POSITION_MAX, STEPS};
use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, after};
use protocol_core::wire::cob_id::Function;
use protocol_core::wire::j1939_id::{J1939Id, Pgn};
use protocol_core::wire::pdo_mapping::MappingEntry;

use super::lane::{Item, PATIENCE};
use crate::kind::Kind;
use crate::world::{NodeId, World};

/// The longest time between two notes of a position that changes.
pub(super) const GRID: Duration = Duration::from_millis(1);

/// What 0x6301 tells of a spool that floats (SPEC 2).
const FLOAT: i32 = 32_767;

/// What an AVEF tells of no flow (SPEC 5).
const NO_FLOW: i32 = 125;

/// The fields of a frame that carry the position of its sender.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fields([Option<Field>; 8]);

/// A number in the data of a frame, least significant bit first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Field {
    /// The place of its lowest bit.
    shift: u8,
    bits: u8,
    form: Form,
}

/// How a field tells a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// 0x6301
    Spool,
    /// 0x3301
    Per127,
    /// 0x3302
    Inverted,
    /// 0x3304
    Per1000,
    /// 0x6004
    Shaft,
    /// The first byte of an AVEF.
    Extend,
    /// The second byte of an AVEF.
    Retract,
}

impl Form {
    /// Returns how an object tells the position, and in how many bits; `None` for an object that does not.
    const fn of_object(index: u16, sub: u8) -> Option<(Self, u8)> {
        match (index, sub) {
            (0x6301, 1) => Some((Self::Spool, 16)),
            (0x3301, 0) => Some((Self::Per127, 8)),
            (0x3302, 0) => Some((Self::Inverted, 8)),
            (0x3304, 0) => Some((Self::Per1000, 16)),
            (0x6004, 0) => Some((Self::Shaft, 32)),
            _ => None,
        }
    }

    /// Returns every position that a device can be at.
    const fn positions(self) -> RangeInclusive<i32> {
        match self {
            Self::Shaft => 0..=POSITION_MAX as i32,
            _ => -(Position::FULL as i32)..=Position::FULL as i32,
        }
    }

    /// Returns what the field holds at a position: more at a higher one, or less where it [falls](Self::falls).
    fn tell(self, position: i32) -> i32 {
        let on = |scale: Scale| i32::from(scale.of_position(Position::clamped(position)));
        match self {
            Self::Spool | Self::Shaft => position,
            Self::Per127 => on(Scale::Per127),
            Self::Inverted => -on(Scale::Per127),
            Self::Per1000 => on(Scale::Per1000),
            Self::Extend => NO_FLOW + on(Scale::Percent).max(0),
            Self::Retract => NO_FLOW - on(Scale::Percent).min(0),
        }
    }

    const fn falls(self) -> bool {
        matches!(self, Self::Inverted | Self::Retract)
    }

    /// Returns what the field holds while the spool floats; `None` for one that goes on to tell the position.
    fn tell_float(self) -> Option<i32> {
        match self {
            Self::Spool => Some(FLOAT),
            Self::Per127 | Self::Inverted | Self::Per1000 => Some(self.tell(Position::FULL.into())),
            Self::Shaft | Self::Extend | Self::Retract => None,
        }
    }

    /// Returns the positions at which the field holds a value; empty when there is none.
    fn positions_of(self, value: i32) -> RangeInclusive<i32> {
        let value = if self.falls() { -value } else { value };
        let rising = |position: i32| if self.falls() { -self.tell(position) } else { self.tell(position) };
        first(self.positions(), |position| rising(position) >= value)..=first(self.positions(), |position| {
            rising(position) > value
        }) - 1
    }
}

/// Returns the first position of a range from which on `is` holds; the one after the range when it never does.
fn first(positions: RangeInclusive<i32>, is: impl Fn(i32) -> bool) -> i32 {
    let (mut low, mut high) = (*positions.start(), *positions.end() + 1);
    while low < high {
        let middle = low + (high - low) / 2;
        if is(middle) { high = middle } else { low = middle + 1 }
    }
    low
}

impl Field {
    fn mask(self) -> u64 {
        u64::MAX.unbounded_shr(64 - u32::from(self.bits)).unbounded_shl(self.shift.into())
    }

    /// Returns what the field of a frame holds, with the sign of its form.
    fn read(self, frame: &Frame) -> i32 {
        let value = ((bits(frame) & self.mask()) >> self.shift) as u32;
        let above = 32 - u32::from(self.bits);
        match self.form {
            Form::Extend | Form::Retract => value as i32,
            _ => (value << above) as i32 >> above,
        }
    }
}

const fn bits(frame: &Frame) -> u64 {
    u64::from_le_bytes(*frame.bytes())
}

impl Fields {
    /// Returns the fields of a frame that a device of this kind has sent, while its TPDO has this key and mapping.
    fn of(frame: &Frame, kind: Kind, tpdo: Option<(u32, &[MappingEntry])>) -> Self {
        let mut fields = Self::default();
        let mut places = fields.0.iter_mut();
        let mut add = |shift: u8, (form, bits): (Form, u8)| {
            if let Some(place) = places.next() {
                *place = Some(Field { shift, bits, form });
            }
        };
        match (tpdo, frame.id(), kind.protocol()) {
            (Some((key, mapping)), ..) if key == frame.key() => {
                let mut shift: u8 = 0;
                for entry in mapping {
                    Form::of_object(entry.index, entry.sub).into_iter().for_each(|field| add(shift, field));
                    shift = shift.saturating_add(entry.bits);
                }
            }
            (_, Id::Standard(id), Protocol::Canopen) if id.as_raw() & !0x7F == Function::SdoAnswer as u16 => {
                // An answer to the upload of at most four bytes.
                if let &[0x42..=0x43 | 0x47 | 0x4B | 0x4F, low, high, sub, ..] = frame.data() {
                    Form::of_object(u16::from_le_bytes([low, high]), sub).into_iter().for_each(|field| add(32, field));
                }
            }
            (_, Id::Extended(id), Protocol::Isobus) => {
                let id = J1939Id::from_raw(id.as_raw());
                if id.pgn() == Pgn::avef(id.source().get()) {
                    add(0, (Form::Extend, 8));
                    add(8, (Form::Retract, 8));
                }
            }
            _ => {}
        }
        fields
    }

    fn iter(&self) -> impl Iterator<Item = Field> {
        self.0.into_iter().flatten()
    }
}

/// Where a device was at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Note {
    at: Instant,
    position: i32,
    /// The spool floats, and its objects tell so.
    floats: bool,
    /// The device came here from the note before, through all positions between; otherwise at once.
    moved: bool,
}

/// The way of a device.
#[derive(Debug)]
struct Way {
    kind: Kind,
    notes: VecDeque<Note>,
    /// When it was last looked at.
    looked: Instant,
}

impl Way {
    /// Returns the notes from the one in force at an instant up to another instant.
    fn between(&self, from: Instant, until: Instant) -> impl Iterator<Item = &Note> + Clone {
        let begin = self.notes.partition_point(|note| note.at <= from).saturating_sub(1);
        self.notes.iter().skip(begin).take_while(move |note| note.at <= until)
    }

    /// Returns whether the way between two notes leads through one of these positions.
    fn leads_through(&self, from: i32, to: i32, positions: &RangeInclusive<i32>) -> bool {
        let turn = STEPS as i32;
        let passed = |by: i32| from.min(from + by)..=from.max(from + by);
        let overlaps = |passed: &RangeInclusive<i32>, shift: i32| {
            *positions.start() <= passed.end() + shift && passed.start() + shift <= *positions.end()
        };
        match self.kind {
            Kind::Pve(_) => overlaps(&passed(to - from), 0),
            // The shorter way round.
            Kind::Hat(_) => {
                let passed = passed((to - from + turn / 2).rem_euclid(turn) - turn / 2);
                [-turn, 0, turn].into_iter().any(|shift| overlaps(&passed, shift))
            }
        }
    }

    /// Returns whether the device comes to one of these positions between two instants.
    fn comes_to(&self, positions: &RangeInclusive<i32>, from: Instant, until: Instant) -> bool {
        let notes = self.between(from, until);
        let is_at = |note: &Note| !note.floats && positions.contains(&note.position);
        let passes = |(one, other): (&Note, &Note)| {
            other.moved && !(one.floats && other.floats) && self.leads_through(one.position, other.position, positions)
        };
        notes.clone().any(is_at) || notes.clone().zip(notes.skip(1)).any(passes)
    }
}

/// The ways of all stand-ins, and how much they let frames differ.
#[derive(Debug)]
pub(super) struct PositionTolerance {
    ways: Vec<Way>,
    tolerance: Duration,
}

impl PositionTolerance {
    pub(super) fn new(kinds: impl Iterator<Item = Kind>, tolerance: Duration) -> Self {
        let way = |kind| Way { kind, notes: VecDeque::new(), looked: Instant::MIN };
        Self { ways: kinds.map(way).collect(), tolerance }
    }

    /// Notes where the devices are, where that has changed.
    pub(super) fn note(&mut self, world: &mut World, nodes: &[NodeId]) {
        let at = world.now();
        for (way, node) in self.ways.iter_mut().zip(nodes) {
            let moved = std::mem::replace(&mut way.looked, at) < at;
            let Some(view) = world.view(*node) else { continue };
            let (position, floats) = (i32::from(view.position), world.floats(*node));
            if way.notes.back().is_none_or(|last| (last.position, last.floats) != (position, floats)) {
                way.notes.push_back(Note { at, position, floats, moved });
            }
        }
    }

    /// Returns the fields that carry a position in a frame that a device has just sent.
    pub(super) fn fields(&self, device: usize, frame: &Frame, tpdo: Option<(u32, &[MappingEntry])>) -> Fields {
        self.ways.get(device).map(|way| Fields::of(frame, way.kind, tpdo)).unwrap_or_default()
    }

    /// Forgets positions that no pair is looked for any more at `known`.
    pub(super) fn forget(&mut self, known: Instant) {
        let needed = (PATIENCE + self.tolerance + GRID) * 4;
        let from = Instant::from_ticks(known.as_ticks().saturating_sub(needed.as_ticks()));
        for Way { notes, .. } in &mut self.ways {
            while notes.get(1).is_some_and(|note| note.at < from) {
                notes.pop_front();
            }
        }
    }

    /// Returns whether two frames of an identifier say the same: equal, but for a position that the stand-in comes to
    /// within the tolerance.
    pub(super) fn alike(&self, logged: &Item, sent: &Item) -> bool {
        logged.frame == sent.frame || self.differ_in_position(logged, sent).unwrap_or(false)
    }

    fn differ_in_position(&self, logged: &Item, sent: &Item) -> Option<bool> {
        let (frame, fields) = (&logged.frame, &sent.fields);
        let mask = fields.iter().fold(0, |mask, field| mask | field.mask());
        let is_like = frame.len() == sent.frame.len() && !frame.is_remote();
        if mask == 0 || !is_like || (bits(frame) ^ bits(&sent.frame)) & !mask != 0 {
            return Some(false);
        }
        let way = self.ways.get(sent.device?)?;
        let margin = self.tolerance + GRID;
        let (first, last) = (logged.at.min(sent.at), logged.at.max(sent.at));
        let from = Instant::from_ticks(first.as_ticks().saturating_sub(margin.as_ticks()));
        let until = after(last, margin);
        let told = fields.iter().map(|field| field.form.positions_of(field.read(frame)));
        let told = told.reduce(|one, two| *one.start().max(two.start())..=*one.end().min(two.end()))?;
        let tells_float = fields.iter().all(|field| field.form.tell_float() == Some(field.read(frame)));
        Some(
            !told.is_empty() && way.comes_to(&told, from, until)
                || tells_float && way.between(from, until).any(|note| note.floats),
        )
    }
}

#[cfg(test)]
#[path = "position_tests.rs"]
mod tests;
