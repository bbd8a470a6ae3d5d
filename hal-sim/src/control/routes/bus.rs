//! `/bus`: bit rate, load and disturbances.

use axum::Json;
use protocol_core::controller::BitRate;
use serde::Deserialize;
use utoipa::ToSchema;

use super::Control;
use super::frames::identifier;
use crate::bus::Disturbance;
use crate::control::error::{Body, Error, Failure};
use crate::control::message::{BusState, Message};
use crate::control::plant::given;

/// A change of the bus.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct BusChange {
    /// The bit rate of the bus and of every client, in bit/s.
    bit_rate: u32,
}

/// Frames to be destroyed.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Disturb {
    /// The number of attempts; 0 ends an earlier disturbance.
    frames: u32,
    /// The identifier; without it any.
    #[serde(default, deserialize_with = "given")]
    id: Option<u32>,
    /// Whether the identifier has 29 bits.
    #[serde(default)]
    extended: bool,
}

/// The state of the bus
#[utoipa::path(get, path = "/bus", operation_id = "showBus", tag = "bus", responses((status = 200, body = BusState)))]
pub(super) async fn show(control: Control) -> Result<Json<BusState>, Failure> {
    control.ask(Message::Bus).await.map(Json)
}

/// Changes the bit rate of the bus and of every client: the master that changes its rate
#[utoipa::path(
    patch, path = "/bus", operation_id = "changeBus", tag = "bus",
    request_body = BusChange,
    responses((status = 200, body = BusState), (status = 400, body = Error))
)]
pub(super) async fn change(control: Control, Body(change): Body<BusChange>) -> Result<Json<BusState>, Failure> {
    let bit_rate = BitRate::from_bits_per_second(change.bit_rate).ok_or_else(|| {
        let rates: Vec<String> = BitRate::ALL.iter().map(|rate| rate.bits_per_second().to_string()).collect();
        Failure::bad_request(format!("bit_rate {}: accepted: {}", change.bit_rate, rates.join(", ")))
    })?;
    control.ask(|answer| Message::BitRate(bit_rate, answer)).await.map(Json)
}

/// Destroys the next attempts to send a frame by a bit error each, in the place of an earlier disturbance
#[utoipa::path(
    post, path = "/bus/disturb", operation_id = "disturbBus", tag = "bus",
    request_body = Disturb,
    responses((status = 200, body = BusState), (status = 400, body = Error))
)]
pub(super) async fn disturb(control: Control, Body(disturb): Body<Disturb>) -> Result<Json<BusState>, Failure> {
    let id = disturb.id.map(|id| identifier(id, disturb.extended)).transpose()?;
    if id.is_none() && disturb.extended {
        return Err(Failure::bad_request("extended without an id"));
    }
    control.ask(|answer| Message::Disturb(Disturbance { frames: disturb.frames, id }, answer)).await.map(Json)
}
