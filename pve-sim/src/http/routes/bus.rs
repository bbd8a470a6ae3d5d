//! `/bus`: bit rate, load, disturbances and communication faults.

use axum::Json;

use super::Control;
use crate::control::Message;
use crate::http::error::{Body, Error, Failure, Name};
use hal_sim::simulation::{BusState, Command, Reply};
use hal_sim::state::{BusChange, Disturb, FaultRecord, FaultRequest};

/// The state of the bus
#[utoipa::path(get, path = "/bus", operation_id = "showBus", tag = "bus", responses((status = 200, body = BusState)))]
pub(super) async fn show(control: Control) -> Result<Json<BusState>, Failure> {
    control.ask(Message::Bus).await.map(Json)
}

/// Changes the bit rate of the bus and of every client, like a master that changes its rate
#[utoipa::path(
    patch, path = "/bus", operation_id = "changeBus", tag = "bus",
    request_body = BusChange,
    responses((status = 200, body = BusState))
)]
pub(super) async fn change(control: Control, Body(change): Body<BusChange>) -> Result<Json<Reply>, Failure> {
    control.execute(Command::BitRate(change.bit_rate()?)).await
}

/// Destroys the next transmission attempts with one bit error each; replaces an earlier disturbance
#[utoipa::path(
    post, path = "/bus/disturb", operation_id = "disturbBus", tag = "bus",
    request_body = Disturb,
    responses((status = 200, body = BusState))
)]
pub(super) async fn disturb(control: Control, Body(disturb): Body<Disturb>) -> Result<Json<Reply>, Failure> {
    control.execute(Command::Disturb(disturb.disturbance()?)).await
}

/// The communication faults, including those that have ended
#[utoipa::path(
    get, path = "/bus/faults", operation_id = "listFaults", tag = "bus",
    responses((status = 200, body = Vec<FaultRecord>))
)]
pub(super) async fn faults(control: Control) -> Result<Json<Vec<FaultRecord>>, Failure> {
    control.ask(Message::Faults).await.map(Json)
}

/// Adds a communication fault
#[utoipa::path(
    post, path = "/bus/faults", operation_id = "addFault", tag = "bus",
    request_body = FaultRequest,
    responses(
        (status = 200, body = FaultRecord),
        (status = 409, body = Error, description = "A fault of this name is active, 64 faults are active, or the bus may have real devices"),
    )
)]
pub(super) async fn add_fault(control: Control, Body(request): Body<FaultRequest>) -> Result<Json<Reply>, Failure> {
    control.execute(Command::Fault(request.fault()?)).await
}

/// Ends all communication faults, and returns them
#[utoipa::path(
    delete, path = "/bus/faults", operation_id = "endFaults", tag = "bus",
    responses((status = 200, body = Vec<FaultRecord>))
)]
pub(super) async fn end_faults(control: Control) -> Result<Json<Reply>, Failure> {
    control.execute(Command::EndFaults(None)).await
}

/// Ends a communication fault, and returns it
#[utoipa::path(
    delete, path = "/bus/faults/{name}", operation_id = "endFault", tag = "bus",
    params(("name" = String, Path, description = "The name of the fault")),
    responses(
        (status = 200, body = Vec<FaultRecord>),
        (status = 404, body = Error, description = "No fault of this name"),
    )
)]
pub(super) async fn end_fault(control: Control, Name(name): Name) -> Result<Json<Reply>, Failure> {
    control.execute(Command::EndFaults(Some(name))).await
}
