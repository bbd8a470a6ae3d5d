//! The messages from the control interface to the world, and the return path of the answers.

use protocol_core::time::Duration;
use serde::Serialize;
use tokio::sync::oneshot;
use utoipa::ToSchema;

use super::events::Subscription;
use hal_sim::simulation::{BusState, Command, Excerpt, Refusal, Reply};
use hal_sim::state::{DeviceState, FaultRecord};

/// A message to the world. The message takes effect at the virtual instant of its arrival, and the answer describes
/// a single instant.
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
    /// Advances stepped virtual time.
    Advance(Duration, Answer<Time>),
    /// Reads the latest frames, up to this number.
    Trace(usize, Answer<Excerpt>),
    /// Subscribes to all future events.
    Subscribe(Answer<Subscription>),
}

/// The sender of an answer to a client.
#[derive(Debug)]
pub struct Answer<T>(oneshot::Sender<Result<T, Refusal>>);

/// The virtual time.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Time {
    /// The virtual time, in microseconds since the start.
    pub now_us: u64,
    /// The speed: a factor against wall time, or `"step"`.
    pub speed: SpeedValue,
}

/// The speed of virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum SpeedValue {
    /// A factor of wall time.
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

impl<T> Answer<T> {
    /// Creates a sender for one answer, and its receiver.
    #[must_use]
    pub fn new() -> (Self, oneshot::Receiver<Result<T, Refusal>>) {
        let (sender, receiver) = oneshot::channel();
        (Self(sender), receiver)
    }

    /// Sends the answer, unless the client has disconnected.
    pub(crate) fn send(self, answer: Result<T, Refusal>) {
        let _ = self.0.send(answer);
    }

    /// Returns whether the client has disconnected.
    pub(crate) fn is_given_up(&self) -> bool {
        self.0.is_closed()
    }
}
