//! `/wait`: a state, or a frame.

use axum::Json;
use protocol_core::time::Duration;
use serde::Deserialize;
use utoipa::ToSchema;

use super::Control;
use super::frames::bytes;
use crate::control::error::{Body, Error, Failure};
use crate::control::message::{Message, TimedOut, Waited};
use crate::state::{Condition, FrameCondition, StateCondition, given, given_object, identifier};

/// What is waited for, and how long: a device with a state, or a frame.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Wait {
    /// The name of the device.
    #[serde(default, deserialize_with = "given")]
    device: Option<String>,
    /// The state of the device: any subset of it.
    #[serde(default, deserialize_with = "given_object")]
    state: Option<StateCondition>,
    /// The frame.
    #[serde(default, deserialize_with = "given_object")]
    frame: Option<FrameToCome>,
    /// The time in milliseconds of virtual time.
    within_ms: u32,
}

/// A frame that is waited for.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameToCome {
    /// The identifier.
    id: u32,
    /// Whether the identifier has 29 bits.
    #[serde(default)]
    extended: bool,
    /// The begin of the data, in hex.
    #[serde(default)]
    data: String,
}

/// Waits until a device is in a state, or a frame is on the bus
///
/// Answers at the first instant when it holds, which can be now. With `--speed step` this lets time pass.
#[utoipa::path(
    post, path = "/wait", operation_id = "wait", tag = "wait",
    request_body = Wait,
    responses(
        (status = 200, body = Waited),
        (status = 400, body = Error, description = "An unknown key or value"),
        (status = 404, body = Error),
        (status = 408, body = TimedOut, description = "It did not hold within the time")
    )
)]
pub(super) async fn wait(control: Control, Body(wait): Body<Wait>) -> Result<Json<Waited>, Failure> {
    let condition = match wait {
        Wait { device: Some(device), state: Some(state), frame: None, .. } => Condition::State(device, Box::new(state)),
        Wait { device: None, state: None, frame: Some(FrameToCome { id, extended, data }), .. } => {
            Condition::Frame(FrameCondition { id: identifier(id, extended)?, data: bytes(&data)? })
        }
        _ => {
            let accepted = "accepted: {\"device\", \"state\", \"within_ms\"} or {\"frame\", \"within_ms\"}";
            return Err(Failure::bad_request(accepted));
        }
    };
    let within = Duration::from_millis(wait.within_ms.into());
    control.ask_and_wait(|answer| Message::Wait(condition, within, answer)).await.map(Json)
}
