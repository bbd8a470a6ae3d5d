//! The bus codes of the faults (SPEC 3).

use crate::actuator::{Fault, FaultSet};
use crate::wire::dm::Lamp;
use crate::wire::dtc::Dtc;

/// The codes of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultCodes {
    /// The fault.
    pub fault: Fault,
    /// The emergency error code.
    pub emcy: u16,
    /// The bits of the fault in the error register, 0x1001.
    pub register: u8,
    /// The trouble code. (R) The manual prints the three bytes on the bus in reverse order, and so does this table.
    pub dtc: Dtc,
    /// The lamp in DM1 and DM2.
    pub lamp: Lamp,
}

const fn row(fault: Fault, emcy: u16, register: u8, dtc: u32, lamp: Lamp) -> FaultCodes {
    FaultCodes { fault, emcy, register, dtc: Dtc::from_printed(dtc), lamp }
}

/// The codes of all faults, in order of priority.
pub const FAULT_CODES: [FaultCodes; 8] = [
    // (R) The register is 0x21, not 0x81, because the bit table has no bit 7 for this fault.
    row(Fault::SpoolNotAtSetPoint, 0x8305, 0x21, 0x87_8FEC, Lamp::RED),
    row(Fault::FloatNotReached, 0x8305, 0x21, 0x87_8FEE, Lamp::RED),
    row(Fault::Internal, 0x1000, 0x01, 0x8B_8FFA, Lamp::RED),
    row(Fault::CanBus, 0x8140, 0x11, 0x93_8FD7, Lamp::AMBER),
    // (R) One table of the older manual prints 0xE0F185 in place of 0x908FF1.
    row(Fault::Temperature, 0x8301, 0x09, 0x90_8FF1, Lamp::AMBER),
    row(Fault::SupplyHigh, 0x3411, 0x05, 0x03_0273, Lamp::AMBER),
    row(Fault::SupplyLow, 0x3412, 0x05, 0x04_0273, Lamp::AMBER),
    // (R) The register is 0x91. The bit table lacks the generic bit, but the object table and CiA 301 have it.
    row(Fault::TimeGuarding, 0x8003, 0x91, 0x93_8FE9, Lamp::AMBER),
];

/// Returns the codes of a fault.
pub(super) fn codes(fault: Fault) -> &'static FaultCodes {
    const ROWS: &[FaultCodes; 8] = &FAULT_CODES;
    let [first, ..] = ROWS;
    ROWS.get(fault.index()).unwrap_or(first)
}

/// Returns the error register, which combines the bits of the active faults.
pub(super) fn register(active: FaultSet) -> u8 {
    active.into_iter().fold(0, |register, fault| register | codes(fault).register)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fault_has_its_row() {
        assert!(Fault::ALL.into_iter().all(|fault| codes(fault).fault == fault));
    }
}
