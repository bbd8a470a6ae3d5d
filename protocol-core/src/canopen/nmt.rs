//! NMT slave (CiA 301 7.3.2): the communication state, and what a command does to it.

use crate::outcome::Outcome;
use crate::wire::nmt::{Command, State};

/// The rules of a product for entering a state by itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// The values that 0x1F80 takes.
    pub(crate) startup: &'static [u32],
    /// The one that starts the node after the boot-up.
    pub(crate) starts_itself: Option<u32>,
}

impl Rules {
    /// The rules of a product without such objects.
    pub(crate) const NONE: Self = Self { startup: &[], starts_itself: None };
}

/// The effect of an error on the NMT state: object 0x1029.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum ErrorBehaviour {
    /// Operational becomes pre-operational.
    #[default]
    PreOperational = 0,
    /// Nothing.
    NoChange = 1,
    /// Operational becomes stopped.
    Stopped = 2,
}

impl ErrorBehaviour {
    /// Returns the behaviour of a value; `None` for one that CiA 301 reserves.
    #[must_use]
    pub(crate) const fn new(raw: u8) -> Option<Self> {
        match raw {
            0 => Some(Self::PreOperational),
            1 => Some(Self::NoChange),
            2 => Some(Self::Stopped),
            _ => None,
        }
    }

    /// Returns the state that an error in operational leads to.
    #[must_use]
    pub(crate) const fn state(self) -> Option<State> {
        match self {
            Self::PreOperational => Some(State::PreOperational),
            Self::NoChange => None,
            Self::Stopped => Some(State::Stopped),
        }
    }
}

/// The scope of a reset that an NMT master demands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reset {
    /// Reset communication.
    Communication,
    /// Reset application.
    Application,
}

impl Reset {
    /// Returns the reset that a command demands.
    #[must_use]
    pub(crate) const fn of(command: Command) -> Option<Self> {
        match command {
            Command::ResetCommunication => Some(Self::Communication),
            Command::ResetApplication => Some(Self::Application),
            Command::Start | Command::Stop | Command::EnterPreOperational => None,
        }
    }
}

/// The NMT state of a node.
#[derive(Clone, Debug)]
pub(crate) struct NmtSlave {
    state: State,
}

impl NmtSlave {
    /// Returns a node that initialises.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { state: State::Initialising }
    }

    /// Returns the state.
    #[inline]
    #[must_use]
    pub(crate) const fn state(&self) -> State {
        self.state
    }

    /// Enters pre-operational at the end of initialisation.
    pub(crate) const fn boot(&mut self) {
        self.state = State::PreOperational;
    }

    /// Enters a state by itself. Returns whether it was another one.
    pub(crate) fn enter(&mut self, state: State) -> bool {
        core::mem::replace(&mut self.state, state) != state
    }

    /// Executes a command: done is the state that was entered. A node that still initialises executes none.
    pub(crate) fn execute(&mut self, command: Command) -> Outcome<State, Reset> {
        let entered = match command {
            _ if self.state == State::Initialising => return Outcome::Nothing,
            Command::Start => State::Operational,
            Command::Stop => State::Stopped,
            Command::EnterPreOperational => State::PreOperational,
            Command::ResetApplication => return Outcome::Demand(Reset::Application),
            Command::ResetCommunication => return Outcome::Demand(Reset::Communication),
        };
        if self.enter(entered) { Outcome::Done(entered) } else { Outcome::Nothing }
    }

    /// Returns whether SDOs and EMCYs are served: everywhere but in stopped and before the boot-up (CiA 301 table 38).
    #[inline]
    #[must_use]
    pub(crate) const fn serves(&self) -> bool {
        matches!(self.state, State::PreOperational | State::Operational)
    }

    /// Returns whether PDOs are exchanged.
    #[inline]
    #[must_use]
    pub(crate) const fn is_operational(&self) -> bool {
        matches!(self.state, State::Operational)
    }
}
