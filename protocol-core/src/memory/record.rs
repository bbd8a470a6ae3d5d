//! A record of the memory: its key, and its encoding with version, length and CRC.
//!
//! The log in the flash keeps each record complete, old or new (SPEC 6). The CRC detects flipped bits. A record that
//! does not open counts as absent, and raises the internal error.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use heapless::Vec;

/// The maximum size of a sealed record. The parameters have the longest payload.
pub const RECORD_MAX: usize = 128;

/// The bytes of a sealed record.
pub type Record = Vec<u8, RECORD_MAX>;

/// The number of bytes before the payload: version and length.
const HEADER: usize = 2;
const CRC_LEN: usize = 4;
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// The key of a record in the memory (SPEC 6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum RecordKey {
    /// Identity, NAME function instance, numbers and date. They are written once, at the first start.
    Factory = 1,
    /// Node ID or address, and bit rate.
    LocalLayer = 2,
    /// The parameters that "save" stores; for a sensor, only the communication parameters.
    Parameters = 3,
    /// The restore flag. If it is set, the next start restores the defaults.
    RestoreFlag = 4,
    /// The occurrence counters. The previously active faults follow from them.
    FaultLog = 5,
    /// The application parameters that "save" stores in a sensor.
    Application = 6,
}

impl RecordKey {
    /// All keys, in ascending order.
    pub const ALL: [Self; 6] =
        [Self::Factory, Self::LocalLayer, Self::Parameters, Self::RestoreFlag, Self::FaultLog, Self::Application];

    /// Returns the position of the key in [`ALL`](Self::ALL).
    #[must_use]
    pub const fn position(self) -> usize {
        (self as usize).saturating_sub(1)
    }
}

/// The error for a failed write of the memory, and for a payload that does not fit a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreError;

/// Begins a record. The caller appends the payload, then [completes](complete) the record.
#[must_use]
pub fn begin(version: u8) -> Record {
    Record::from_array([version, 0])
}

/// Completes a record with its length and CRC.
///
/// # Errors
/// Returns [`StoreError`] if length and CRC do not fit.
pub fn complete(record: &mut Record) -> Result<(), StoreError> {
    let [_, len, payload @ ..] = record.as_mut_slice() else { return Err(StoreError) };
    *len = u8::try_from(payload.len()).map_err(|_| StoreError)?;
    let crc = CRC.checksum(record).to_le_bytes();
    record.extend_from_slice(&crc).map_err(|_| StoreError)
}

/// Encodes a payload as a record with version, length and CRC.
///
/// # Errors
/// Returns [`StoreError`] for a payload that does not fit.
pub fn seal(version: u8, payload: &[u8]) -> Result<Record, StoreError> {
    let mut record = begin(version);
    record.extend_from_slice(payload).map_err(|_| StoreError)?;
    complete(&mut record)?;
    Ok(record)
}

/// Returns the payload of a record; `None` if version, length or CRC is wrong.
#[must_use]
pub fn open(version: u8, record: &[u8]) -> Option<&[u8]> {
    let (body, crc) = record.split_at_checked(record.len().checked_sub(CRC_LEN)?)?;
    let (header, payload) = body.split_at_checked(HEADER)?;
    let intact = CRC.checksum(body).to_le_bytes() == crc
        && header.first() == Some(&version)
        && header.last().map(|len| usize::from(*len)) == Some(payload.len());
    intact.then_some(payload)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_sealed_opens() {
        let record = seal(3, b"payload").unwrap();
        assert_eq!(record.len(), HEADER + 7 + CRC_LEN);
        assert_eq!(open(3, &record), Some(&b"payload"[..]));
        assert_eq!(open(1, &seal(1, b"").unwrap()), Some(&b""[..]));
    }

    #[test]
    fn another_version_or_a_cut_record_does_not_open() {
        let record = seal(3, b"payload").unwrap();
        assert_eq!(open(2, &record), None);
        for len in 0..record.len() {
            assert_eq!(open(3, &record[..len]), None);
        }
    }

    #[test]
    fn no_single_flipped_bit_opens() {
        let record = seal(1, b"\x20\x03").unwrap();
        for bit in 0..record.len() * 8 {
            let mut rotten = record.clone();
            rotten[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(open(1, &rotten), None, "bit {bit}");
        }
    }

    #[test]
    fn a_payload_that_is_too_long_is_refused() {
        assert_eq!(seal(1, &[0; RECORD_MAX]), Err(StoreError));
        assert_eq!(seal(1, &[0; 300]), Err(StoreError));
    }
}
