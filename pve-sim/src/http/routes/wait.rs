//! `/wait`: waits for a state or a frame.

use axum::Json;
use protocol_core::time::Duration;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use utoipa::ToSchema;

use super::Control;
use super::frames::DataPattern;
use crate::http::error::{Body, Error, Failure};
use hal_sim::simulation::{Command, FrameRecord, Reply, TimedOut};
use hal_sim::state::{Condition, DeviceState, Identifier, Pattern, StateCondition};

/// A wait: for a state of a device, for a frame, or for the next received frame.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Wait {
    /// The name of the device.
    device: Option<String>,
    /// The expected state of the device: any subset of its members.
    state: Option<StateCondition>,
    /// The frame.
    frame: Option<FrameToCome>,
    /// The next frame that this interface receives as a node of the bus: each frame once, in order, from the start. Its own
    /// frames do not count, nor those that a communication fault loses for all receivers.
    received: Option<bool>,
    /// The time limit in milliseconds of virtual time; a fraction is rounded to microseconds.
    #[serde(deserialize_with = "milliseconds")]
    #[schema(value_type = f64, minimum = 0, maximum = 4294967295_i64)]
    within_ms: Duration,
}

/// Deserialises a time in milliseconds.
fn milliseconds<'de, D: Deserializer<'de>>(value: D) -> Result<Duration, D::Error> {
    let ms = f64::deserialize(value)?;
    if !(0.0..=f64::from(u32::MAX)).contains(&ms) {
        return Err(D::Error::custom(format!("within_ms must be 0 to {} milliseconds, not {ms}", u32::MAX)));
    }
    Ok(Duration::from_micros((ms * 1e3).round() as u64))
}

/// A frame to wait for.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameToCome {
    /// The identifier.
    id: Identifier,
    /// Whether the identifier has 29 bits.
    extended: Option<bool>,
    /// The data: exactly these bytes in hex. `?` stands for any digit, and `..` at the end for any further bytes; `R`,
    /// `R1` … stand for a remote frame. By default, any frame.
    #[schema(value_type = Option<DataPattern>)]
    data: Option<String>,
}

/// The answer when the condition holds.
#[derive(serde::Serialize, ToSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "only for the OpenAPI description")]
enum Waited {
    /// The state of the device at the first instant at which the condition holds.
    Device(Box<DeviceState>),
    /// The frame.
    Frame(FrameRecord),
}

/// The answer 408: the wait, or the reception of the body, exceeded its time limit.
#[derive(serde::Serialize, ToSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "only for the OpenAPI description")]
enum NotInTime {
    Wait(TimedOut),
    Body(Error),
}

/// Waits until a device is in a state, or a frame is on the bus
///
/// Answers at the first instant at which the condition holds, which can be the current instant. With `--speed step`
/// this call advances time.
#[utoipa::path(
    post, path = "/wait", operation_id = "wait", tag = "wait",
    request_body = Wait,
    responses(
        (status = 200, body = Waited),
        (status = 400, body = Error, description = "An unknown key or value"),
        (status = 404, body = Error),
        (status = 408, body = NotInTime, description = "The condition did not hold within the time limit (the error states the differences), or the body was not received in time")
    )
)]
pub(super) async fn wait(control: Control, Body(wait): Body<Wait>) -> Result<Json<Reply>, Failure> {
    let within = wait.within_ms;
    let condition = match wait {
        Wait { device: Some(device), state: Some(state), frame: None, received: None, .. } => {
            Condition::State(device, Box::new(state))
        }
        Wait { device: None, state: None, frame: Some(FrameToCome { id, extended, data }), received: None, .. } => {
            Condition::Frame(Pattern::of_data(id.id(extended)?, data.as_deref())?)
        }
        Wait { device: None, state: None, frame: None, received: Some(true), .. } => Condition::Received,
        _ => {
            let accepted = "the body must be {\"device\", \"state\", \"within_ms\"}, {\"frame\", \"within_ms\"} or \
                            {\"received\": true, \"within_ms\"}";
            return Err(Failure::bad_request(accepted));
        }
    };
    control.execute(Command::Wait(condition, within)).await
}
