//! The description of the interface in OpenAPI.

use std::sync::LazyLock;

use axum::Json;
use serde_json::{Value, json};
use utoipa::{OpenApi, ToSchema};

use super::{bus, cell, devices, events, frames, time, trace, wait};
use crate::http::error::Error;
use hal_sim::simulation::BusTrouble;
use hal_sim::simulation::TimedOut;
use hal_sim::state::schema::{Schemas, without_formats};
use hal_sim::state::{BusChange, Disturb, FaultRequest, PlantChange, PowerChange};

/// The calls and schemas that attributes can express.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "pve-sim",
        description = "Control interface of simulated CAN hydraulic valves and angle sensors. All times are in microseconds \
                       of virtual time."
    ),
    servers((url = "/api/v1")),
    paths(
        devices::list,
        devices::show,
        devices::change_plant,
        devices::power,
        bus::show,
        bus::change,
        bus::disturb,
        bus::faults,
        bus::add_fault,
        bus::end_faults,
        bus::end_fault,
        frames::send,
        frames::stop,
        wait::wait,
        time::show,
        time::advance,
        cell::show,
        trace::show,
        events::follow,
    ),
    components(schemas(Error, TimedOut, BusTrouble, events::LostEvent))
)]
struct Calls;

static DESCRIPTION: LazyLock<Value> = LazyLock::new(|| {
    let mut description = json!(Calls::openapi());
    without_formats(&mut description);
    let schemas = &mut description["components"]["schemas"];
    describe::<PlantChange>(schemas);
    describe::<PowerChange>(schemas);
    describe::<BusChange>(schemas);
    describe::<Disturb>(schemas);
    describe::<FaultRequest>(schemas);
    describe::<frames::FrameToSend>(schemas);
    describe::<wait::Wait>(schemas);
    describe::<time::Advance>(schemas);
    // The error of a wait also matches the schema of the other error, which `oneOf` would forbid.
    schemas["NotInTime"] = json!({ "anyOf": schemas["NotInTime"]["oneOf"] });
    let paths = description["paths"].as_object_mut().into_iter().flat_map(|paths| paths.values_mut());
    paths.filter_map(Value::as_object_mut).flat_map(|path| path.values_mut()).for_each(add_refusals);
    description
});

pub(super) async fn show() -> Json<&'static Value> {
    Json(&DESCRIPTION)
}

/// Replaces the schemas derived from attributes by those that validate request bodies.
fn describe<T: ToSchema + 'static>(schemas: &mut Value) {
    for (name, schema) in Schemas::of::<T>().by_name() {
        schemas[name] = schema.clone();
    }
}

/// Adds the error responses common to all calls, and those for request bodies and parameters.
fn add_refusals(call: &mut Value) {
    let has_body = call["requestBody"].is_object();
    let refusals = [
        ("400", true, "An invalid value, or a query or body that the call does not have"),
        (
            "403",
            true,
            "The Host is neither loopback nor the address of this server, or a page of another origin sends the request (a GET without Origin is served)",
        ),
        ("405", true, "Method not supported"),
        ("408", has_body, "The body was not received within 10 s"),
        ("413", has_body, "Body larger than 64 KiB"),
        ("415", has_body, "Content-Type is not application/json"),
        ("503", true, "A capacity is exhausted, or the simulator is shutting down"),
    ];
    for (status, _, description) in refusals.into_iter().filter(|(_, applies, _)| *applies) {
        let error = json!({ "$ref": "#/components/schemas/Error" });
        let response = &mut call["responses"][status];
        if response.is_null() {
            *response = json!({ "description": description, "content": { "application/json": { "schema": error } } });
        } else if response["description"] == "" {
            response["description"] = description.into();
        }
    }
    // Only successes and the status 404 for a device have no description yet.
    let responses = call["responses"].as_object_mut().into_iter().flatten();
    for (status, response) in responses.filter(|(_, response)| response["description"] == "") {
        let description = if status == "404" { "No device of this name" } else { "Done" };
        response["description"] = description.into();
    }
}
