//! What can be asked of a simulation, and what comes of it.

use protocol_core::controller::BitRate;
use protocol_core::frame::{Frame, Id};
use protocol_core::time::Duration;
use serde::Serialize;
use utoipa::ToSchema;

use super::bus::BusState;
use super::history::FrameRecord;
use crate::bus::Disturbance;
use crate::state::{Condition, DeviceState, PlantChange, Power};
use crate::world::PlantError;

/// A command to a simulation. It takes effect at the instant at which the simulation is.
#[derive(Clone, Debug)]
pub enum Command {
    /// Changes what acts on the device of this name: all of it, or nothing. Comes to [`Reply::Device`].
    Plant(String, PlantChange),
    /// Switches the device of this name. Comes to [`Reply::Device`].
    Power(String, Power),
    /// Changes the bit rate of the bus and of all its clients. Comes to [`Reply::Bus`].
    BitRate(BitRate),
    /// Destroys the next frames, in the place of an earlier such command. Comes to [`Reply::Bus`].
    Disturb(Disturbance),
    /// Sends a frame; with a period again and again, in the place of an earlier one of that identifier. Comes to
    /// [`Reply::Sent`] when the first one is on the bus, or is refused after a second.
    Send(Frame, Option<Duration>),
    /// Ends the cyclic frames of an identifier, or all. Comes to [`Reply::Stopped`].
    Stop(Option<Id>),
    /// Waits until a condition holds, so long at most. Comes to [`Reply::Device`] or [`Reply::Frame`].
    Wait(Condition, Duration),
    /// Lets time pass. Comes to [`Reply::Advanced`].
    Advance(Duration),
}

/// What came of a command.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Reply {
    /// The device after it, or at the first instant at which the condition held.
    Device(Box<DeviceState>),
    /// The bus after it.
    Bus(BusState),
    /// A frame was sent.
    Sent(Sent),
    /// Cyclic frames were ended.
    Stopped(Stopped),
    /// The frame that was waited for.
    Frame(FrameRecord),
    /// Time has passed.
    Advanced(Advanced),
}

/// A frame was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Sent {
    /// Its end, in microseconds of virtual time.
    pub t_us: u64,
}

/// Cyclic frames were ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Stopped {
    /// How many.
    pub stopped: usize,
}

/// Time has passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Advanced {
    /// The virtual time, in microseconds since the start.
    pub now_us: u64,
}

/// A command that takes time, by its number in one simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub(super) u64);

/// How far a command has come.
#[derive(Clone, Debug, PartialEq)]
pub enum Executed {
    /// To its end.
    Done(Reply),
    /// It takes time: [`Simulation::take_completed`](super::Simulation::take_completed) tells its end.
    Pending(Ticket),
}

/// Why a command was refused; nothing has changed then.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// There is no such device.
    #[error("no device '{name}'; there are: {known}")]
    UnknownDevice {
        /// The name.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// What acts on the device cannot be so.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// A value that cannot be.
    #[error("{0}")]
    Invalid(String),
    /// Not as things are now.
    #[error("{0}")]
    Conflict(String),
    /// A condition did not hold in time.
    #[error("{}", .0.error)]
    TimedOut(Box<TimedOut>),
    /// More of it than there is room for.
    #[error("{0}")]
    TooMany(&'static str),
}

/// A condition did not hold in time.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct TimedOut {
    /// What did not happen.
    pub error: String,
    /// The end of the time, in microseconds of virtual time.
    pub t_us: u64,
    /// The state of the device then; null when a frame was waited for.
    #[schema(required)]
    pub state: Option<DeviceState>,
}

impl Command {
    /// Returns whether time has to pass for the command to come to its end.
    #[must_use]
    pub const fn takes_time(&self) -> bool {
        matches!(self, Self::Send(..) | Self::Wait(..) | Self::Advance(_))
    }
}
