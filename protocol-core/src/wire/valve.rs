//! Auxiliary valve command (AVC) and auxiliary valve estimated flow (AVEF) (ISO 11783-7; SPEC 5).

use super::j1939_id::{Address, J1939Id, Pgn, Priority};
use crate::frame::Frame;

/// The maximum port flow command: 100 % in steps of 0.4 %.
pub const MAX_FLOW: u8 = 250;

/// The reserved bits 6–5 of the third byte, sent as 1.
const RESERVED: u8 = 0b0011_0000;

/// The value of reserved bytes.
const FILL: u8 = 0xFF;

/// The state of a valve: bits 4–1 of the third byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// The valve is closed, and its spool is in neutral.
    Blocked = 0,
    /// Flow from the extend port.
    Extend = 1,
    /// Flow from the retract port.
    Retract = 2,
    /// Both ports are open to tank.
    Float = 3,
    /// The hand lever moves the spool.
    HandOperation = 10,
    /// Emergency stop.
    EmergencyStop = 14,
}

impl State {
    /// All states.
    pub const ALL: [Self; 6] =
        [Self::Blocked, Self::Extend, Self::Retract, Self::Float, Self::HandOperation, Self::EmergencyStop];

    /// Decodes the low four bits; `None` for a state that is not in the manual.
    #[inline]
    #[must_use]
    pub const fn from_bits(bits: u8) -> Option<Self> {
        match bits & 0xF {
            0 => Some(Self::Blocked),
            1 => Some(Self::Extend),
            2 => Some(Self::Retract),
            3 => Some(Self::Float),
            10 => Some(Self::HandOperation),
            14 => Some(Self::EmergencyStop),
            _ => None,
        }
    }
}

/// The command in an AVC. A flow is a port flow command, 0–[`MAX_FLOW`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Close the valve.
    Block,
    /// Flow from the extend port.
    Extend(u8),
    /// Flow from the retract port.
    Retract(u8),
    /// Open both ports to tank.
    Float,
    /// Leave the spool to the hand lever.
    HandOperation,
    /// Emergency stop.
    EmergencyStop,
}

/// The reason why an entire AVC is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ignored {
    /// The length is not eight bytes.
    Length,
    /// The fail-safe mode (bits 8–7 of the third byte) has this value, 1 or 2, instead of "blocked" or "not available".
    FailSafeMode(u8),
    /// The state is not in the manual.
    State(u8),
    /// The port flow command of extend or retract is above [`MAX_FLOW`].
    Flow(u8),
}

/// Returns whether a command may have this fail-safe mode (A): 0 "blocked", or 3 "not available".
const fn is_fail_safe_mode(mode: u8) -> bool {
    matches!(mode, 0b00 | 0b11)
}

impl Command {
    /// Decodes the data of an AVC.
    ///
    /// # Errors
    /// Returns the reason for ignoring the command.
    #[inline]
    pub fn parse(data: &[u8]) -> Result<Self, Ignored> {
        let &[flow, _, state, _, _, _, _, _] = data else { return Err(Ignored::Length) };
        let fail_safe_mode = state >> 6;
        if !is_fail_safe_mode(fail_safe_mode) {
            return Err(Ignored::FailSafeMode(fail_safe_mode));
        }
        match State::from_bits(state).ok_or(Ignored::State(state & 0xF))? {
            State::Extend | State::Retract if flow > MAX_FLOW => Err(Ignored::Flow(flow)),
            State::Blocked => Ok(Self::Block),
            State::Extend => Ok(Self::Extend(flow)),
            State::Retract => Ok(Self::Retract(flow)),
            State::Float => Ok(Self::Float),
            State::HandOperation => Ok(Self::HandOperation),
            State::EmergencyStop => Ok(Self::EmergencyStop),
        }
    }

    /// Encodes the data of an AVC. A command without a flow gets the port flow command 0.
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let flow = match self {
            Self::Extend(flow) | Self::Retract(flow) => flow,
            _ => 0,
        };
        [flow, FILL, RESERVED | self.state() as u8, FILL, FILL, FILL, FILL, FILL]
    }

    /// Encodes the frame `0CFE3xyy`: x is the low four bits of the valve's address, yy the source.
    #[must_use]
    pub fn frame(self, valve: Address, source: Address) -> Frame {
        Frame::full(J1939Id::global(Priority::CONTROL, Pgn::avc(valve.get()), source).id(), self.emit())
    }

    /// Returns the commanded state.
    #[inline]
    #[must_use]
    pub const fn state(self) -> State {
        match self {
            Self::Block => State::Blocked,
            Self::Extend(_) => State::Extend,
            Self::Retract(_) => State::Retract,
            Self::Float => State::Float,
            Self::HandOperation => State::HandOperation,
            Self::EmergencyStop => State::EmergencyStop,
        }
    }

    /// Returns whether the command is neutral: block, or a flow of 0.
    #[inline]
    #[must_use]
    pub const fn is_neutral(self) -> bool {
        matches!(self, Self::Block | Self::Extend(0) | Self::Retract(0))
    }
}

/// The raw value of a flow of 0 %.
const FLOW_OFFSET: u8 = 125;

/// The maximum estimated flow, in percent.
pub const MAX_PERCENT: u8 = 100;

/// The data of an AVEF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EstimatedFlow {
    /// Flow from the extend port, in percent. Values above [`MAX_PERCENT`] are sent as [`MAX_PERCENT`].
    pub extend: u8,
    /// Flow from the retract port, in percent. Values above [`MAX_PERCENT`] are sent as [`MAX_PERCENT`].
    pub retract: u8,
    /// The state of the valve.
    pub state: State,
}

impl EstimatedFlow {
    /// Decodes the data of an AVEF; `None` for a length other than eight, a flow outside 0–100 % or an unknown state.
    #[must_use]
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[extend, retract, state, _, _, _, _, _] = data else { return None };
        let percent = |flow: u8| flow.checked_sub(FLOW_OFFSET).filter(|percent| *percent <= MAX_PERCENT);
        Some(Self { extend: percent(extend)?, retract: percent(retract)?, state: State::from_bits(state)? })
    }

    /// Encodes the data of an AVEF. The fail-safe mode, bits 8–7 of the third byte, is 0: blocked.
    #[inline]
    #[must_use]
    pub const fn emit(self) -> [u8; 8] {
        let state = RESERVED | self.state as u8;
        [flow(self.extend), flow(self.retract), state, FILL, FILL, FILL, FILL, FILL]
    }

    /// Encodes the frame `0CFE1xyy`: yy is the valve's address, x its low four bits.
    #[inline]
    #[must_use]
    pub fn frame(self, valve: Address) -> Frame {
        Frame::full(J1939Id::global(Priority::CONTROL, Pgn::avef(valve.get()), valve).id(), self.emit())
    }
}

/// Encodes a flow of 0–100 %; higher flows are limited to 100 %.
const fn flow(percent: u8) -> u8 {
    FLOW_OFFSET.saturating_add(if percent > MAX_PERCENT { MAX_PERCENT } else { percent })
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    const MASTER: Address = Address::new(0x27);
    const VALVE: Address = Address::new(0x83);

    #[test]
    fn commands_by_the_bit_tables() {
        for (command, text) in [
            (Command::Block, "0CFE3327: 00 FF 30 FF FF FF FF FF"),
            (Command::Extend(125), "0CFE3327: 7D FF 31 FF FF FF FF FF"),
            (Command::Retract(250), "0CFE3327: FA FF 32 FF FF FF FF FF"),
            (Command::Float, "0CFE3327: 00 FF 33 FF FF FF FF FF"),
            (Command::HandOperation, "0CFE3327: 00 FF 3A FF FF FF FF FF"),
            (Command::EmergencyStop, "0CFE3327: 00 FF 3E FF FF FF FF FF"),
        ] {
            assert_eq!(command.frame(VALVE, MASTER).to_string(), text);
            assert_eq!(Command::parse(&command.emit()), Ok(command));
        }
    }

    /// Checks every first and third byte against the rules of SPEC 5, in the opposite order.
    #[test]
    fn every_reason_to_ignore_a_command() {
        for flow in 0..=u8::MAX {
            for state in 0..=u8::MAX {
                let expected = match (state >> 6, state & 0xF, flow) {
                    (mode @ (1 | 2), _, _) => Err(Ignored::FailSafeMode(mode)),
                    (_, 0, _) => Ok(Command::Block),
                    (_, 1 | 2, 251..) => Err(Ignored::Flow(flow)),
                    (_, 1, _) => Ok(Command::Extend(flow)),
                    (_, 2, _) => Ok(Command::Retract(flow)),
                    (_, 3, _) => Ok(Command::Float),
                    (_, 10, _) => Ok(Command::HandOperation),
                    (_, 14, _) => Ok(Command::EmergencyStop),
                    (_, unknown, _) => Err(Ignored::State(unknown)),
                };
                for rest in [0x00, 0x5A, 0xFF] {
                    let data = [flow, rest, state, rest, rest, rest, rest, rest];
                    assert_eq!(Command::parse(&data), expected, "{data:02X?}");
                }
            }
        }
    }

    #[test]
    fn another_length_is_ignored() {
        let data = Command::Extend(10).emit();
        for len in 0..8 {
            assert_eq!(Command::parse(&data[..len]), Err(Ignored::Length));
        }
    }

    #[test]
    fn neutral_is_blocked_or_no_flow() {
        for command in [Command::Block, Command::Extend(0), Command::Retract(0)] {
            assert!(command.is_neutral(), "{command:?}");
        }
        for command in
            [Command::Extend(1), Command::Retract(1), Command::Float, Command::HandOperation, Command::EmergencyStop]
        {
            assert!(!command.is_neutral(), "{command:?}");
        }
    }

    #[test]
    fn flows_by_the_bit_tables() {
        for (extend, retract, state, text) in [
            (0, 0, State::Blocked, "0CFE1383: 7D 7D 30 FF FF FF FF FF"),
            (100, 0, State::Extend, "0CFE1383: E1 7D 31 FF FF FF FF FF"),
            (0, 50, State::Retract, "0CFE1383: 7D AF 32 FF FF FF FF FF"),
            (100, 0, State::Float, "0CFE1383: E1 7D 33 FF FF FF FF FF"),
            (0, 0, State::HandOperation, "0CFE1383: 7D 7D 3A FF FF FF FF FF"),
            (0, 0, State::EmergencyStop, "0CFE1383: 7D 7D 3E FF FF FF FF FF"),
        ] {
            let flow = EstimatedFlow { extend, retract, state };
            assert_eq!(flow.frame(VALVE).to_string(), text);
            assert_eq!(EstimatedFlow::parse(&flow.emit()), Some(flow));
        }
    }

    #[test]
    fn a_flow_stays_within_100_percent() {
        let flow = EstimatedFlow { extend: 101, retract: 255, state: State::Blocked };
        assert_eq!(flow.emit()[..2], [0xE1, 0xE1]);
        for byte in (0..125).chain(226..=255) {
            assert_eq!(EstimatedFlow::parse(&[byte, 0x7D, 0x30, 0, 0, 0, 0, 0]), None);
            assert_eq!(EstimatedFlow::parse(&[0x7D, byte, 0x30, 0, 0, 0, 0, 0]), None);
        }
        assert_eq!(EstimatedFlow::parse(&[0x7D, 0x7D, 0x34, 0, 0, 0, 0, 0]), None);
        assert_eq!(EstimatedFlow::parse(&[0x7D; 7]), None);
    }

    #[test]
    fn every_state_has_its_bits() {
        for state in State::ALL {
            assert_eq!(State::from_bits(0xF0 | state as u8), Some(state));
        }
        assert_eq!((0..16).filter_map(State::from_bits).count(), State::ALL.len());
    }
}
