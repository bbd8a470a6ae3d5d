//! The bits of a classic CAN frame (ISO 11898-1): the length on the wire, and the first difference between two frames.

use crc::{CRC_15_CAN, Crc, Table};
use protocol_core::frame::{Frame, Id};

/// The CRC of CAN, with a lookup table that processes a whole frame (up to 16 bytes) in one step.
static CRC: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_15_CAN);
const CRC_BITS: u32 = 15;

/// CRC delimiter, ACK slot, ACK delimiter and end of frame: the bits after the CRC sequence, never stuffed. The sender
/// sends all of them recessive.
pub(super) const TRAILER: u32 = 1 + 1 + 1 + 7;
/// ACK delimiter and end of frame: the bits after the ACK slot.
pub(super) const AFTER_ACK_SLOT: u32 = 1 + 7;
/// The minimum number of recessive bits between two frames.
pub const INTERMISSION: u32 = 3;
/// The number of consecutive recessive bits after which a controller considers the bus idle.
pub(super) const BUS_IDLE: u32 = 11;
/// Suspend transmission: the bits that an error-passive sender waits after the intermission.
pub(super) const SUSPEND: u32 = 8;
/// The number of bits of an error flag.
pub(super) const ERROR_FLAG: u32 = 6;
/// The number of recessive bits after an error flag.
pub(super) const ERROR_DELIMITER: u32 = 8;
/// The number of equal bits after which a stuff bit follows.
const STUFF_AFTER: u8 = 5;

/// A frame from start of frame to the end of the CRC sequence, before stuffing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameBits {
    /// The frame in the lowest `len` bits. The first bit on the wire is the most significant bit; 0 is dominant.
    pub(super) value: u128,
    pub(super) len: u32,
}

impl FrameBits {
    /// Computes the bits of `frame`.
    #[must_use]
    pub fn of(frame: &Frame) -> Self {
        let rtr = u128::from(frame.is_remote());
        let mut bits = match frame.id() {
            // start of frame, 11 bits of identifier, RTR, IDE and r0 (dominant)
            Id::Standard(id) => Self { value: u128::from(id.as_raw()) << 3 | rtr << 2, len: 1 + 11 + 3 },
            // start of frame, 11 bits, SRR and IDE (recessive), 18 bits, RTR, r1 and r0 (dominant)
            Id::Extended(id) => {
                let raw = u128::from(id.as_raw());
                let (base, extension) = (raw >> 18, raw & 0x3_FFFF);
                Self { value: base << 23 | 0b11 << 21 | extension << 3 | rtr << 2, len: 1 + 11 + 2 + 18 + 3 }
            }
        };
        bits.push(u128::from(frame.len()), 4);
        if !frame.is_remote() {
            let len = u32::from(frame.len()) * 8;
            let data = u64::from_be_bytes(*frame.bytes());
            bits.push(u128::from(data.checked_shr(u64::BITS - len).unwrap_or(0)), len);
        }
        // The initial CRC is 0: leading zeros before the start of frame do not change the result.
        bits.push(u128::from(CRC.checksum(&bits.value.to_be_bytes())), CRC_BITS);
        bits
    }

    /// Returns the length on the wire in bits: from start of frame to end of frame, including stuff bits but not the
    /// intermission.
    #[must_use]
    pub fn on_wire(self) -> u32 {
        self.len + self.stuff_bits(self.len) + TRAILER
    }

    /// Returns the first bit at which this frame differs from `other`; `None` if the frames are equal.
    pub(super) fn first_difference(self, other: Self) -> Option<Difference> {
        let common = self.len.min(other.len);
        let different = self.value >> (self.len - common) ^ other.value >> (other.len - common);
        let from_end = different.checked_ilog2()?;
        let bit = common - 1 - from_end;
        let dominant = self.value >> (self.len - 1 - bit) & 1 == 0;
        Some(Difference { bit: bit + self.stuff_bits(bit), dominant })
    }

    fn push(&mut self, value: u128, len: u32) {
        self.value = self.value << len | value;
        self.len += len;
    }

    /// Returns the number of stuff bits among the first `len` bits.
    pub(super) fn stuff_bits(self, len: u32) -> u32 {
        // The table is indexed by whole bytes, so alternating bits pad the first byte before the start of frame.
        let bits = ALTERNATING << len | self.value >> (self.len - len);
        let unused = (u128::BITS - len) as usize / 8;
        let (mut state, mut sum) = (0, 0_u16);
        for byte in &bits.to_be_bytes()[unused..] {
            let step = STUFF[usize::from(state | u16::from(*byte))];
            state = step & STATE;
            // The counts stay in the low byte: a frame has fewer than 32 stuff bits.
            sum = sum.wrapping_add(step);
        }
        u32::from(sum & COUNT)
    }
}

/// Padding before the start of frame: alternating bits that end recessive, so that the padding adds no stuff bits.
const ALTERNATING: u128 = 0x5555_5555_5555_5555_5555_5555_5555_5555;

/// The number of states in the table: the states of [`run`], rounded up to a power of two.
const STATES: usize = 16;
/// The mask of the next state in a table entry. The state is in the high byte, so that the next table index is the
/// state combined with the next byte.
const STATE: u16 = (STATES as u16 - 1) << 8;
/// The mask of the number of stuff bits in a table entry.
const COUNT: u16 = 0xFF;

/// The next state and the number of stuff bits, indexed by the current state and the next byte. A look-up per byte
/// replaces a step per bit.
static STUFF: [u16; STATES * 256] = {
    let mut table = [0; STATES * 256];
    let mut state = 0;
    while state < 2 * STUFF_AFTER {
        let mut byte = 0;
        while byte < 256 {
            table[(state as usize) << 8 | byte] = step(state, byte as u8);
            byte += 1;
        }
        state += 1;
    }
    table
};

/// Returns the state after a run of `length` bits equal to `last`. `length` is 1 to 4, or 0 before the first bit.
const fn run(last: u8, length: u8) -> u8 {
    last * STUFF_AFTER + length
}

const fn step(state: u8, byte: u8) -> u16 {
    let (mut last, mut length) = (state / STUFF_AFTER, state % STUFF_AFTER);
    let mut stuffed = 0;
    let mut place = 8;
    while place > 0 {
        place -= 1;
        let bit = byte >> place & 1;
        length = if bit == last { length + 1 } else { 1 };
        last = bit;
        if length == STUFF_AFTER {
            // The stuff bit has the opposite value and starts a new run.
            stuffed += 1;
            last = 1 - bit;
            length = 1;
        }
    }
    (run(last, length) as u16) << 8 | stuffed
}

/// The first difference between two frames sent simultaneously.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Difference {
    /// The bit position on the wire, including stuff bits, counted from 0 at the start of frame.
    pub(super) bit: u32,
    /// `true` if `self` of [`FrameBits::first_difference`] is dominant at this bit and `other` is recessive.
    pub(super) dominant: bool,
}
