//! The commands to a simulation, and their replies.

use protocol_core::controller::BitRate;
use protocol_core::frame::{Frame, Id};
use protocol_core::time::Duration;
use serde::Serialize;
use utoipa::ToSchema;

use super::bus::BusState;
use super::history::FrameRecord;
use crate::bus::{Disturbance, Fault, FaultError};
use crate::state::{Condition, DeviceState, FaultRecord, PlantChange, Power};
use crate::world::PlantError;

/// A command to a simulation, executed at the current virtual time.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Command {
    /// Changes the plant of the named device. Applies all changes or none. Returns [`Reply::Device`].
    Plant(String, PlantChange),
    /// Switches the power of the named device. Returns [`Reply::Device`].
    Power(String, Power),
    /// Changes the bit rate of the bus and of all its clients. Returns [`Reply::Bus`].
    BitRate(BitRate),
    /// Destroys the next attempts to send a frame. Replaces any earlier disturbance. Returns [`Reply::Bus`].
    Disturb(Disturbance),
    /// Adds a communication fault. The default name is made of the kind and the identifier, plus a number if that name
    /// is in use. Returns [`Reply::Fault`].
    Fault(Fault),
    /// Ends the named communication fault, or all faults. Returns [`Reply::Faults`] with the ended faults.
    EndFaults(Option<String>),
    /// Sends a frame once or, with a period, cyclically. A cyclic frame replaces an earlier cyclic frame with the same
    /// identifier. Returns [`Reply::Sent`] when the first frame is sent or is held back by a communication fault. The
    /// command is refused if the frame is not sent within a second of virtual time.
    Send(Frame, Option<Duration>),
    /// Stops the cyclic frames with an identifier, or all if `None`. Returns [`Reply::Stopped`].
    Stop(Option<Id>),
    /// Waits for a condition, with a time limit. Returns [`Reply::Device`] or [`Reply::Frame`].
    Wait(Condition, Duration),
    /// Advances time. Returns [`Reply::Advanced`].
    Advance(Duration),
}

/// The reply to a command.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
#[non_exhaustive]
pub enum Reply {
    /// The device after the command, or at the first instant at which the condition held.
    Device(Box<DeviceState>),
    /// The bus after the command.
    Bus(BusState),
    /// The added communication fault.
    Fault(FaultRecord),
    /// The ended communication faults.
    Faults(Vec<FaultRecord>),
    /// The frame was sent.
    Sent(Sent),
    /// The cyclic frames were stopped.
    Stopped(Stopped),
    /// The awaited frame.
    Frame(FrameRecord),
    /// Time was advanced.
    Advanced(Advanced),
}

/// The reply to a sent frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Sent {
    /// The end of the frame, in microseconds of virtual time.
    pub t_us: u64,
}

/// The reply to stopped cyclic frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Stopped {
    /// The number of stopped cyclic frames.
    pub stopped: usize,
}

/// The reply to an advance of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Advanced {
    /// The virtual time, in microseconds since the start.
    pub now_us: u64,
}

/// The number of a pending command, unique in its simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub(super) u64);

/// The result of executing a command.
#[derive(Clone, Debug, PartialEq)]
pub enum Executed {
    /// The command has completed.
    Done(Reply),
    /// The command takes virtual time. [`Simulation::take_completed`](super::Simulation::take_completed) returns its
    /// result.
    Pending(Ticket),
}

/// The reason why a command was refused. A refused command has no effect.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// No device, or no communication fault, has this name.
    #[error("{0}")]
    Unknown(String),
    /// The plant change is refused.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// A value is invalid.
    #[error("{0}")]
    Invalid(String),
    /// The current state does not allow the command.
    #[error("{0}")]
    Conflict(String),
    /// The condition did not hold within the time limit.
    #[error("{}", .0.error)]
    TimedOut(Box<TimedOut>),
    /// A capacity is exhausted.
    #[error("{0}")]
    TooMany(&'static str),
}

/// The report of a condition that did not hold within the time limit.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct TimedOut {
    /// The condition that did not hold.
    pub error: String,
    /// The instant of the time limit, in microseconds of virtual time.
    pub t_us: u64,
    /// The state of the device at that instant; null for an awaited frame.
    #[schema(required)]
    pub state: Option<DeviceState>,
}

impl From<FaultError> for Refusal {
    fn from(error: FaultError) -> Self {
        match error {
            FaultError::TooMany | FaultError::Taken(_) => Self::Conflict(error.to_string()),
            error => Self::Invalid(error.to_string()),
        }
    }
}

impl Command {
    /// Returns whether the command needs virtual time to complete.
    #[must_use]
    pub const fn takes_time(&self) -> bool {
        matches!(self, Self::Send(..) | Self::Wait(..) | Self::Advance(_))
    }
}
