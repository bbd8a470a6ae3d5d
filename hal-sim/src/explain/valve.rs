//! Valve data common to PDOs and objects: control word, status word, set-point and position (SPEC 4.3).

use protocol_core::device::pve::DeviceState;

/// The scale of set-points and positions: ±100 %.
const FULL: i16 = 16_384;
/// The value of a set-point or position that stands for float.
const FLOAT: i16 = 32_767;

/// Returns the command in the low four bits of a control word: reset, mode active, hold and disabled (SPEC 4.3).
pub(super) const fn command(word: u16) -> &'static str {
    match word & 0x0F {
        0b0000 | 0b1000 => "initialise",
        0b0001 | 0b1001 => "disable",
        0b0011 => "hold, fault reset 1 of 2",
        0b1011 => "hold, fault reset 2 of 2",
        0b0111 | 0b1111 => "activate",
        _ => "unusual",
    }
}

/// Returns the state indicated by a status word.
pub(super) fn state(word: u16) -> &'static str {
    match DeviceState::ALL.into_iter().find(|state| state.status_word() == word) {
        Some(DeviceState::Init) => "INIT",
        Some(DeviceState::Disabled) => "DISABLED",
        Some(DeviceState::Hold) => "HOLD",
        Some(DeviceState::Active) => "ACTIVE",
        Some(DeviceState::FaultHold) => "FAULT_HOLD",
        None => "unknown state",
    }
}

/// Formats a set-point or position in percent, or as float.
pub(super) fn stroke(raw: i16) -> String {
    match raw {
        FLOAT => "float".to_owned(),
        0 => "neutral".to_owned(),
        raw if (-FULL..=FULL).contains(&raw) => format!("{:+.1} %", f64::from(raw) * 100.0 / f64::from(FULL)),
        raw => format!("{raw}, out of range"),
    }
}
