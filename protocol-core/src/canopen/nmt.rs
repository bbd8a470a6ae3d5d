//! NMT slave (CiA 301 7.3.2): the communication state, and what a command does to it.

use crate::outcome::Outcome;
use crate::wire::nmt::{Command, State};

/// The scope of a reset that an NMT master demands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// Reset communication.
    Communication,
    /// Reset application.
    Application,
}

impl Reset {
    /// Returns the reset that a command demands.
    #[must_use]
    pub const fn of(command: Command) -> Option<Self> {
        match command {
            Command::ResetCommunication => Some(Self::Communication),
            Command::ResetApplication => Some(Self::Application),
            Command::Start | Command::Stop | Command::EnterPreOperational => None,
        }
    }
}

/// The NMT state of a node.
#[derive(Debug, Default)]
pub struct NmtSlave {
    state: State,
}

impl NmtSlave {
    /// Returns a node that initialises.
    #[must_use]
    pub const fn new() -> Self {
        Self { state: State::Initialising }
    }

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

    /// Obeys a command: done is the state that was entered. A node that still initialises obeys none.
    pub fn obey(&mut self, command: Command) -> Outcome<State, Reset> {
        let entered = match command {
            _ if self.state == State::Initialising => return Outcome::Nothing,
            Command::Start => State::Operational,
            Command::Stop => State::Stopped,
            Command::EnterPreOperational => State::PreOperational,
            Command::ResetApplication => return Outcome::Demand(Reset::Application),
            Command::ResetCommunication => return Outcome::Demand(Reset::Communication),
        };
        if core::mem::replace(&mut self.state, entered) == entered { Outcome::Nothing } else { Outcome::Done(entered) }
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
