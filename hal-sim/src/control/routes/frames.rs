//! `/bus/frames`: frames of clients, once or cyclic.

use axum::Json;
use protocol_core::frame::{Frame, StandardId};
use protocol_core::time::Duration;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::Control;
use crate::control::error::{Body, Error, Failure, Query};
use crate::control::message::{Message, Sent, Stopped};
use crate::state::{given, identifier};

/// A frame to be sent.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameToSend {
    /// The identifier.
    id: u32,
    /// Whether the identifier has 29 bits.
    #[serde(default)]
    extended: bool,
    /// Up to eight bytes, in hex.
    data: String,
    /// Sends it again and again, with this period.
    #[serde(default, deserialize_with = "given")]
    every_ms: Option<u32>,
}

/// Which cyclic frames are meant.
#[derive(Clone, Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct WhichFrames {
    /// The identifier, decimal or 0x; without it all.
    id: Option<String>,
    /// Whether the identifier has 29 bits; one above 0x7FF has.
    extended: Option<bool>,
}

/// Sends a frame as a client would
///
/// The answer comes when the frame is on the bus: the first one, with `every_ms`. With `--speed step` this lets time
/// pass.
#[utoipa::path(
    post, path = "/bus/frames", operation_id = "sendFrame", tag = "bus",
    request_body = FrameToSend,
    responses(
        (status = 200, body = Sent),
        (status = 400, body = Error),
        (status = 409, body = Error, description = "Not on the bus within 1 s of virtual time: withdrawn")
    )
)]
pub(super) async fn send(control: Control, Body(frame): Body<FrameToSend>) -> Result<Json<Sent>, Failure> {
    let id = identifier(frame.id, frame.extended)?;
    let data = bytes(&frame.data)?;
    let period = match frame.every_ms {
        Some(0) => return Err(Failure::bad_request("every_ms 0: accepted: 1 and more")),
        every_ms => every_ms.map(|period| Duration::from_millis(period.into())),
    };
    let frame = Frame::of(id, &data).ok_or_else(|| Failure::bad_request("data: more than eight bytes"))?;
    control.ask_and_wait(|answer| Message::Send(frame, period, answer)).await.map(Json)
}

/// Ends cyclic frames
#[utoipa::path(
    delete, path = "/bus/frames", operation_id = "stopFrames", tag = "bus",
    params(WhichFrames),
    responses((status = 200, body = Stopped), (status = 400, body = Error))
)]
pub(super) async fn stop(control: Control, Query(which): Query<WhichFrames>) -> Result<Json<Stopped>, Failure> {
    let id = match which.id {
        Some(text) => {
            let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
            let id = hex.map_or_else(|| text.parse().ok(), |hex| u32::from_str_radix(hex, 16).ok());
            let id =
                id.ok_or_else(|| Failure::bad_request(format!("id '{text}': accepted: a number, decimal or 0x")))?;
            Some(identifier(id, which.extended.unwrap_or(id > StandardId::MAX.as_raw().into()))?)
        }
        None if which.extended.is_some() => return Err(Failure::bad_request("extended without an id")),
        None => None,
    };
    control.ask(|answer| Message::Stop(id, answer)).await.map(Json)
}

/// The bytes of a text in hex.
pub(super) fn bytes(hex: &str) -> Result<Vec<u8>, Failure> {
    let digits: Option<Vec<u32>> = hex.chars().map(|digit| digit.to_digit(16)).collect();
    let digits = digits.filter(|digits| digits.len().is_multiple_of(2) && digits.len() <= 16);
    let digits = digits.ok_or_else(|| {
        Failure::bad_request(format!("data '{hex}': accepted: up to eight bytes in hex, as in 2B17100A"))
    })?;
    Ok(digits.chunks_exact(2).map(|pair| (pair[0] << 4 | pair[1]) as u8).collect())
}
