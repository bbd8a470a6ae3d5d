//! The event stream of the control interface: sends frames, errors and device changes to its clients, the followers.

use std::sync::Arc;

use protocol_core::time::{Duration, Instant, NEVER, after};
use serde::Serialize;
use tokio::sync::broadcast;

use hal_sim::explain::Explainer;
use hal_sim::simulation::{Happened, Refusal, Simulation, TraceRecord};
use hal_sim::state::DeviceState;

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
    /// The last reported state of each device; empty before the first follower.
    reported: Vec<DeviceState>,
    /// The next position-sample time.
    sample_at: Instant,
    /// The position-sample interval, in virtual time.
    sample: Duration,
}

impl Events {
    /// Creates an event stream without followers; `speed` is the factor of virtual time.
    pub(crate) fn new(speed: f64) -> Self {
        let sample = Duration::from_ticks((SAMPLE.as_micros() as f64 * speed.max(1.0)) as u64);
        let sample_at = Instant::from_ticks(0);
        Self { channel: broadcast::Sender::new(WAITING), reported: Vec::new(), sample_at, sample }
    }

    pub(crate) fn subscribe(&mut self, simulation: &mut Simulation) -> Result<Subscription, Refusal> {
        if self.channel.receiver_count() >= FOLLOWERS {
            return Err(Refusal::TooMany("too many clients of the event stream"));
        }
        // Existing followers receive pending changes first; without followers, the reported states are reset.
        self.poll(simulation);
        let states = simulation.states();
        if !self.is_followed() {
            self.reported.clone_from(&states);
        }
        Ok(Subscription { states, events: self.channel.subscribe() })
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
        let samples = simulation.now() >= self.sample_at;
        if samples {
            self.sample_at = after(simulation.now(), self.sample);
        }
        for (reported, state) in self.reported.iter_mut().zip(simulation.states()) {
            if compared(reported, samples) != compared(&state, samples) {
                tell(&self.channel, "device", &state);
                *reported = state;
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

/// Returns a state for comparisons: without its instant and, except at sample times, without the position and the shaft
/// angle, which change continuously.
fn compared(state: &DeviceState, samples: bool) -> DeviceState {
    let state = DeviceState { t_us: 0, ..state.clone() };
    if samples {
        return state;
    }
    DeviceState { position: None, plant: state.plant.at_rest(), ..state }
}
