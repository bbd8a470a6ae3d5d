//! The classic CAN frame that the core, the simulator and the board share.

use core::fmt;

pub use embedded_can::{ExtendedId, Id, StandardId};

/// The maximum number of data bytes of a classic CAN frame.
pub const MAX_LEN: usize = 8;

/// The bit of a key that marks a 29-bit identifier, as in a COB-ID object.
const EXTENDED: u32 = 1 << 29;

/// The masks for the first 0 to 7 bytes. The table avoids 64-bit shifts, which are function calls on the board.
const KEPT: [u64; MAX_LEN] =
    [0, 0xFF, 0xFFFF, 0xFF_FFFF, 0xFFFF_FFFF, 0xFF_FFFF_FFFF, 0xFFFF_FFFF_FFFF, 0xFF_FFFF_FFFF_FFFF];

/// Returns the key of an identifier: its 11 or 29 bits, plus bit 29 for a 29-bit identifier.
#[inline]
#[must_use]
pub fn key(id: Id) -> u32 {
    match id {
        Id::Standard(id) => id.as_raw().into(),
        Id::Extended(id) => id.as_raw() | EXTENDED,
    }
}

/// Returns the number of an identifier: its 11 or 29 bits.
#[must_use]
pub fn number(id: Id) -> u32 {
    key(id) & !EXTENDED
}

/// Returns the 11-bit or 29-bit identifier with this number; `None` for a number above 0x7FF or 0x1FFF_FFFF.
#[must_use]
pub fn identifier(number: u32, is_extended: bool) -> Option<Id> {
    if is_extended {
        ExtendedId::new(number).map(Id::Extended)
    } else {
        u16::try_from(number).ok().and_then(StandardId::new).map(Id::Standard)
    }
}

/// An identifier as text: three hex digits for 11 bits, eight for 29 bits.
#[derive(Clone, Copy, Debug)]
pub struct Digits(pub Id);

impl fmt::Display for Digits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Id::Standard(id) => write!(f, "{:03X}", id.as_raw()),
            Id::Extended(id) => write!(f, "{:08X}", id.as_raw()),
        }
    }
}

/// Returns the arbitration value of a data frame with this [`key`]. The lower value wins the bus.
///
/// An 11-bit identifier wins against a 29-bit identifier with the same first eleven bits (ISO 11898-1).
#[inline]
#[must_use]
pub const fn arbitration(key: u32) -> u32 {
    if key & EXTENDED == 0 {
        // 11 bits, RTR and IDE = 0. Later bits never decide.
        key << 21
    } else {
        // 11 bits, SRR = 1, IDE = 1, 18 bits, RTR = 0.
        let raw = key & !EXTENDED;
        (raw >> 18) << 21 | 1 << 20 | 1 << 19 | (raw & 0x3_FFFF) << 1
    }
}

/// A classic CAN data or remote frame.
///
/// The length is always 0–8. A raw DLC of 9–15, which means 8 bytes on CAN, cannot be represented.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Frame {
    key: u32,
    remote: bool,
    len: u8,
    data: [u8; MAX_LEN],
}

impl Frame {
    /// A data frame of length 0 with identifier 0.
    pub(crate) const EMPTY: Self = Self { key: 0, remote: false, len: 0, data: [0; MAX_LEN] };

    /// Creates a data frame with the first `len` bytes of `data`. A length above 8 counts as 8, like a DLC above 8.
    #[inline]
    #[must_use]
    pub fn with_len(id: Id, data: [u8; MAX_LEN], len: u8) -> Self {
        let len = if len > 8 { 8 } else { len };
        let mut frame = Self { key: key(id), remote: false, len, data };
        frame.blank_rest();
        frame
    }

    /// Creates a data frame with eight bytes.
    #[inline]
    #[must_use]
    pub fn full(id: Id, data: [u8; MAX_LEN]) -> Self {
        Self { key: key(id), remote: false, len: 8, data }
    }

    /// Creates a data frame with the bytes of `data`; `None` for more than eight bytes.
    #[must_use]
    pub fn of(id: Id, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; MAX_LEN];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { key: key(id), remote: false, len: u8::try_from(data.len()).ok()?, data: bytes })
    }

    /// Returns a data frame with the same identifier and length, but other data. Bytes beyond the length are dropped.
    #[must_use]
    pub fn refilled(&self, data: [u8; MAX_LEN]) -> Self {
        let mut frame = Self { key: self.key, remote: false, len: self.len, data };
        frame.blank_rest();
        frame
    }

    /// Returns a data frame with other data, as [`refilled`](Self::refilled) does. The data must be zero beyond the
    /// length.
    #[inline]
    #[must_use]
    pub(crate) fn carrying(&self, data: [u8; MAX_LEN]) -> Self {
        debug_assert_eq!(self.refilled(data).data, data);
        Self { key: self.key, remote: false, len: self.len, data }
    }

    /// Creates a remote frame that requests `len` bytes. A length above 8 counts as 8.
    #[must_use]
    pub fn remote(id: Id, len: u8) -> Self {
        let len = if len > 8 { 8 } else { len };
        Self { key: key(id), remote: true, len, data: [0; MAX_LEN] }
    }

    /// Returns the identifier.
    #[inline]
    #[must_use]
    pub const fn id(&self) -> Id {
        if self.key & EXTENDED == 0 {
            Id::Standard(standard((self.key & 0x7FF) as u16))
        } else {
            Id::Extended(extended(self.key))
        }
    }

    /// Returns the [`key`] of the identifier.
    #[inline]
    #[must_use]
    pub const fn key(&self) -> u32 {
        self.key
    }

    /// Returns whether the identifier has 29 bits.
    #[inline]
    #[must_use]
    pub const fn is_extended(&self) -> bool {
        self.key & EXTENDED != 0
    }

    /// Returns whether the frame is a remote frame.
    #[inline]
    #[must_use]
    pub const fn is_remote(&self) -> bool {
        self.remote
    }

    /// Returns the number of bytes, 0–8, that a data frame carries or a remote frame requests.
    #[inline]
    #[must_use]
    pub const fn len(&self) -> u8 {
        self.len
    }

    /// Returns whether the length is 0.
    #[inline]
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the data bytes. A remote frame has no data bytes.
    #[inline]
    #[must_use]
    pub fn data(&self) -> &[u8] {
        let len = if self.remote { 0 } else { usize::from(self.len) };
        self.data.get(..len).unwrap_or(&[])
    }

    /// Returns all eight bytes of the buffer. The bytes beyond the length are zero.
    #[inline]
    #[must_use]
    pub const fn bytes(&self) -> &[u8; MAX_LEN] {
        &self.data
    }

    /// Returns the data bytes of a data frame with exactly eight bytes; `None` for other frames.
    #[inline]
    #[must_use]
    pub const fn eight(&self) -> Option<&[u8; MAX_LEN]> {
        if self.len == 8 && !self.remote { Some(&self.data) } else { None }
    }

    /// Returns the arbitration value. The lower value wins the bus.
    ///
    /// A data frame wins against a remote frame with the same identifier (ISO 11898-1). See also [`arbitration`].
    #[inline]
    #[must_use]
    pub const fn arbitration(&self) -> u32 {
        let remote = if self.key & EXTENDED == 0 { (self.remote as u32) << 20 } else { self.remote as u32 };
        arbitration(self.key) | remote
    }

    fn blank_rest(&mut self) {
        if let Some(keep) = KEPT.get(usize::from(self.len)) {
            self.data = (u64::from_le_bytes(self.data) & keep).to_le_bytes();
        }
    }
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        Self::of(id.into(), data)
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        let len = u8::try_from(dlc).ok().filter(|len| usize::from(*len) <= MAX_LEN)?;
        Some(Self::remote(id.into(), len))
    }

    fn is_extended(&self) -> bool {
        Frame::is_extended(self)
    }

    fn is_remote_frame(&self) -> bool {
        self.remote
    }

    fn id(&self) -> Id {
        Frame::id(self)
    }

    fn dlc(&self) -> usize {
        usize::from(self.len)
    }

    fn data(&self) -> &[u8] {
        Frame::data(self)
    }
}

/// Formats a frame as the manuals do: `5A0: 43 18 10 01 19 00 00 01`. A 29-bit identifier has eight digits. A remote
/// frame shows `R` and its length in place of data.
impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", Digits(self.id()))?;
        if self.remote {
            return write!(f, " R{}", self.len);
        }
        self.data().iter().try_for_each(|byte| write!(f, " {byte:02X}"))
    }
}

/// Parses the format of [`Display`](fmt::Display). Identifiers have three or eight digits, bytes one or two.
impl core::str::FromStr for Frame {
    type Err = ParseFrameError;

    fn from_str(text: &str) -> Result<Self, ParseFrameError> {
        let (id, rest) = text.trim().split_once(':').ok_or(ParseFrameError)?;
        let raw = u32::from_str_radix(id, 16).map_err(|_| ParseFrameError)?;
        let id = match id.len() {
            3 => identifier(raw, false),
            8 => identifier(raw, true),
            _ => None,
        };
        let id = id.ok_or(ParseFrameError)?;
        if let Some(len) = rest.trim().strip_prefix('R') {
            let len = len.parse().ok().filter(|len| *len <= 8).ok_or(ParseFrameError)?;
            return Ok(Self::remote(id, len));
        }
        let mut data = heapless::Vec::<u8, MAX_LEN>::new();
        for byte in rest.split_whitespace() {
            let byte = u8::from_str_radix(byte, 16).map_err(|_| ParseFrameError)?;
            data.push(byte).map_err(|_| ParseFrameError)?;
        }
        Self::of(id, &data).ok_or(ParseFrameError)
    }
}

/// The error for a text that is not a frame in the notation of the manuals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParseFrameError;

impl fmt::Display for ParseFrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("not a frame: expected an identifier of 3 or 8 hex digits, a colon, and up to 8 bytes")
    }
}

impl core::error::Error for ParseFrameError {}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Creates an 11-bit identifier from the low eleven bits of `raw`.
#[inline]
#[must_use]
pub const fn standard(raw: u16) -> StandardId {
    match StandardId::new(raw & 0x7FF) {
        Some(id) => id,
        None => StandardId::MAX,
    }
}

/// Creates a 29-bit identifier from the low 29 bits of `raw`.
#[inline]
#[must_use]
pub const fn extended(raw: u32) -> ExtendedId {
    match ExtendedId::new(raw & 0x1FFF_FFFF) {
        Some(id) => id,
        None => ExtendedId::MAX,
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::string::ToString;

    use super::*;

    fn std_frame(id: u16, data: &[u8]) -> Frame {
        Frame::of(standard(id).into(), data).unwrap()
    }

    #[test]
    fn prints_as_the_manuals_do() {
        assert_eq!(format!("{}", std_frame(0x700, &[0])), "700: 00");
        assert_eq!(format!("{}", Frame::of(extended(0x1BC7_8805).into(), &[3, 0x22]).unwrap()), "1BC78805: 03 22");
        assert_eq!(format!("{}", Frame::remote(standard(0x700).into(), 1)), "700: R1");
    }

    #[test]
    fn reads_what_it_prints() {
        for text in ["700: 00", "080: 12 34 05 0F 00 00 00 00", "1BC78805: 03 22", "080:", "700: R1"] {
            assert_eq!(text.parse::<Frame>().unwrap().to_string(), text);
        }
        for text in ["", "700", "70: 00", "800: 00", "20000000: 00", "700: 100", "700: 0 1 2 3 4 5 6 7 8", "700: R9"] {
            assert_eq!(text.parse::<Frame>(), Err(ParseFrameError), "{text}");
        }
    }

    #[test]
    fn a_length_above_eight_counts_as_eight() {
        assert_eq!(Frame::with_len(standard(1).into(), [7; 8], 15).data(), [7; 8]);
        assert_eq!(Frame::remote(standard(1).into(), 15).len(), 8);
        assert_eq!(Frame::of(standard(1).into(), &[0; 9]), None);
    }

    #[test]
    fn bytes_beyond_the_length_are_zero() {
        let frame = Frame::with_len(standard(1).into(), [7; 8], 3);
        assert_eq!(frame.data(), [7; 3]);
        assert_eq!(frame.bytes(), &[7, 7, 7, 0, 0, 0, 0, 0]);
        assert_eq!(frame.refilled([9; 8]).bytes(), &[9, 9, 9, 0, 0, 0, 0, 0]);
        assert_eq!(Frame::with_len(standard(1).into(), [7; 8], 0).bytes(), &[0; 8]);
    }

    #[test]
    fn arbitration_as_on_the_wire() {
        let data = std_frame(0x123, &[]);
        let remote = Frame::remote(standard(0x123).into(), 0);
        let long = Frame::of(extended(0x123 << 18).into(), &[]).unwrap();
        let next = std_frame(0x124, &[]);
        assert!(data.arbitration() < remote.arbitration());
        assert!(remote.arbitration() < long.arbitration());
        assert!(long.arbitration() < next.arbitration());
    }
}
