//! The position fields of a frame, with their places and encodings. A PDO mapping, an object or a message defines them.

use std::ops::RangeInclusive;

use protocol_core::actuator::{Position, Scale};
use protocol_core::device::Protocol;
use protocol_core::encoder::POSITION_MAX;
use protocol_core::frame::{ExtendedId, Frame, Id};
use protocol_core::wire::cob_id::{Function, classify};
use protocol_core::wire::j1939_id::{J1939Id, Pgn};
use protocol_core::wire::pdo_mapping::MappingEntry;

use crate::Kind;

/// The value of 0x6301 while the spool floats (SPEC 2).
const FLOAT: i32 = 32_767;

/// The value of an AVEF without flow (SPEC 5).
const NO_FLOW: i32 = 125;

/// A little-endian number in the data of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Field {
    /// The index of the lowest bit.
    shift: u8,
    bits: u8,
    pub(super) encoding: Encoding,
}

/// The encoding of a position in a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Object 0x6301.
    Spool,
    /// Object 0x3301.
    Per127,
    /// Object 0x3302.
    Inverted,
    /// Object 0x3304.
    Per1000,
    /// Object 0x6004.
    Shaft,
    /// The first byte of an AVEF.
    Extend,
    /// The second byte of an AVEF.
    Retract,
}

impl Encoding {
    /// Returns the encoding and the bit length of an object that holds a position; `None` for any other object.
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

    const fn positions(self) -> RangeInclusive<i32> {
        match self {
            Self::Shaft => 0..=POSITION_MAX as i32,
            _ => -(Position::FULL as i32)..=Position::FULL as i32,
        }
    }

    /// Encodes a position. The value increases with the position, or decreases if the encoding [falls](Self::falls).
    pub(super) fn encode(self, position: i32) -> i32 {
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

    /// Returns the value for a floating spool; `None` if the field contains the position even while the spool floats.
    pub(super) fn encode_float(self) -> Option<i32> {
        match self {
            Self::Spool => Some(FLOAT),
            Self::Per127 | Self::Inverted | Self::Per1000 => Some(self.encode(Position::FULL.into())),
            Self::Shaft | Self::Extend | Self::Retract => None,
        }
    }

    /// Returns the positions that are encoded as `value`; an empty range if there are none.
    pub(super) fn decode(self, value: i32) -> RangeInclusive<i32> {
        let value = if self.falls() { -value } else { value };
        let rising = |position: i32| if self.falls() { -self.encode(position) } else { self.encode(position) };
        first(self.positions(), |position| rising(position) >= value)..=first(self.positions(), |position| {
            rising(position) > value
        }) - 1
    }
}

/// Returns the first position for which `is` returns true, or the end of the range plus 1. The search is binary, so
/// `is` must return true for all later positions too.
fn first(positions: RangeInclusive<i32>, is: impl Fn(i32) -> bool) -> i32 {
    let (mut low, mut high) = (*positions.start(), *positions.end() + 1);
    while low < high {
        let middle = low + (high - low) / 2;
        if is(middle) { high = middle } else { low = middle + 1 }
    }
    low
}

impl Field {
    pub(super) fn mask(self) -> u64 {
        u64::MAX.unbounded_shr(64 - u32::from(self.bits)).unbounded_shl(self.shift.into())
    }

    /// Reads the value of the field from a frame, sign-extended if the encoding is signed.
    pub(super) fn read(self, frame: &Frame) -> i32 {
        let value = ((bits(frame) & self.mask()) >> self.shift) as u32;
        let above = 32 - u32::from(self.bits);
        match self.encoding {
            Encoding::Extend | Encoding::Retract => value as i32,
            _ => (value << above) as i32 >> above,
        }
    }
}

pub(super) const fn bits(frame: &Frame) -> u64 {
    u64::from_le_bytes(*frame.bytes())
}

/// Returns the position fields in a frame from a device of this kind. `tpdo` is the key and the mapping of the device's
/// TPDO.
pub(super) fn fields_of(frame: &Frame, kind: Kind, tpdo: Option<(u32, &[MappingEntry])>) -> Vec<Field> {
    let field = |shift: u8, (encoding, bits): (Encoding, u8)| Field { shift, bits, encoding };
    match (tpdo, frame.id(), kind.protocol()) {
        (Some((key, mapping)), ..) if key == frame.key() => {
            let mut shift: u8 = 0;
            let next = |entry: &MappingEntry| {
                let at = shift;
                shift = shift.saturating_add(entry.bits);
                Encoding::of_object(entry.index, entry.sub).map(|object| field(at, object))
            };
            mapping.iter().filter_map(next).collect()
        }
        (_, Id::Standard(id), Protocol::Canopen) if matches!(classify(id), Some((Function::SdoAnswer, _))) => {
            // The response to an expedited upload.
            let &[0x42..=0x43 | 0x47 | 0x4B | 0x4F, low, high, sub, ..] = frame.data() else { return Vec::new() };
            let object = Encoding::of_object(u16::from_le_bytes([low, high]), sub);
            object.into_iter().map(|object| field(32, object)).collect()
        }
        (_, Id::Extended(id), Protocol::Isobus) if is_avef(id) => {
            vec![field(0, (Encoding::Extend, 8)), field(8, (Encoding::Retract, 8))]
        }
        _ => Vec::new(),
    }
}

/// Returns the bits that show a state in a cyclic frame from a device of this kind: the NMT state in a heartbeat, the
/// state in force in AVEF. Returns 0 for other frames and for the boot-up message.
pub(super) fn state_bits(frame: &Frame, kind: Kind) -> u64 {
    match (frame.id(), kind.protocol()) {
        (Id::Standard(id), Protocol::Canopen) if matches!(classify(id), Some((Function::Heartbeat, _))) => {
            if matches!(frame.data(), [1..=0xFF]) { 0xFF } else { 0 }
        }
        (Id::Extended(id), Protocol::Isobus) if is_avef(id) => 0x0F_0000,
        _ => 0,
    }
}

fn is_avef(id: ExtendedId) -> bool {
    let id = J1939Id::from_raw(id.as_raw());
    id.pgn() == Pgn::avef(id.source().get())
}

#[cfg(test)]
#[path = "fields_tests.rs"]
mod tests;
