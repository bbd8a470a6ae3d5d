//! LSS fast scan, the slave's side (CiA 305 6.4.5; SPEC 4.4).

use crate::wire::lss::{Address, FastScan, Part};

/// The bit check that asks who is there.
const WHO_IS_THERE: u8 = 0x80;
/// The last of the four numbers: the serial number.
const LAST_PART: Part = 3;
/// What the manual's sequence names as next after the last number; a standard master names 0.
const MANUALS_END: u8 = 4;

/// How far a scan has come.
#[derive(Debug, Default)]
pub(super) struct ScanPosition {
    part: Part,
}

impl ScanPosition {
    /// Whether the slave with this address answers the question.
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
            let ends = self.part == LAST_PART && scan.next == MANUALS_END;
            self.part = if ends { 0 } else { scan.next };
        }
        agrees
    }
}
