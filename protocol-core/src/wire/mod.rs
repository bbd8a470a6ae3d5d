//! Encoding and decoding of messages, one file each. All functions are total and have no state.
//!
//! Parsers accept any bytes. They keep unknown codes as values, or return `None`.

pub mod cob_id;
pub mod decimal;
pub mod emcy;
pub mod lss;
pub mod nmt;
pub mod pdo_mapping;
pub mod sdo;

pub mod dm;
pub mod dtc;
pub mod j1939_id;
pub mod name;
pub mod request;
pub mod tp;
pub mod valve;

pub mod uds;

/// Decodes the little-endian number in `bytes[at..at + 4]`.
#[inline]
pub(crate) const fn u32_at(bytes: &[u8; 8], at: u32) -> u32 {
    let word = u64::from_le_bytes(*bytes).unbounded_shr(at.saturating_mul(8)) & 0xFFFF_FFFF;
    word as u32
}
