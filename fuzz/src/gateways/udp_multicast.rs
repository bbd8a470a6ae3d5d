//! A second parser of the datagrams of python-can's `udp_multicast`.

use hal_sim::Frame;
use hal_sim::log::Timestamp;
use pve_sim::gateway::udp_multicast::{emit, parse};

/// The maximum depth of a value.
const DEPTH: u32 = 64;

/// Asserts that a datagram yields the frame of its map, or none, and that the frame becomes a datagram which yields it
/// again.
pub(super) fn datagram(datagram: &[u8]) {
    let read = parse(datagram);
    let is_map = matches!(datagram.first(), Some(0x80..=0x8F | 0xDE | 0xDF));
    assert!(is_map || read.is_err(), "no map: {read:?}");
    if let Ok(frame) = read {
        assert_eq!(parse(&emit(Timestamp::from_micros(1), &frame)), Ok(frame));
    }
    let mut reader = Reader { bytes: datagram, is_beyond: false };
    match reader.value(0) {
        Some(Value::Map(pairs)) => match frame(&pairs) {
            Meaning::Frame(frame) => assert_eq!(read, Ok(frame)),
            Meaning::None => assert!(read.is_err(), "{read:?}"),
            Meaning::Unspecified => {}
        },
        Some(_) => {}
        None if reader.is_beyond => {}
        None => assert!(read.is_err(), "it is cut off: {read:?}"),
    }
}

enum Value<'a> {
    Nil,
    Bool(bool),
    Number(i128),
    Text(&'a [u8]),
    Bytes(&'a [u8]),
    Map(Vec<(Value<'a>, Value<'a>)>),
    Other,
}

enum Meaning {
    Frame(Frame),
    None,
    /// A value that no client sends.
    Unspecified,
}

fn frame(pairs: &[(Value<'_>, Value<'_>)]) -> Meaning {
    let (mut id, mut dlc, mut data) = (None, None, &[][..]);
    let (mut is_extended, mut is_remote, mut is_none) = (true, false, false);
    let mut seen = Vec::new();
    for (key, value) in pairs {
        let Value::Text(key) = key else { return Meaning::Unspecified };
        let known: [&[u8]; 7] =
            [b"arbitration_id", b"is_extended_id", b"is_remote_frame", b"is_error_frame", b"dlc", b"data", b"is_fd"];
        if !known.contains(key) {
            continue;
        }
        if seen.contains(key) {
            return Meaning::None;
        }
        seen.push(*key);
        match (*key, value) {
            (b"arbitration_id", Value::Number(number)) => id = Some(*number),
            (b"is_extended_id", Value::Bool(is)) => is_extended = *is,
            (b"is_remote_frame", Value::Bool(is)) => is_remote = *is,
            (b"is_error_frame" | b"is_fd", Value::Bool(is)) => is_none |= *is,
            (b"dlc" | b"data", Value::Nil) => {}
            (b"dlc", Value::Number(number)) => dlc = Some(*number),
            (b"data", Value::Bytes(bytes)) => data = bytes,
            (b"data", Value::Text(_)) => return Meaning::Unspecified,
            _ => return Meaning::None,
        }
    }
    let Some(id) = id.filter(|_| !is_none) else { return Meaning::None };
    let (digits, last) = if is_extended { (8, 0x1FFF_FFFF) } else { (3, 0x7FF) };
    let length = dlc.unwrap_or(if is_remote { 0 } else { data.len() as i128 });
    let fits = (0..=last).contains(&id) && (0..=8).contains(&length);
    let text = match is_remote {
        true if data.is_empty() => format!(" R{length}"),
        false if data.len() as i128 == length => data.iter().map(|byte| format!(" {byte:02X}")).collect(),
        _ => return Meaning::None,
    };
    if fits { format!("{id:0digits$X}:{text}").parse().map_or(Meaning::None, Meaning::Frame) } else { Meaning::None }
}

/// A reader of MessagePack.
struct Reader<'a> {
    bytes: &'a [u8],
    /// Whether the reader has met a value that no client sends. The rest is not read.
    is_beyond: bool,
}

impl<'a> Reader<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.bytes.split_at_checked(length)?;
        self.bytes = rest;
        Some(taken)
    }

    /// Takes a number of `length` bytes.
    fn number(&mut self, length: usize) -> Option<u64> {
        Some(self.take(length)?.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    fn length(&mut self, bytes: usize) -> Option<usize> {
        usize::try_from(self.number(bytes)?).ok()
    }

    /// Takes a value; `None` for an incomplete or too deep one.
    fn value(&mut self, depth: u32) -> Option<Value<'a>> {
        let [mark] = *self.take(1)? else { return None };
        self.is_beyond |= depth > DEPTH || mark == 0xC1;
        if self.is_beyond {
            return None;
        }
        let low = usize::from(mark & 0xF);
        Some(match mark {
            0..=0x7F => Value::Number(mark.into()),
            0x80..=0x8F => self.map(low, depth)?,
            0x90..=0x9F => self.list(low, depth)?,
            0xA0..=0xBF => Value::Text(self.take(usize::from(mark & 0x1F))?),
            0xC0 => Value::Nil,
            0xC1 => return None,
            0xC2 | 0xC3 => Value::Bool(mark == 0xC3),
            0xC4..=0xC6 => {
                let length = self.length(1 << (mark - 0xC4))?;
                Value::Bytes(self.take(length)?)
            }
            0xC7..=0xC9 => {
                let length = self.length(1 << (mark - 0xC7))?;
                self.take(length.checked_add(1)?)?;
                Value::Other
            }
            0xCA | 0xCB => {
                self.take(if mark == 0xCA { 4 } else { 8 })?;
                Value::Other
            }
            0xCC..=0xCF => Value::Number(self.number(1 << (mark - 0xCC))?.into()),
            0xD0..=0xD3 => {
                let length = 1 << (mark - 0xD0);
                let number = i128::from(self.number(length)?);
                let end = 1_i128 << (8 * length);
                Value::Number(if number >= end / 2 { number - end } else { number })
            }
            0xD4..=0xD8 => {
                self.take((1 << (mark - 0xD4)) + 1)?;
                Value::Other
            }
            0xD9..=0xDB => {
                let length = self.length(1 << (mark - 0xD9))?;
                Value::Text(self.take(length)?)
            }
            0xDC | 0xDD => {
                let length = self.length(if mark == 0xDC { 2 } else { 4 })?;
                self.list(length, depth)?
            }
            0xDE | 0xDF => {
                let length = self.length(if mark == 0xDE { 2 } else { 4 })?;
                self.map(length, depth)?
            }
            0xE0..=0xFF => Value::Number(i128::from(mark) - 256),
        })
    }

    fn list(&mut self, length: usize, depth: u32) -> Option<Value<'a>> {
        for _ in 0..length {
            self.value(depth + 1)?;
        }
        Some(Value::Other)
    }

    fn map(&mut self, length: usize, depth: u32) -> Option<Value<'a>> {
        let mut pairs = Vec::new();
        for _ in 0..length {
            pairs.push((self.value(depth + 1)?, self.value(depth + 1)?));
        }
        Some(Value::Map(pairs))
    }
}
