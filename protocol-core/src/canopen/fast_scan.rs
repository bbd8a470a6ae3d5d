//! LSS fast scan, the slave's side (CiA 305 6.4.5; SPEC 4.4).

use crate::wire::lss::{Address, FastScan, Part};

/// The bit-check value that starts a scan; every unconfigured slave answers it.
const WHO_IS_THERE: u8 = 0x80;

/// The progress of a scan: the part of the LSS address expected next.
///
/// After the serial number a standard master sends 0 as the next part; the sequence in the manual sends 4, which is not
/// a valid part. In both cases the next scan begins with part 0.
#[derive(Clone, Debug)]
pub(super) struct ScanPosition {
    part: Part,
}

impl ScanPosition {
    /// Returns the position at the start of a scan.
    pub(super) const fn new() -> Self {
        Self { part: 0 }
    }

    /// Updates the position for a request. Returns whether the slave with this LSS address answers the request.
    pub(super) fn answers(&mut self, scan: FastScan, address: &Address) -> bool {
        if scan.bit_check == WHO_IS_THERE {
            self.part = 0;
            return true;
        }
        if scan.bit_check > 31 {
            return false;
        }
        if scan.sub == 0 {
            self.part = 0;
        }
        let Some(own) = address.part(self.part).filter(|_| scan.sub == self.part) else { return false };
        let agrees = (own ^ scan.number).unbounded_shr(u32::from(scan.bit_check)) == 0;
        if agrees && scan.bit_check == 0 {
            self.part = scan.next;
        }
        agrees
    }
}
