//! LSS fast scan, the slave's side (CiA 305 6.4.5; SPEC 4.4).

use crate::wire::lss::{Address, FastScan, Part};

/// The bit-check value of a request that starts a scan. Every slave without a node ID answers this request.
const START_SCAN: u8 = 0x80;

/// The progress of a scan: the part of the LSS address that the next request must compare.
///
/// The serial number is the last part. With its request a standard master announces part 0 as the next part; the
/// manual's sequence announces part 4. In both cases a new scan can begin with part 0.
#[derive(Clone, Debug)]
pub(super) struct ScanPosition {
    part: Part,
}

impl ScanPosition {
    pub(super) const fn new() -> Self {
        Self { part: 0 }
    }

    /// Updates the position for a request. Returns whether the slave with this LSS address answers the request.
    pub(super) fn answers(&mut self, scan: FastScan, address: &Address) -> bool {
        if scan.bit_check == START_SCAN {
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
