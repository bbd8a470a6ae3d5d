//! The LED (SPEC 2).

use super::fault::{Fault, FaultSet};

/// A colour of the LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Color {
    /// Green: healthy.
    Green,
    /// Yellow: disabled.
    Yellow,
    /// Red: faulty.
    Red,
}

/// The state of the LED. The platform flashes the LED at 1.5 Hz: 333 ms on, 333 ms off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Led {
    /// The colour.
    pub color: Color,
    /// Whether the LED flashes.
    pub flashing: bool,
}

/// The part of the valve's state that the LED indicates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Condition {
    /// The active faults.
    pub faults: FaultSet,
    /// Whether a fault has shut regulation down. The shutdown lasts until the protocol ends it.
    pub fault_hold: bool,
    /// Whether regulation is disabled, for example by hand operation, an emergency stop, or a missing node ID or
    /// address.
    pub disabled: bool,
    /// Whether the solenoids are off to save power.
    pub power_save: bool,
}

impl Led {
    /// Constant green: healthy and actuating.
    pub const GREEN: Self = Self { color: Color::Green, flashing: false };
    /// Flashing green: power save.
    pub const GREEN_FLASHING: Self = Self { color: Color::Green, flashing: true };
    /// Constant yellow: disabled. Hold, hand operation and emergency stop count as disabled (A).
    pub const YELLOW: Self = Self { color: Color::Yellow, flashing: false };
    /// Constant red: bus-off (R), or the internal error as the active fault with the highest priority.
    pub const RED: Self = Self { color: Color::Red, flashing: false };
    /// Flashing red: another fault is the active fault with the highest priority.
    pub const RED_FLASHING: Self = Self { color: Color::Red, flashing: true };
    /// The indication of a shutdown that persists after its fault has cleared (A).
    pub const FAULT_HOLD: Self = Self::RED_FLASHING;

    /// Returns the LED state for a condition, by precedence: bus-off, the fault with the highest priority, fault hold,
    /// disabled, power save.
    #[must_use]
    pub fn of(condition: Condition) -> Self {
        let Condition { faults, fault_hold, disabled, power_save } = condition;
        if faults.contains(Fault::CanBus) {
            return Self::RED;
        }
        match faults.highest() {
            Some(Fault::Internal) => Self::RED,
            Some(_) => Self::RED_FLASHING,
            None if fault_hold => Self::FAULT_HOLD,
            None if disabled => Self::YELLOW,
            None if power_save => Self::GREEN_FLASHING,
            None => Self::GREEN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(faults: &[Fault]) -> Condition {
        // Also sets every condition of lower precedence; none of them may show.
        Condition { faults: faults.iter().copied().collect(), fault_hold: true, disabled: true, power_save: true }
    }

    #[test]
    fn the_first_that_applies_shows() {
        let healthy = Condition::default();
        let table = [
            (with(&[Fault::SpoolNotAtSetPoint, Fault::CanBus]), Color::Red, false),
            (with(&[Fault::CanBus]), Color::Red, false),
            (with(&[Fault::Internal]), Color::Red, false),
            (with(&[Fault::Internal, Fault::Temperature]), Color::Red, false),
            (with(&[Fault::SpoolNotAtSetPoint, Fault::Internal]), Color::Red, true),
            (with(&[Fault::FloatNotReached]), Color::Red, true),
            (with(&[Fault::Temperature]), Color::Red, true),
            (with(&[Fault::SupplyHigh]), Color::Red, true),
            (with(&[Fault::SupplyLow]), Color::Red, true),
            (with(&[Fault::TimeGuarding]), Color::Red, true),
            (with(&[]), Color::Red, true),
            (Condition { disabled: true, power_save: true, ..healthy }, Color::Yellow, false),
            (Condition { power_save: true, ..healthy }, Color::Green, true),
            (healthy, Color::Green, false),
        ];
        for (condition, color, flashing) in table {
            assert_eq!(Led::of(condition), Led { color, flashing }, "{condition:?}");
        }
    }
}
