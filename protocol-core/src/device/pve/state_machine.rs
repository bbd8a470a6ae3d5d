//! The device state machine of CiA 408, without the states NOT_READY, FAULT and FAULT_REACTION (SPEC 4.3).

/// A state of the device state machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceState {
    /// INIT: initialised, not enabled.
    #[default]
    Init,
    /// DISABLED: the valve is disabled.
    Disabled,
    /// HOLD: the valve holds neutral.
    Hold,
    /// DEVICE_MODE_ACTIVE: the device mode is in force.
    Active,
    /// FAULT_HOLD: a fault or another event has shut the valve down.
    FaultHold,
}

impl DeviceState {
    /// All states.
    pub const ALL: [Self; 5] = [Self::Init, Self::Disabled, Self::Hold, Self::Active, Self::FaultHold];

    /// Returns the status word, 0x6041. Its bits 3…0 are ready, mode active enabled, hold activated and disabled.
    #[must_use]
    pub const fn status_word(self) -> u16 {
        match self {
            Self::Init => 0x08,
            Self::Disabled => 0x09,
            Self::Hold => 0x0B,
            Self::Active => 0x0F,
            Self::FaultHold => 0x03,
        }
    }
}

/// The device mode, 0x6042.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum DeviceMode {
    /// The valve follows set-points.
    #[default]
    FullOperational = 1,
    /// The hand lever moves the spool.
    HandOperation = 2,
}

impl DeviceMode {
    /// Decodes a value of 0x6042; `None` for a value other than 1 and 2.
    #[must_use]
    pub const fn new(raw: u8) -> Option<Self> {
        match raw {
            1 => Some(Self::FullOperational),
            2 => Some(Self::HandOperation),
            _ => None,
        }
    }
}

/// The bits 3…0 of a control word: reset, mode active, hold, disabled.
const COMMAND_MASK: u16 = 0x0F;
/// The two consecutive control words that lead from FAULT_HOLD to HOLD. (R) In a use case of the manual they lead to
/// ACTIVE.
const RESET_FIRST: u16 = 0b0011;
const RESET_SECOND: u16 = 0b1011;

/// The state of the machine, and the progress of leaving FAULT_HOLD.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateMachine {
    state: DeviceState,
    /// Whether the last control word in FAULT_HOLD was 0011.
    reset_begun: bool,
}

impl StateMachine {
    pub(super) const fn new() -> Self {
        Self { state: DeviceState::Init, reset_begun: false }
    }

    pub(super) const fn state(self) -> DeviceState {
        self.state
    }

    /// Applies a control word. It causes at most one transition, D2–D7 or D11.
    pub(super) fn control(&mut self, word: u16, fault_active: bool) {
        let command = word & COMMAND_MASK;
        let disabled = command & 0b0001 != 0;
        let hold = command & 0b0010 != 0;
        let mode_active = command & 0b0100 != 0;
        let reset_begun = core::mem::take(&mut self.reset_begun);
        self.state = match self.state {
            DeviceState::Init if disabled => DeviceState::Disabled,
            DeviceState::Disabled if disabled && hold => DeviceState::Hold,
            DeviceState::Disabled if command & 0b0111 == 0 => DeviceState::Init,
            DeviceState::Hold if disabled && hold && mode_active => DeviceState::Active,
            DeviceState::Hold if !mode_active && !hold => DeviceState::Disabled,
            DeviceState::Active if !mode_active => DeviceState::Hold,
            DeviceState::FaultHold if command == RESET_SECOND && reset_begun && !fault_active => DeviceState::Hold,
            DeviceState::FaultHold => {
                self.reset_begun = command == RESET_FIRST;
                DeviceState::FaultHold
            }
            unchanged => unchanged,
        };
    }

    /// Enters or re-enters FAULT_HOLD, for transition D8 or another event that shuts the valve down.
    pub(super) const fn shut_down(&mut self) {
        *self = Self { state: DeviceState::FaultHold, reset_begun: false };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All transitions of SPEC 4.3: the low bits of every control word, from every state.
    #[test]
    fn control_words_over_all_states() {
        use DeviceState::{Active, Disabled, FaultHold, Hold, Init};
        for command in 0..=0b1111_u16 {
            for upper in [0, 0xFFF0] {
                let next = |state| {
                    let mut machine = StateMachine { state, reset_begun: false };
                    machine.control(command | upper, false);
                    machine.state()
                };
                let (d, h, m) = (command & 1 != 0, command & 2 != 0, command & 4 != 0);
                assert_eq!(next(Init), if d { Disabled } else { Init });
                let from_disabled = if d && h {
                    Hold
                } else if !d && !h && !m {
                    Init
                } else {
                    Disabled
                };
                assert_eq!(next(Disabled), from_disabled, "{command:04b}");
                let from_hold = if d && h && m {
                    Active
                } else if !h && !m {
                    Disabled
                } else {
                    Hold
                };
                assert_eq!(next(Hold), from_hold, "{command:04b}");
                assert_eq!(next(Active), if m { Active } else { Hold });
                assert_eq!(next(FaultHold), FaultHold);
            }
        }
    }

    fn from_fault_hold(words: &[(u16, bool)]) -> DeviceState {
        let mut machine = StateMachine::new();
        machine.shut_down();
        for (word, fault_active) in words {
            machine.control(*word, *fault_active);
        }
        machine.state()
    }

    #[test]
    fn the_way_out_of_fault_hold() {
        assert_eq!(from_fault_hold(&[(0x03, false), (0x0B, false)]), DeviceState::Hold);
        // 0011 counts even while a fault is active.
        assert_eq!(from_fault_hold(&[(0x03, true), (0x0B, false)]), DeviceState::Hold);
        // 1011 has no effect while a fault is active.
        assert_eq!(from_fault_hold(&[(0x03, false), (0x0B, true), (0x0B, false)]), DeviceState::FaultHold);
        assert_eq!(from_fault_hold(&[(0x0B, false)]), DeviceState::FaultHold);
        assert_eq!(from_fault_hold(&[(0x03, false), (0x0F, false), (0x0B, false)]), DeviceState::FaultHold);
        assert_eq!(from_fault_hold(&[(0x03, false), (0x03, false), (0x0B, false)]), DeviceState::Hold);
    }
}
