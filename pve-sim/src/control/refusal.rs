//! Refusals of the control interface.

use serde::Serialize;
use utoipa::ToSchema;

use hal_sim::sender::Unsent;
use hal_sim::state::{DeviceState, Invalid};

/// Why a message was refused; nothing has changed then.
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

impl From<Invalid> for Refusal {
    fn from(Invalid(reason): Invalid) -> Self {
        Self::Invalid(reason)
    }
}

impl From<Unsent> for Refusal {
    fn from(unsent: Unsent) -> Self {
        match unsent {
            Unsent::TooMany(reason) => Self::TooMany(reason),
            Unsent::Withdrawn(reason) => Self::Conflict(reason.to_owned()),
        }
    }
}
