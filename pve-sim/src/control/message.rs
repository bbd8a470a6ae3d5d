//! The messages of the control interface to the world, and their answers.

use protocol_core::controller::BitRate;
use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant};
use serde::Serialize;
use tokio::sync::oneshot;
use utoipa::ToSchema;

use super::events::Subscription;
use super::record::{Excerpt, FrameRecord};
use super::refusal::Refusal;
use hal_sim::bus::Disturbance;
use hal_sim::devices;
use hal_sim::sender::{Receipt, Unsent};
use hal_sim::state::{BitsPerSecond, Condition, DeviceState, PlantChange, Power};

/// A message to the world. Each takes effect at the virtual instant of its arrival, and its answer tells of one
/// instant.
#[derive(Debug)]
pub enum Message {
    /// The states of all devices.
    Devices(Answer<Vec<DeviceState>>),
    /// The state of a device.
    Device(String, Answer<DeviceState>),
    /// Changes what acts on a device; answers its state.
    Plant(String, PlantChange, Answer<DeviceState>),
    /// Switches a device; answers its state.
    Power(String, Power, Answer<DeviceState>),
    /// The state of the bus.
    Bus(Answer<BusState>),
    /// Changes the bit rate of the bus and of all its clients.
    BitRate(BitRate, Answer<BusState>),
    /// Destroys frames.
    Disturb(Disturbance, Answer<BusState>),
    /// Sends a frame, once or again and again; answers the instant of the first one's end.
    Send(Frame, Option<Duration>, Answer<Sent>),
    /// Ends cyclic frames: of one identifier, or all.
    Stop(Option<Id>, Answer<Stopped>),
    /// The virtual time.
    Time(Answer<Time>),
    /// Lets virtual time pass.
    Advance(Duration, Answer<Time>),
    /// Waits until a condition holds, so long at most.
    Wait(Condition, Duration, Answer<Waited>),
    /// The last frames, so many at most.
    Trace(usize, Answer<Excerpt>),
    /// What happens from now on.
    Subscribe(Answer<Subscription>),
}

/// The way of an answer back to the client.
#[derive(Debug)]
pub struct Answer<T>(oneshot::Sender<Result<T, Refusal>>);

/// The state of the bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct BusState {
    /// The instant of which all of it is true, in microseconds of virtual time.
    pub t_us: u64,
    /// The bit rate, in bit/s.
    #[schema(value_type = BitsPerSecond)]
    pub bit_rate: u32,
    /// How busy the bus was in the last second, in percent.
    pub load: u8,
    /// The frames that are going to be destroyed.
    pub disturb: DisturbState,
    /// The devices that run at another bit rate than the bus, and those that did for longer than a change takes.
    pub not_heard: Vec<NotHeard>,
}

/// A device that runs at another bit rate than the bus, or did: it cannot communicate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct NotHeard {
    /// The name of the device.
    pub device: String,
    /// The instant from which the rates differed, in microseconds of virtual time.
    pub t_us: u64,
    /// True once the two rates agree again.
    pub is_over: bool,
    /// The sentence with cause and remedy.
    pub reason: String,
}

impl From<devices::NotHeard> for NotHeard {
    fn from(devices::NotHeard { device, since, is_over, reason }: devices::NotHeard) -> Self {
        Self { device, t_us: since.as_micros(), is_over, reason }
    }
}

/// Frames that are going to be destroyed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct DisturbState {
    /// The number of attempts.
    pub frames: u32,
    /// Their identifier; null: any.
    #[schema(required, maximum = 536870911)]
    pub id: Option<u32>,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
}

/// A frame was on the bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Sent {
    /// Its end, in microseconds of virtual time.
    pub t_us: u64,
}

/// Cyclic frames were ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Stopped {
    /// How many.
    pub stopped: usize,
}

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

/// A condition holds.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Waited {
    /// The device, at the first instant.
    Device(Box<DeviceState>),
    /// The frame.
    Frame(FrameRecord),
}

impl Receipt for Answer<Sent> {
    fn tell(self, sent: Result<Instant, Unsent>) {
        self.send(sent.map(|end| Sent { t_us: end.as_micros() }).map_err(Refusal::from));
    }

    fn is_given_up(&self) -> bool {
        self.is_given_up()
    }
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
