//! SDO requests and answers (CiA 301 7.2.4).

use protocol_core::wire::sdo::{AbortCode, Answer, Request, Segment};

use super::object::{object, value};
use super::text_or_hex;
use crate::kind::Kind;

pub(super) fn request(bytes: &[u8; 8], kind: Option<Kind>) -> String {
    match Request::parse(bytes) {
        Request::InitiateUpload(target) => format!("SDO read {}", object(target, kind)),
        Request::UploadSegment { toggle } => format!("SDO read, next segment, toggle {}", u8::from(toggle)),
        Request::DownloadExpedited { object: target, size, data } => {
            let bytes = data.to_le_bytes();
            let bytes = bytes.get(..size.map_or(4, usize::from)).unwrap_or(&bytes);
            format!("SDO write {} = {}", object(target, kind), value(target, bytes, kind))
        }
        Request::InitiateDownload { object: target, size } => {
            format!("SDO write {}, {}", object(target, kind), in_segments(size))
        }
        Request::DownloadSegment(part) => format!("SDO write, {}", segment(&part)),
        Request::Abort(target, code) => abort(&object(target, kind), AbortCode(code)),
        Request::Unknown(_) => format!("SDO unknown command 0x{:02X}", bytes[0]),
    }
}

pub(super) fn answer(bytes: &[u8; 8], kind: Option<Kind>) -> Option<String> {
    Some(match Answer::parse(bytes)? {
        Answer::UploadExpedited { object: target, size, data } => {
            let bytes = data.to_le_bytes();
            let bytes = bytes.get(..usize::from(size)).unwrap_or(&bytes);
            format!("SDO answer {} = {}", object(target, kind), value(target, bytes, kind))
        }
        Answer::UploadInitiated { object: target, size } => {
            format!("SDO answer {}, {}", object(target, kind), in_segments(Some(size)))
        }
        Answer::UploadSegment(part) => format!("SDO answer, {}", segment(&part)),
        Answer::DownloadDone(target) => format!("SDO written {}", object(target, kind)),
        Answer::DownloadSegmentDone { toggle } => format!("SDO written, segment, toggle {}", u8::from(toggle)),
        Answer::Abort(target, code) => abort(&object(target, kind), code),
    })
}

fn in_segments(size: Option<u32>) -> String {
    size.map_or("in segments".to_owned(), |size| format!("{size} bytes in segments"))
}

fn segment(part: &Segment) -> String {
    let last = if part.last { "last segment" } else { "segment" };
    format!("{last} {}, toggle {}", text_or_hex(part.bytes()), u8::from(part.toggle))
}

fn abort(object: &str, code: AbortCode) -> String {
    format!("SDO abort {object}: {} (0x{:08X})", code.meaning(), code.0)
}
