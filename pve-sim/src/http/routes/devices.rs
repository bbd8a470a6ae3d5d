//! `/devices`: states, plant and power.

use axum::Json;

use super::Control;
use crate::control::Message;
use crate::http::error::{Body, Error, Failure, Name};
use hal_sim::simulation::{Command, Reply};
use hal_sim::state::{DeviceState, PlantChange, PowerChange};

/// The states of all devices
#[utoipa::path(get, path = "/devices", operation_id = "listDevices", tag = "devices", responses((status = 200, body = Vec<DeviceState>)))]
pub(super) async fn list(control: Control) -> Result<Json<Vec<DeviceState>>, Failure> {
    control.ask(Message::Devices).await.map(Json)
}

/// The state of a device
#[utoipa::path(
    get, path = "/devices/{name}", operation_id = "showDevice", tag = "devices",
    params(("name" = String, Path, description = "The name of the device")),
    responses((status = 200, body = DeviceState), (status = 404, body = Error))
)]
pub(super) async fn show(control: Control, Name(name): Name) -> Result<Json<DeviceState>, Failure> {
    control.ask(|answer| Message::Device(name, answer)).await.map(Json)
}

/// Changes the plant of a device immediately; applies all changes or none
#[utoipa::path(
    patch, path = "/devices/{name}/plant", operation_id = "changePlant", tag = "devices",
    params(("name" = String, Path, description = "The name of the device")),
    request_body = PlantChange,
    responses(
        (status = 200, body = DeviceState, description = "The state after the change"),
        (status = 400, body = Error, description = "An unknown field, or a value out of range"),
        (status = 404, body = Error),
        (status = 409, body = Error, description = "A field is already changing")
    )
)]
pub(super) async fn change_plant(
    control: Control,
    Name(name): Name,
    Body(change): Body<PlantChange>,
) -> Result<Json<Reply>, Failure> {
    control.execute(Command::Plant(name, change)).await
}

/// Cuts the power of a device, boots it, or resets its processor
#[utoipa::path(
    post, path = "/devices/{name}/power", operation_id = "switchPower", tag = "devices",
    params(("name" = String, Path, description = "The name of the device")),
    request_body = PowerChange,
    responses(
        (status = 200, body = DeviceState, description = "The state after the change"),
        (status = 404, body = Error),
        (status = 409, body = Error, description = "Reset of a device without power")
    )
)]
pub(super) async fn power(
    control: Control,
    Name(name): Name,
    Body(change): Body<PowerChange>,
) -> Result<Json<Reply>, Failure> {
    control.execute(Command::Power(name, change.power()?)).await
}
