//! The event stream of the control interface: sends frames, errors and device changes to its clients, the followers.

use std::sync::Arc;

use protocol_core::device::View;
use protocol_core::time::{Duration, Instant, NEVER, after};
use serde::Serialize;
use tokio::sync::broadcast;

use hal_sim::Kind;
use hal_sim::explain::Explainer;
use hal_sim::simulation::{Happened, Refusal, Simulation, TraceRecord};
use hal_sim::state::{DeviceState, PlantState};
use hal_sim::world::{NodeId, World};

/// The queue capacity of a follower: about a second of a fully loaded bus. A slower follower loses the oldest events.
const WAITING: usize = 4096;

/// The maximum number of followers.
pub(crate) const FOLLOWERS: usize = 64;

/// The wall-time interval between reports of a changing position.
const SAMPLE: Duration = Duration::from_millis(20);

/// An event, shared by all followers.
#[derive(Debug)]
pub(crate) struct ControlEvent {
    pub(crate) name: &'static str,
    pub(crate) json: String,
}

/// Serialises a value as JSON, which cannot fail for the types of this interface.
pub(crate) fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// A follower's subscription: the device states when the follower subscribes, and all later events.
#[derive(Debug)]
pub struct Subscription {
    /// The device states at the instant of the subscription.
    pub(crate) states: Vec<DeviceState>,
    /// The later events. The follower counts as connected until this receiver is dropped.
    pub(crate) events: broadcast::Receiver<Arc<ControlEvent>>,
}

/// Sends events to the followers.
#[derive(Debug)]
pub(crate) struct Events {
    channel: broadcast::Sender<Arc<ControlEvent>>,
    /// The last reported state of each device.
    reported: Vec<(NodeId, Kind, Reported)>,
    /// The next position-sample time.
    sample_at: Instant,
    /// The position-sample interval, in virtual time.
    sample: Duration,
}

/// The last reported state of a device.
#[derive(Clone, Debug, PartialEq)]
struct Reported {
    view: Option<View>,
    plant: PlantState,
}

impl Events {
    /// Creates an event stream without followers; `speed` is the factor of virtual time.
    pub(crate) fn new(speed: f64, simulation: &mut Simulation) -> Self {
        let devices = simulation.devices().to_vec();
        let world = simulation.world_mut();
        let reported = devices.into_iter().map(|(node, kind)| (node, kind, Reported::of(node, world))).collect();
        let sample = Duration::from_ticks((SAMPLE.as_micros() as f64 * speed.max(1.0)) as u64);
        Self { channel: broadcast::Sender::new(WAITING), reported, sample_at: world.now(), sample }
    }

    pub(crate) fn subscribe(&mut self, simulation: &mut Simulation) -> Result<Subscription, Refusal> {
        if self.channel.receiver_count() >= FOLLOWERS {
            return Err(Refusal::TooMany("too many clients of the event stream"));
        }
        // Existing followers receive pending changes first; without followers, the reported states are reset.
        self.poll(simulation);
        if !self.is_followed() {
            let world = simulation.world_mut();
            self.reported.iter_mut().for_each(|(node, _, reported)| *reported = Reported::of(*node, world));
        }
        Ok(Subscription { states: simulation.states(), events: self.channel.subscribe() })
    }

    pub(crate) fn is_followed(&self) -> bool {
        self.channel.receiver_count() > 0
    }

    /// Sends a bus event together with its meaning from `explainer`.
    pub(crate) fn show(&self, happened: &Happened, explainer: &Explainer) {
        if !self.is_followed() {
            return;
        }
        match happened.record(explainer) {
            Some(TraceRecord::Frame(frame)) => tell(&self.channel, "frame", &frame),
            Some(TraceRecord::Error(error)) => tell(&self.channel, "error", &error),
            None => {}
        }
    }

    /// Sends the states of changed devices to the followers. A device whose only changes are continuous, such as the
    /// position, is sent only at sample times.
    pub(crate) fn poll(&mut self, simulation: &mut Simulation) {
        if !self.is_followed() {
            return;
        }
        let world = simulation.world_mut();
        let samples = world.now() >= self.sample_at;
        if samples {
            self.sample_at = after(world.now(), self.sample);
        }
        let Self { reported, channel, .. } = self;
        for (node, kind, reported) in reported {
            let now = Reported::of(*node, world);
            let changed = if samples { now != *reported } else { now.at_rest() != reported.at_rest() };
            if changed {
                *reported = now;
                tell(channel, "device", &DeviceState::of(*node, *kind, world));
            }
        }
    }

    /// Returns the next position-sample time.
    pub(crate) fn due(&self) -> Instant {
        if self.is_followed() { self.sample_at } else { NEVER }
    }
}

/// Sends an event to all followers, if there are any.
fn tell(channel: &broadcast::Sender<Arc<ControlEvent>>, name: &'static str, data: &impl Serialize) {
    let _ = channel.send(Arc::new(ControlEvent { name, json: json(data) }));
}

impl Reported {
    fn of(node: NodeId, world: &mut World) -> Self {
        Self { view: world.view(node), plant: PlantState::of(node, world) }
    }

    /// Returns the state for comparisons: position and shaft angle, which change continuously, are 0.
    fn at_rest(&self) -> Self {
        let view = self.view.clone().map(|view| View { position: 0, ..view });
        Self { view, plant: self.plant.at_rest() }
    }
}
