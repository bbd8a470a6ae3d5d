//! `/bus`: bit rate, load and disturbances.

use axum::Json;

use super::Control;
use crate::control::message::Message;
use crate::http::error::{Body, Error, Failure};
use hal_sim::simulation::{BusState, Command, Reply};
use hal_sim::state::{BusChange, Disturb};

/// The state of the bus
#[utoipa::path(get, path = "/bus", operation_id = "showBus", tag = "bus", responses((status = 200, body = BusState)))]
pub(super) async fn show(control: Control) -> Result<Json<BusState>, Failure> {
    control.ask(Message::Bus).await.map(Json)
}

/// Changes the bit rate of the bus and of every client, as a master that changes its rate
#[utoipa::path(
    patch, path = "/bus", operation_id = "changeBus", tag = "bus",
    request_body = BusChange,
    responses((status = 200, body = BusState), (status = 400, body = Error))
)]
pub(super) async fn change(control: Control, Body(change): Body<BusChange>) -> Result<Json<Reply>, Failure> {
    control.execute(Command::BitRate(change.bit_rate()?)).await
}

/// Destroys the next attempts to send a frame, by a bit error each; replaces an earlier disturbance
#[utoipa::path(
    post, path = "/bus/disturb", operation_id = "disturbBus", tag = "bus",
    request_body = Disturb,
    responses((status = 200, body = BusState), (status = 400, body = Error))
)]
pub(super) async fn disturb(control: Control, Body(disturb): Body<Disturb>) -> Result<Json<Reply>, Failure> {
    control.execute(Command::Disturb(disturb.disturbance()?)).await
}
