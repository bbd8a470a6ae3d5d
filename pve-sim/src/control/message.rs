//! The messages of the control interface to the world, and their answers.

use protocol_core::time::Duration;
use serde::Serialize;
use tokio::sync::oneshot;
use utoipa::ToSchema;

use super::events::Subscription;
use hal_sim::simulation::{BusState, Command, Excerpt, Refusal, Reply};
use hal_sim::state::DeviceState;

/// A message to the world. Each takes effect at the virtual instant of its arrival, and its answer tells of one
/// instant.
#[derive(Debug)]
pub enum Message {
    /// A command; answers what came of it.
    Execute(Command, Answer<Reply>),
    /// The states of all devices.
    Devices(Answer<Vec<DeviceState>>),
    /// The state of a device.
    Device(String, Answer<DeviceState>),
    /// The state of the bus.
    Bus(Answer<BusState>),
    /// The virtual time.
    Time(Answer<Time>),
    /// Lets virtual time pass, where it is stepped.
    Advance(Duration, Answer<Time>),
    /// The last frames, so many at most.
    Trace(usize, Answer<Excerpt>),
    /// What happens from now on.
    Subscribe(Answer<Subscription>),
}

/// The way of an answer back to the client.
#[derive(Debug)]
pub struct Answer<T>(oneshot::Sender<Result<T, Refusal>>);

/// The virtual time.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Time {
    /// In microseconds since the start.
    pub now_us: u64,
    /// How fast it passes: a factor against wall time, or `"step"`.
    pub speed: SpeedValue,
}

/// A speed of virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum SpeedValue {
    /// A factor against wall time.
    Factor(f64),
    /// Time moves only when told.
    Step(StepWord),
}

/// The word for time that moves only when told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StepWord {
    /// `"step"`
    Step,
}

impl<T> Answer<T> {
    /// Returns the way, and its end.
    #[must_use]
    pub fn new() -> (Self, oneshot::Receiver<Result<T, Refusal>>) {
        let (sender, receiver) = oneshot::channel();
        (Self(sender), receiver)
    }

    /// Sends the answer. A client that is gone gets nothing.
    pub(crate) fn send(self, answer: Result<T, Refusal>) {
        let _ = self.0.send(answer);
    }

    /// Returns whether the client is gone.
    pub(crate) fn is_given_up(&self) -> bool {
        self.0.is_closed()
    }
}
