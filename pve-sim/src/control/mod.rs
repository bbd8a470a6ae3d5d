//! The world's side of the control interface: executes messages, and monitors the world for clients that wait or
//! follow the events.
//!
//! The world executes each message at the virtual instant of its arrival. Each answer describes a single instant. The
//! server never waits for a client.

pub(crate) mod events;
mod server;

pub(crate) use server::ControlServer;

use std::fmt;

use hal_sim::campaign::Verdict;
use hal_sim::simulation::{BusState, Command, Excerpt, Refusal, Reply};
use hal_sim::state::{DeviceState, FaultRecord};
use protocol_core::time::Instant;
use serde::{Deserialize, Serialize};
use tokio::sync::oneshot;
use utoipa::ToSchema;

use events::Subscription;

/// The last instant of a run: 584 years, the range of the bus time in 64-bit nanoseconds, less one day in which pending
/// frames can end.
pub(crate) const LAST: Instant = Instant::from_ticks(u64::MAX / 1000 - 86_400_000_000);

/// A message to the world, with the sender of the answer.
#[derive(Debug)]
pub enum Message {
    /// Executes a command; answers with its reply.
    Execute(Command, Answer<Reply>),
    /// Reads the states of all devices.
    Devices(Answer<Vec<DeviceState>>),
    /// Reads the state of a device.
    Device(String, Answer<DeviceState>),
    /// Reads the state of the bus.
    Bus(Answer<BusState>),
    /// Reads the communication faults.
    Faults(Answer<Vec<FaultRecord>>),
    /// Reads the virtual time.
    Time(Answer<Time>),
    /// Reads the verdict on the judged cell.
    Cell(Answer<JudgedCell>),
    /// Reads the latest frames and errors, up to this number.
    Trace(usize, Answer<Excerpt>),
    /// Subscribes to all future events.
    Subscribe(Answer<Subscription>),
}

/// The sender of an answer to a client.
pub type Answer<T> = oneshot::Sender<Result<T, Refusal>>;

/// The speed of virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
#[schema(as = SpeedValue)]
pub enum Speed {
    /// The ratio of virtual time to wall time.
    Factor(f64),
    /// Time advances only by `POST /time`.
    Step(StepWord),
}

/// The word for stepped time in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StepWord {
    /// `"step"`
    Step,
}

impl Speed {
    /// Stepped time.
    pub const STEP: Self = Self::Step(StepWord::Step);

    /// Returns the ratio of virtual time to wall time; 1 for stepped time.
    pub(crate) const fn factor(self) -> f64 {
        match self {
            Self::Factor(factor) => factor,
            Self::Step(_) => 1.0,
        }
    }
}

/// The form of `--speed`.
impl fmt::Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Factor(factor) => write!(f, "{factor}"),
            Self::Step(_) => f.write_str("step"),
        }
    }
}

/// The judged cell of a campaign.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JudgedCell {
    /// Whether the verdict is final.
    pub decided: bool,
    /// The virtual time by which the cell is decided, in microseconds.
    pub until_us: u64,
    /// The verdict, once it is final.
    pub result: Option<Judged>,
}

/// The verdict on a cell. Times are in microseconds after the fault; null if the reaction did not occur.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Judged {
    /// The verdict, as in docs/campaigns.md.
    #[schema(value_type = String)]
    pub verdict: Verdict,
    /// The time from the fault to its detection.
    pub detected_us: Option<u64>,
    /// The time from the fault to the safe state.
    pub safe_us: Option<u64>,
    /// The number of frames that a communication fault affected; 1 for any other fault once it has acted.
    pub struck: u64,
    /// The reason for the verdict not-injected if the proof of detection held before the fault.
    pub reason: Option<String>,
}

/// The virtual time.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Time {
    /// The virtual time, in microseconds since the start.
    pub now_us: u64,
    /// The speed: the ratio of virtual time to wall time, or `"step"`.
    pub speed: Speed,
}
