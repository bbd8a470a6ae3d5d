//! Faults, and the J1939-73 diagnostic messages that list them (SPEC 3).

use protocol_core::actuator::Fault;
use protocol_core::device::pve::FAULT_CODES;
use protocol_core::wire::dm::{self, Lamp};
use protocol_core::wire::dtc::Dtc;

/// Returns the description of a fault.
pub const fn fault(fault: Fault) -> &'static str {
    match fault {
        Fault::SpoolNotAtSetPoint => "spool not at set-point",
        Fault::FloatNotReached => "float not reached",
        Fault::Internal => "internal error",
        Fault::CanBus => "CAN bus error",
        Fault::Temperature => "temperature",
        Fault::SupplyHigh => "supply too high",
        Fault::SupplyLow => "supply too low",
        Fault::TimeGuarding => "time guarding",
    }
}

/// Explains a single-frame DM1 or DM2. `none` is the text for a message without faults.
pub(super) fn troubles(data: &[u8], none: &str) -> Option<String> {
    let (lamp, troubles) = dm::parse(data)?;
    let troubles: Vec<String> = troubles.map(|(dtc, count)| format!("{}, count {count}", trouble(dtc))).collect();
    let list = if troubles.is_empty() { none.to_owned() } else { troubles.join("; ") };
    Some(format!("{list}, {}", lamp_name(lamp)))
}

fn trouble(dtc: Dtc) -> String {
    let known = FAULT_CODES.iter().find(|codes| codes.dtc == dtc).map(|codes| fault(codes.fault));
    let numbers = format!("SPN {} FMI {}", dtc.spn(), dtc.fmi());
    known.map_or(numbers.clone(), |name| format!("{name} ({numbers})"))
}

fn lamp_name(lamp: Lamp) -> String {
    match lamp {
        Lamp::OFF => "lamp off".to_owned(),
        Lamp::AMBER => "amber lamp".to_owned(),
        Lamp::RED => "red lamp".to_owned(),
        lamp => format!("lamps 0x{:02X}", lamp.get()),
    }
}
