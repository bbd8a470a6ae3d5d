//! The tolerance of positions: a frame may hold any position that the stand-in passes within the tolerance of time.
//!
//! The mapping or the message of a frame tells which of its fields hold the position. A logged frame matches the frame
//! of the stand-in when all other bits are equal, and one position that the stand-in passes gives all these fields the
//! logged values. A device at rest has one position: frames then match when they are equal.

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

/// The longest time between two samples of a position that changes.
pub(super) const GRID: Duration = Duration::from_millis(1);

/// The value of 0x6301 while the spool floats (SPEC 2).
const FLOAT: i32 = 32_767;

/// The value of an AVEF for no flow (SPEC 5).
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
    encoding: Encoding,
}

/// The encoding of a position in a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
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

impl Encoding {
    /// Returns the encoding of an object that holds the position, and its length in bits; `None` for another object.
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

    /// Returns the value of the field at a position: it rises with the position, or [falls](Self::falls).
    fn encode(self, position: i32) -> i32 {
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

    /// Returns the value of the field while the spool floats; `None` for a field that still holds the position then.
    fn encode_float(self) -> Option<i32> {
        match self {
            Self::Spool => Some(FLOAT),
            Self::Per127 | Self::Inverted | Self::Per1000 => Some(self.encode(Position::FULL.into())),
            Self::Shaft | Self::Extend | Self::Retract => None,
        }
    }

    /// Returns the positions at which the field holds a value; empty when there is none.
    fn decode(self, value: i32) -> RangeInclusive<i32> {
        let value = if self.falls() { -value } else { value };
        let rising = |position: i32| if self.falls() { -self.encode(position) } else { self.encode(position) };
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

    /// Returns the value of the field in a frame, with the sign of its encoding.
    fn read(self, frame: &Frame) -> i32 {
        let value = ((bits(frame) & self.mask()) >> self.shift) as u32;
        let above = 32 - u32::from(self.bits);
        match self.encoding {
            Encoding::Extend | Encoding::Retract => value as i32,
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
        let mut add = |shift: u8, (encoding, bits): (Encoding, u8)| {
            if let Some(place) = places.next() {
                *place = Some(Field { shift, bits, encoding });
            }
        };
        match (tpdo, frame.id(), kind.protocol()) {
            (Some((key, mapping)), ..) if key == frame.key() => {
                let mut shift: u8 = 0;
                for entry in mapping {
                    Encoding::of_object(entry.index, entry.sub).into_iter().for_each(|field| add(shift, field));
                    shift = shift.saturating_add(entry.bits);
                }
            }
            (_, Id::Standard(id), Protocol::Canopen) if id.as_raw() & !0x7F == Function::SdoAnswer as u16 => {
                // An answer to the upload of at most four bytes.
                if let &[0x42..=0x43 | 0x47 | 0x4B | 0x4F, low, high, sub, ..] = frame.data() {
                    Encoding::of_object(u16::from_le_bytes([low, high]), sub)
                        .into_iter()
                        .for_each(|field| add(32, field));
                }
            }
            (_, Id::Extended(id), Protocol::Isobus) => {
                let id = J1939Id::from_raw(id.as_raw());
                if id.pgn() == Pgn::avef(id.source().get()) {
                    add(0, (Encoding::Extend, 8));
                    add(8, (Encoding::Retract, 8));
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

/// The position of a device at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    at: Instant,
    position: i32,
    /// The spool floats, and its objects say so.
    floats: bool,
    /// The device came here from the sample before through all positions between; otherwise it jumped.
    moved: bool,
}

/// The positions of a device over time.
#[derive(Debug)]
struct Track {
    kind: Kind,
    samples: VecDeque<Sample>,
    /// The instant of the last look at the device.
    looked: Instant,
}

impl Track {
    /// Returns the samples from the one in force at an instant up to another instant.
    fn between(&self, from: Instant, until: Instant) -> impl Iterator<Item = &Sample> + Clone {
        let begin = self.samples.partition_point(|sample| sample.at <= from).saturating_sub(1);
        self.samples.iter().skip(begin).take_while(move |sample| sample.at <= until)
    }

    /// Returns whether one of these positions lies between two samples.
    fn is_between(&self, from: i32, to: i32, positions: &RangeInclusive<i32>) -> bool {
        let turn = STEPS as i32;
        let passed = |by: i32| from.min(from + by)..=from.max(from + by);
        let overlaps = |passed: &RangeInclusive<i32>, shift: i32| {
            *positions.start() <= passed.end() + shift && passed.start() + shift <= *positions.end()
        };
        if matches!(self.kind, Kind::Hat(_)) {
            // The shorter way round.
            let passed = passed((to - from + turn / 2).rem_euclid(turn) - turn / 2);
            [-turn, 0, turn].into_iter().any(|shift| overlaps(&passed, shift))
        } else {
            overlaps(&passed(to - from), 0)
        }
    }

    /// Returns whether the device comes to one of these positions between two instants.
    fn passes(&self, positions: &RangeInclusive<i32>, from: Instant, until: Instant) -> bool {
        let samples = self.between(from, until);
        let is_at = |sample: &Sample| !sample.floats && positions.contains(&sample.position);
        let passes = |(one, other): (&Sample, &Sample)| {
            other.moved && !(one.floats && other.floats) && self.is_between(one.position, other.position, positions)
        };
        samples.clone().any(is_at) || samples.clone().zip(samples.skip(1)).any(passes)
    }
}

/// The positions of all stand-ins over time, and how much frames may differ by them.
#[derive(Debug)]
pub(super) struct PositionTolerance {
    tracks: Vec<Track>,
    tolerance: Duration,
}

impl PositionTolerance {
    pub(super) fn new(kinds: impl Iterator<Item = Kind>, tolerance: Duration) -> Self {
        let track = |kind| Track { kind, samples: VecDeque::new(), looked: Instant::MIN };
        Self { tracks: kinds.map(track).collect(), tolerance }
    }

    /// Samples the positions that have changed.
    pub(super) fn sample(&mut self, world: &mut World, nodes: &[NodeId]) {
        let at = world.now();
        for (track, node) in self.tracks.iter_mut().zip(nodes) {
            let moved = std::mem::replace(&mut track.looked, at) < at;
            let Some(view) = world.view(*node) else { continue };
            let (position, floats) = (i32::from(view.position), world.floats(*node));
            if track.samples.back().is_none_or(|last| (last.position, last.floats) != (position, floats)) {
                track.samples.push_back(Sample { at, position, floats, moved });
            }
        }
    }

    /// Returns the fields that carry a position in a frame that a device has just sent.
    pub(super) fn fields(&self, device: usize, frame: &Frame, tpdo: Option<(u32, &[MappingEntry])>) -> Fields {
        self.tracks.get(device).map(|track| Fields::of(frame, track.kind, tpdo)).unwrap_or_default()
    }

    /// Forgets positions that no pair is looked for any more at `known`.
    pub(super) fn forget(&mut self, known: Instant) {
        let needed = (PATIENCE + self.tolerance + GRID) * 4;
        let from = Instant::from_ticks(known.as_ticks().saturating_sub(needed.as_ticks()));
        for Track { samples, .. } in &mut self.tracks {
            while samples.get(1).is_some_and(|sample| sample.at < from) {
                samples.pop_front();
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
        let track = self.tracks.get(sent.device?)?;
        let margin = self.tolerance + GRID;
        let (first, last) = (logged.at.min(sent.at), logged.at.max(sent.at));
        let from = Instant::from_ticks(first.as_ticks().saturating_sub(margin.as_ticks()));
        let until = after(last, margin);
        let positions = fields.iter().map(|field| field.encoding.decode(field.read(frame)));
        let positions = positions.reduce(|one, two| *one.start().max(two.start())..=*one.end().min(two.end()))?;
        let is_float = fields.iter().all(|field| field.encoding.encode_float() == Some(field.read(frame)));
        Some(
            !positions.is_empty() && track.passes(&positions, from, until)
                || is_float && track.between(from, until).any(|sample| sample.floats),
        )
    }
}

#[cfg(test)]
#[path = "position_tests.rs"]
mod tests;
