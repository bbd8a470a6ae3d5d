//! `/bus/frames`: frames of clients, once or cyclic.

use axum::Json;
use protocol_core::time::Duration;
use serde::Deserialize;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{Object, Schema, Type};
use utoipa::{IntoParams, PartialSchema, ToSchema};

use super::Control;
use crate::http::error::{Body, Error, Failure, Query};
use hal_sim::simulation::{Command, Reply, Sent, Stopped};
use hal_sim::state::{DATA, DATA_PATTERN, Identifier, Pattern};

/// A frame to be sent.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameToSend {
    /// The identifier.
    id: Identifier,
    /// Whether the identifier has 29 bits.
    extended: Option<bool>,
    /// Up to eight bytes, in hex; `R`, `R1` … for a remote frame.
    #[schema(value_type = Data)]
    data: String,
    /// The period of a cyclic frame, in milliseconds.
    #[schema(minimum = 1, maximum = 4294967295_i64)]
    every_ms: Option<u32>,
}

/// The cyclic frames to stop.
#[derive(Clone, Debug, Deserialize, IntoParams, ToSchema)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct WhichFrames {
    /// The identifier in hex, with or without 0x; all identifiers by default.
    #[param(pattern = "^(0[xX])?([01][0-9A-Fa-f]{7}|[0-9A-Fa-f]{1,7})$")]
    id: Option<String>,
    /// Whether the identifier has 29 bits; by default, true for eight digits and for values above 0x7FF.
    extended: Option<bool>,
}

/// Sends a frame as a client would
///
/// Answers when the frame (with `every_ms`, the first frame) has been sent. With `--speed step` this call advances
/// time.
#[utoipa::path(
    post, path = "/bus/frames", operation_id = "sendFrame", tag = "bus",
    request_body = FrameToSend,
    responses(
        (status = 200, body = Sent),
        (status = 409, body = Error, description = "Not sent within 1 s of virtual time, and withdrawn")
    )
)]
pub(super) async fn send(control: Control, Body(frame): Body<FrameToSend>) -> Result<Json<Reply>, Failure> {
    let id = frame.id.id(frame.extended)?;
    let period = frame.every_ms.map(|period| Duration::from_millis(period.into()));
    let one = Pattern::of_data(id, Some(&frame.data))?.frame();
    let frame = one.ok_or_else(|| {
        Failure::bad_request(format!("data \"{}\" is not valid; accepted: bytes in hex, without ? and ..", frame.data))
    })?;
    control.execute(Command::Send(frame, period)).await
}

/// Stops cyclic frames
#[utoipa::path(
    delete, path = "/bus/frames", operation_id = "stopFrames", tag = "bus",
    params(WhichFrames),
    responses((status = 200, body = Stopped))
)]
pub(super) async fn stop(control: Control, Query(which): Query<WhichFrames>) -> Result<Json<Reply>, Failure> {
    let id = match which.id.map(Identifier::Text) {
        Some(id) => Some(id.id(which.extended.or_else(|| id.needs_29_bits().then_some(true)))?),
        None if which.extended.is_some() => {
            return Err(Failure::bad_request("extended is only valid together with id"));
        }
        None => None,
    };
    control.execute(Command::Stop(id)).await
}

/// The schema of the data of a frame.
pub(super) struct Data;

/// The schema of a pattern of data.
pub(super) struct DataPattern;

impl PartialSchema for Data {
    fn schema() -> RefOr<Schema> {
        text(DATA)
    }
}

impl PartialSchema for DataPattern {
    fn schema() -> RefOr<Schema> {
        text(DATA_PATTERN)
    }
}

impl ToSchema for Data {}

impl ToSchema for DataPattern {}

/// Returns the schema of texts that match a pattern.
fn text(pattern: &str) -> RefOr<Schema> {
    Object::builder().schema_type(Type::String).pattern(Some(pattern)).into()
}
