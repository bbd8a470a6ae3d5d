//! NMT commands, boot-up and heartbeat (CiA 301 7.2.8).

use super::cob_id::{Function, NodeId};
use crate::frame::Frame;

/// A command from an NMT master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Enter operational.
    Start = 0x01,
    /// Enter stopped.
    Stop = 0x02,
    /// Enter pre-operational.
    EnterPreOperational = 0x80,
    /// Restart the application and the communication.
    ResetApplication = 0x81,
    /// Restart the communication only.
    ResetCommunication = 0x82,
}

impl Command {
    /// All commands.
    pub const ALL: [Self; 5] =
        [Self::Start, Self::Stop, Self::EnterPreOperational, Self::ResetApplication, Self::ResetCommunication];
}

/// The target of an NMT command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// All nodes.
    All,
    /// A single node.
    Node(NodeId),
}

/// Decodes an NMT frame; `None` for a length other than two, an unknown command, or a node ID above 127.
#[must_use]
pub fn parse(data: &[u8]) -> Option<(Command, Target)> {
    let &[specifier, node] = data else { return None };
    let command = Command::ALL.into_iter().find(|command| *command as u8 == specifier)?;
    let target = if node == 0 { Target::All } else { Target::Node(NodeId::new(node)?) };
    Some((command, target))
}

/// An NMT state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Initialising, before the boot-up message.
    #[default]
    Initialising,
    /// Pre-operational: all services except PDOs.
    PreOperational,
    /// Operational: all services, PDOs included.
    Operational,
    /// Stopped: the only permitted CiA 301 services are NMT and error control.
    Stopped,
}

impl State {
    /// All states.
    pub const ALL: [Self; 4] = [Self::Initialising, Self::PreOperational, Self::Operational, Self::Stopped];

    /// Returns the code of the state in a heartbeat. The code of [`Initialising`](Self::Initialising) marks the boot-up
    /// message.
    #[inline]
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Initialising => 0x00,
            Self::Stopped => 0x04,
            Self::Operational => 0x05,
            Self::PreOperational => 0x7F,
        }
    }

    /// Returns the state with this code in a heartbeat; `None` for an unknown code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.code() == code)
    }
}

/// Encodes a heartbeat, or in [`State::Initialising`] the boot-up: `700+ID: state`.
#[must_use]
pub fn heartbeat(node: NodeId, state: State) -> Frame {
    Frame::with_len(node.id(Function::Heartbeat).into(), [state.code(), 0, 0, 0, 0, 0, 0, 0], 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_as_the_manual_prints_them() {
        let node = NodeId::new(0x10).unwrap();
        assert_eq!(parse(&[0x01, 0x00]), Some((Command::Start, Target::All)));
        assert_eq!(parse(&[0x02, 0x10]), Some((Command::Stop, Target::Node(node))));
        assert_eq!(parse(&[0x80, 0x10]), Some((Command::EnterPreOperational, Target::Node(node))));
        assert_eq!(parse(&[0x81, 0x00]), Some((Command::ResetApplication, Target::All)));
        assert_eq!(parse(&[0x82, 0x00]), Some((Command::ResetCommunication, Target::All)));
    }

    #[test]
    fn other_lengths_commands_and_nodes_are_none() {
        for data in [&[][..], &[1], &[1, 0, 0], &[3, 0], &[0x83, 0], &[1, 0x80]] {
            assert_eq!(parse(data), None, "{data:02X?}");
        }
    }

    #[test]
    fn heartbeats_as_the_manual_prints_them() {
        let node = NodeId::new(0x20).unwrap();
        assert_eq!(heartbeat(node, State::Initialising), Frame::of(node.id(Function::Heartbeat).into(), &[0]).unwrap());
        assert_eq!(heartbeat(node, State::PreOperational).data(), [0x7F]);
        for state in State::ALL {
            assert_eq!(State::from_code(state.code()), Some(state));
        }
        assert_eq!(State::from_code(1), None);
    }
}
