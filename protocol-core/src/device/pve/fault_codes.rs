//! How the faults are told on the wire: one table (SPEC 3).

use crate::actuator::{Fault, FaultSet};

/// How one fault is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultCodes {
    /// The fault.
    pub fault: Fault,
    /// The object that holds its occurrence counter (A).
    pub object: u16,
    /// The emergency error code.
    pub emcy: u16,
    /// What it contributes to the error register, 0x1001.
    pub register: u8,
}

/// All faults, by priority.
pub const FAULT_CODES: [FaultCodes; 8] = [
    // (R) 0x21, not 0x81: the bit table has no bit 7 there
    FaultCodes { fault: Fault::SpoolNotAtSetPoint, object: 0x201D, emcy: 0x8305, register: 0x21 },
    FaultCodes { fault: Fault::FloatNotReached, object: 0x201D, emcy: 0x8305, register: 0x21 },
    FaultCodes { fault: Fault::Internal, object: 0x2024, emcy: 0x1000, register: 0x01 },
    FaultCodes { fault: Fault::CanBus, object: 0x2019, emcy: 0x8140, register: 0x11 },
    FaultCodes { fault: Fault::Temperature, object: 0x200F, emcy: 0x8301, register: 0x09 },
    FaultCodes { fault: Fault::SupplyHigh, object: 0x2001, emcy: 0x3411, register: 0x05 },
    FaultCodes { fault: Fault::SupplyLow, object: 0x2002, emcy: 0x3412, register: 0x05 },
    // (R) 0x91: the bit table has no generic bit there, the object table and CiA 301 have
    FaultCodes { fault: Fault::TimeGuarding, object: 0x2023, emcy: 0x8003, register: 0x91 },
];

/// The second index of the internal error's counter (R): the EDS list says 0x2040, the object table 0x2024.
pub(super) const INTERNAL_ALIAS: u16 = 0x2040;

/// The codes of a fault.
pub(super) fn codes(fault: Fault) -> FaultCodes {
    let [first, ..] = FAULT_CODES;
    FAULT_CODES.into_iter().find(|codes| codes.fault == fault).unwrap_or(first)
}

/// The fault whose counter an object holds.
pub(super) fn fault_of(object: u16) -> Option<Fault> {
    let object = if object == INTERNAL_ALIAS { codes(Fault::Internal).object } else { object };
    FAULT_CODES.iter().find(|codes| codes.object == object).map(|codes| codes.fault)
}

/// The error register: what the active faults contribute together.
pub(super) fn register(active: FaultSet) -> u8 {
    active.into_iter().fold(0, |register, fault| register | codes(fault).register)
}
