//! The oracles of a plan: the proof of detection, and the safe state.

use protocol_core::frame::Id;
use protocol_core::time::Duration;
use toml::Table;

use super::file::{Detected, Safe};
use crate::devices::NamedDevice;
use crate::scenario::file::Expected;
use crate::scenario::step::Wanted;
use crate::scenario::trial::{device, wanted, within};
use crate::state::{Invalid, Pattern};

/// The proof that the controller has detected the fault.
#[derive(Debug)]
pub(super) enum Proof {
    /// Frames from any sender, in order.
    Frames(Vec<Pattern>),
    /// A state of a device.
    State(Wanted),
    /// No frame with this identifier for this time, after at least one such frame in the run.
    Stops(Id, Duration),
}

/// A state that must hold without interruption.
#[derive(Debug)]
pub(super) struct SafeState {
    pub(super) state: Wanted,
    /// The time for which the state must hold; `None` if it must hold until the end of the observation.
    pub(super) span: Option<Duration>,
}

/// The accepted forms of `detected`, for messages.
const FORMS: &str = "give expect = \"000#02..\", expect = { dsm = \"fault-hold\" }, or stops = \"220\" with for_ms";

impl Detected {
    /// Checks `detected` against the devices on the bus. Returns the proof and its limit.
    ///
    /// # Errors
    /// The reason, for the user.
    pub(super) fn check(self, devices: &[NamedDevice]) -> Result<(Proof, Duration), String> {
        let Self { expect, stops, for_ms, device: name, within_ms } = self;
        let is_state = matches!(expect, Some(Expected::State(_)));
        if name.is_some() && !is_state {
            return Err("device is only valid together with a state".to_owned());
        }
        if for_ms.is_some() && stops.is_none() {
            return Err("for_ms is only valid together with stops".to_owned());
        }
        let frames = |frames: Vec<String>| match frames.is_empty() {
            true => Err("expect: empty list; give at least one frame, as in [\"000#02..\"]".to_owned()),
            false => frames.iter().map(|frame| frame.parse().map_err(within("expect"))).collect(),
        };
        let proof = match (expect, stops) {
            (Some(Expected::Frame(frame)), None) => Proof::Frames(frames(vec![frame])?),
            (Some(Expected::Frames(list)), None) => Proof::Frames(frames(list)?),
            (Some(Expected::State(state)), None) => Proof::State(self::state(devices, name.as_deref(), state)?),
            (None, Some(stops)) => {
                let span = for_ms.ok_or("for_ms is missing; give the required time without the frame")?;
                let extended = stops.needs_29_bits().then_some(true);
                let id = stops.id(extended).map_err(|Invalid(reason)| format!("stops: {reason}"))?;
                Proof::Stops(id, millis(span))
            }
            (None, None) => return Err(format!("expect and stops are both missing; {FORMS}")),
            (Some(_), Some(_)) => return Err(format!("expect and stops cannot be combined; {FORMS}")),
        };
        Ok((proof, millis(within_ms)))
    }
}

impl Safe {
    /// Checks `safe` against the devices on the bus. Returns the safe state and its limit.
    ///
    /// # Errors
    /// The reason, for the user.
    pub(super) fn check(self, devices: &[NamedDevice]) -> Result<(SafeState, Duration), String> {
        let Self { expect, device: name, for_ms, within_ms } = self;
        let state = state(devices, name.as_deref(), expect)?;
        Ok((SafeState { state, span: for_ms.map(millis) }, millis(within_ms)))
    }
}

/// Checks a state against the devices on the bus.
fn state(devices: &[NamedDevice], name: Option<&str>, state: Table) -> Result<Wanted, String> {
    if state.contains_key("t_us") {
        return Err("expect: t_us is an instant, not a state; remove t_us".to_owned());
    }
    let device = device(devices, name, true)?;
    wanted(&device, state).map_err(within("expect"))
}

fn millis(ms: u32) -> Duration {
    Duration::from_millis(ms.into())
}
