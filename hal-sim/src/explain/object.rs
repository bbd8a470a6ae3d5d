//! Objects of a device's dictionary, and their values.

use protocol_core::canopen::dictionary::{DataType, Entry, Value};
use protocol_core::device::{hat, pve};
use protocol_core::encoder;
use protocol_core::wire::sdo::Multiplexer;

use super::valve::{command, state, stroke};
use super::{hex, text_or_hex};
use crate::Kind;

fn entry(object: Multiplexer, kind: Option<Kind>) -> Option<&'static Entry> {
    match kind? {
        Kind::Pve(_) => pve::entry(object),
        Kind::Hat(_) => hat::entry(object),
    }
}

/// Returns the index and sub-index of an object, and the name if known.
pub(super) fn object(object: Multiplexer, kind: Option<Kind>) -> String {
    let Multiplexer { index, sub } = object;
    let number = format!("0x{index:04X}:{sub}");
    entry(object, kind).map_or(number.clone(), |entry| format!("{number} ({})", entry.name))
}

/// Returns the size of an object in bytes; `None` if the object is unknown or a string.
pub(super) fn size(object: Multiplexer, kind: Option<Kind>) -> Option<u8> {
    entry(object, kind).filter(|entry| !entry.is_text()).map(Entry::size)
}

/// Formats the value of an object according to its data type. Bytes of an unexpected length are shown in hex.
pub(super) fn value(object: Multiplexer, bytes: &[u8], kind: Option<Kind>) -> String {
    if size(object, kind).is_some_and(|size| usize::from(size) != bytes.len()) {
        return raw(bytes);
    }
    let Some(entry) = entry(object, kind) else { return raw(bytes) };
    let Value::Number(number) = entry.value(bytes) else { return text_or_hex(bytes) };
    match (object.index, object.sub) {
        (0x6003 | 0x6004, _) if matches!(kind, Some(Kind::Hat(_))) => angle(number),
        // Signatures are strings: "save", "load".
        (0x1010 | 0x1011, 1..) => text_or_hex(bytes),
        (0x6040, _) => format!("0x{number:04X} ({})", command(number as u16)),
        (0x6041, _) => format!("0x{number:04X} ({})", state(number as u16)),
        (0x6300 | 0x6301, 1) => format!("{} ({})", number as u16 as i16, stroke(number as u16 as i16)),
        (0x6042, _) if number == 1 => "1 (full operational)".to_owned(),
        (0x6042, _) if number == 2 => "2 (hand operation)".to_owned(),
        _ => formatted(entry.data_type(), number),
    }
}

/// Formats a number according to its data type.
pub fn formatted(data_type: DataType, number: u32) -> String {
    match data_type {
        DataType::I8 => (number as u8 as i8).to_string(),
        DataType::I16 => (number as u16 as i16).to_string(),
        DataType::I32 => (number as i32).to_string(),
        DataType::U8 | DataType::U16 => number.to_string(),
        DataType::U32 | DataType::Text(_) => format!("0x{number:08X}"),
    }
}

pub(super) fn angle(position: u32) -> String {
    format!("{position} ({:.2}°)", f64::from(position) * 360.0 / f64::from(encoder::STEPS))
}

/// Formats the data of an unknown object: one, two or four bytes as a number, otherwise byte by byte.
fn raw(bytes: &[u8]) -> String {
    match bytes {
        [_] | [_, _] | [_, _, _, _] => {
            let digits: String = bytes.iter().rev().map(|byte| format!("{byte:02X}")).collect();
            format!("0x{digits}")
        }
        _ => hex(bytes),
    }
}
