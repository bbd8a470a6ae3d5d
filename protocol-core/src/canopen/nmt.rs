//! The NMT slave (CiA 301 7.3.2): the NMT state, and the effect of commands on it.

use crate::outcome::Outcome;
use crate::wire::nmt::{Command, State};

/// A product's rules for the automatic start, object 0x1F80.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// The valid values of 0x1F80.
    pub(crate) startup: &'static [u32],
    /// The value of 0x1F80 with which the node enters operational by itself after boot-up.
    pub(crate) starts_itself: Option<u32>,
}

impl Rules {
    /// The rules of a product without 0x1F80.
    pub(crate) const NONE: Self = Self { startup: &[], starts_itself: None };
}

/// The effect of an error on the NMT state, object 0x1029.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum ErrorBehaviour {
    /// Operational changes to pre-operational.
    #[default]
    PreOperational = 0,
    /// The NMT state does not change.
    NoChange = 1,
    /// Operational changes to stopped.
    Stopped = 2,
}

impl ErrorBehaviour {
    /// Decodes a value of 0x1029; `None` for a value that CiA 301 reserves.
    #[must_use]
    pub(crate) const fn new(raw: u8) -> Option<Self> {
        match raw {
            0 => Some(Self::PreOperational),
            1 => Some(Self::NoChange),
            2 => Some(Self::Stopped),
            _ => None,
        }
    }

    /// Returns the state that follows operational after an error; `None` for no change.
    #[must_use]
    pub(crate) const fn state(self) -> Option<State> {
        match self {
            Self::PreOperational => Some(State::PreOperational),
            Self::NoChange => None,
            Self::Stopped => Some(State::Stopped),
        }
    }
}

/// The scope of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reset {
    /// Reset communication: the communication objects.
    Communication,
    /// Reset application: the entire device.
    Application,
}

impl Reset {
    /// Returns the reset that a command requests; `None` for other commands.
    #[must_use]
    pub(crate) const fn of(command: Command) -> Option<Self> {
        match command {
            Command::ResetCommunication => Some(Self::Communication),
            Command::ResetApplication => Some(Self::Application),
            Command::Start | Command::Stop | Command::EnterPreOperational => None,
        }
    }
}

/// The NMT slave, which holds the NMT state of a node.
#[derive(Clone, Debug)]
pub(crate) struct NmtSlave {
    state: State,
}

impl NmtSlave {
    /// Creates a slave in initialisation.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { state: State::Initialising }
    }

    /// Returns the NMT state.
    #[inline]
    #[must_use]
    pub(crate) const fn state(&self) -> State {
        self.state
    }

    /// Enters pre-operational after initialisation.
    pub(crate) const fn boot(&mut self) {
        self.state = State::PreOperational;
    }

    /// Enters a state without a command. Returns whether the state changed.
    pub(crate) fn enter(&mut self, state: State) -> bool {
        core::mem::replace(&mut self.state, state) != state
    }

    /// Executes a command. Returns the new state or the requested reset. Initialisation ignores all commands.
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

    /// Returns whether the state permits SDO and EMCY (CiA 301 table 38).
    #[inline]
    #[must_use]
    pub(crate) const fn serves(&self) -> bool {
        matches!(self.state, State::PreOperational | State::Operational)
    }

    /// Returns whether the state is operational, which permits PDOs.
    #[inline]
    #[must_use]
    pub(crate) const fn is_operational(&self) -> bool {
        matches!(self.state, State::Operational)
    }
}
