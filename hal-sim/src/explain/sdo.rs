//! SDO requests and responses (CiA 301 7.2.4).

use protocol_core::wire::sdo::{AbortCode, Answer, Multiplexer, Request, Segment};

use super::block::Party;
use super::object::{self, object, value};
use super::text_or_hex;
use crate::Kind;

pub(super) fn request(bytes: &[u8; 8], kind: Option<Kind>) -> String {
    match Request::parse(bytes) {
        Request::InitiateUpload(target) => format!("SDO read {}", object(target, kind)),
        Request::UploadSegment { toggle } => format!("SDO read, next segment, toggle {}", u8::from(toggle)),
        Request::DownloadExpedited { object: target, size, data } => {
            let bytes = data.to_le_bytes();
            // If the command does not indicate a size, the size of the object applies.
            let size = size.or_else(|| object::size(target, kind)).map_or(4, usize::from);
            let bytes = bytes.get(..size).unwrap_or(&bytes);
            format!("SDO write {} = {}", object(target, kind), value(target, bytes, kind))
        }
        Request::InitiateDownload { object: target, size } => {
            format!("SDO write {}, {}", object(target, kind), in_segments(size))
        }
        Request::DownloadSegment(part) => format!("SDO write, {}", segment(&part)),
        Request::Abort(target, code) => abort(&object(target, kind), AbortCode(code)),
        Request::Unknown(_) => {
            block(bytes, kind, Party::Client).unwrap_or_else(|| format!("SDO unknown command 0x{:02X}", bytes[0]))
        }
    }
}

pub(super) fn answer(bytes: &[u8; 8], kind: Option<Kind>) -> Option<String> {
    let Some(answer) = Answer::parse(bytes) else { return block(bytes, kind, Party::Server) };
    Some(match answer {
        Answer::UploadExpedited { object: target, size, data } => {
            let bytes = data.to_le_bytes();
            let bytes = bytes.get(..usize::from(size)).unwrap_or(&bytes);
            format!("SDO read response {} = {}", object(target, kind), value(target, bytes, kind))
        }
        Answer::UploadInitiated { object: target, size } => {
            let size = (bytes[0] & 1 != 0).then_some(size);
            format!("SDO read response {}, {}", object(target, kind), in_segments(size))
        }
        Answer::UploadSegment(part) => format!("SDO read response, {}", segment(&part)),
        Answer::DownloadDone(target) => format!("SDO write response {}", object(target, kind)),
        Answer::DownloadSegmentDone { toggle } => format!("SDO write response, segment, toggle {}", u8::from(toggle)),
        Answer::Abort(target, code) => abort(&object(target, kind), code),
    })
}

/// Explains a message that controls a block transfer (CiA 301 7.2.4.3.9 to 7.2.4.3.16), which the simulated devices
/// refuse. The module `block` explains the segments.
fn block(bytes: &[u8; 8], kind: Option<Kind>, from: Party) -> Option<String> {
    let &[command, a, b, ..] = bytes;
    let target = || object(multiplexer(bytes), kind);
    let [five, six] = match from {
        Party::Client => ["read", "write"],
        Party::Server => ["write response", "read response"],
    };
    Some(match (command >> 5, command & 0b11) {
        (5, 0) => format!("SDO block {five} {}, blocks of {}", target(), bytes[4]),
        (5, 1) => format!("SDO block {five}, end"),
        (5, 2) => format!("SDO block {five}, received up to segment {a}, next block of {b}"),
        (5, 3) if from == Party::Client => "SDO block read, start".to_owned(),
        (6, 1 | 3) => format!("SDO block {six}, end"),
        (6, _) => format!("SDO block {six} {}{}", target(), block_size(bytes)),
        _ => return None,
    })
}

fn multiplexer(&[_, low, high, sub, ..]: &[u8; 8]) -> Multiplexer {
    Multiplexer { index: u16::from_le_bytes([low, high]), sub }
}

/// Formats the size of a block transfer; empty unless bit 1 of the command indicates a size.
fn block_size(&[command, .., a, b, c, d]: &[u8; 8]) -> String {
    let told = command & 0b10 != 0;
    if told { format!(", {} bytes", u32::from_le_bytes([a, b, c, d])) } else { String::new() }
}

fn in_segments(size: Option<u32>) -> String {
    size.map_or("in segments".to_owned(), |size| format!("{size} bytes in segments"))
}

fn segment(part: &Segment) -> String {
    let last = if part.last { "last segment" } else { "segment" };
    let bytes = if part.bytes().is_empty() { "without data".to_owned() } else { text_or_hex(part.bytes()) };
    format!("{last} {bytes}, toggle {}", u8::from(part.toggle))
}

fn abort(object: &str, code: AbortCode) -> String {
    // Abort codes that the simulated devices never send (CiA 301 table 22).
    let meaning = match code.0 {
        0x0504_0002 => "invalid block size",
        0x0504_0003 => "invalid sequence number",
        0x0504_0004 => "CRC error",
        0x0601_0000 => "unsupported access",
        0x0604_0043 => "parameter incompatibility",
        0x0604_0047 => "internal incompatibility in the device",
        0x0609_0036 => "maximum below minimum",
        0x060A_0023 => "resource not available",
        0x0800_0000 => "general error",
        0x0800_0021 => "local control",
        0x0800_0023 => "no object dictionary",
        _ => code.meaning(),
    };
    format!("SDO abort {object}: {meaning} (0x{:08X})", code.0)
}
