//! NMT slave (CiA 301 7.3.2): the communication state, and what an order does to it.

use crate::wire::nmt::{Command, State};

/// What an order of the NMT master comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Nothing changes.
    Nothing,
    /// The state has changed.
    Entered {
        /// The state before.
        from: State,
        /// The state now.
        to: State,
    },
    /// The device is to restart its communication.
    ResetCommunication,
    /// The device is to restart.
    ResetApplication,
}

/// The NMT state of a node.
#[derive(Debug, Default)]
pub struct NmtSlave {
    state: State,
}

impl NmtSlave {
    /// The state.
    #[inline]
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Initialisation has ended: pre-operational.
    pub const fn boot(&mut self) {
        self.state = State::PreOperational;
    }

    /// Obeys an order. A node that still initialises obeys none.
    pub fn obey(&mut self, command: Command) -> Order {
        let from = self.state;
        if from == State::Initialising {
            return Order::Nothing;
        }
        let to = match command {
            Command::Start => State::Operational,
            Command::Stop => State::Stopped,
            Command::EnterPreOperational => State::PreOperational,
            Command::ResetApplication => return Order::ResetApplication,
            Command::ResetCommunication => return Order::ResetCommunication,
        };
        self.state = to;
        if from == to { Order::Nothing } else { Order::Entered { from, to } }
    }

    /// Whether SDOs and EMCYs are served: everywhere but in stopped and before the boot-up (CiA 301 table 38).
    #[inline]
    #[must_use]
    pub const fn serves(&self) -> bool {
        matches!(self.state, State::PreOperational | State::Operational)
    }

    /// Whether PDOs are exchanged.
    #[inline]
    #[must_use]
    pub const fn is_operational(&self) -> bool {
        matches!(self.state, State::Operational)
    }
}
