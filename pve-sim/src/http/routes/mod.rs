//! The calls, by resource, and their description.

mod bus;
mod cell;
mod description;
mod devices;
mod events;
mod frames;
mod panel;
mod time;
mod trace;
mod wait;

use std::sync::Arc;

use axum::extract::{DefaultBodyLimit, FromRequestParts};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::routing::{delete, get, patch, post};
use axum::{Json, Router, middleware};
use tokio::sync::oneshot;

use super::connection::Connection;
use super::error::{BODY_MAX, Failure};
use super::guard::{guard, without_body, without_query};
use crate::control::{Answer, Message};
use crate::inbox::{ToWorld, WorldSender};
use hal_sim::simulation::{Command, Reply};

/// The sender by which a call reaches the world, and the connection of its client.
#[derive(Clone, Debug)]
pub(super) struct Control {
    world: WorldSender,
    connection: Arc<Connection>,
}

impl Control {
    /// Sends a message to the world, and waits for the answer.
    async fn ask<T>(&self, message: impl FnOnce(Answer<T>) -> Message) -> Result<T, Failure> {
        let _asking = self.connection.begin_call();
        let (answer, receiver) = oneshot::channel();
        self.world.tell(ToWorld::Control(message(answer)));
        Ok(receiver.await.map_err(|_| Failure::ending())??)
    }

    /// Executes a command, and waits for its completion. The number of pending commands that take virtual time is
    /// limited, and a client that disconnects cancels them.
    async fn execute(&self, command: Command) -> Result<Json<Reply>, Failure> {
        let takes_time = command.takes_time();
        let call = self.ask(|answer| Message::Execute(command, answer));
        if !takes_time {
            return call.await.map(Json);
        }
        let _permit = self.connection.wait().ok_or_else(Failure::crowded)?;
        self.connection.ended().run_until_cancelled(call).await.ok_or_else(Failure::cancelled)?.map(Json)
    }
}

impl FromRequestParts<WorldSender> for Control {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, world: &WorldSender) -> Result<Self, Failure> {
        // Every connection has the extension.
        let connection = parts.extensions.get::<Arc<Connection>>().ok_or_else(Failure::ending)?;
        Ok(Self { world: world.clone(), connection: Arc::clone(connection) })
    }
}

pub(super) fn router(world: WorldSender) -> Router {
    let api = Router::new()
        .route("/devices", get(devices::list))
        .route("/devices/{name}", get(devices::show))
        .route("/devices/{name}/plant", patch(devices::change_plant))
        .route("/devices/{name}/power", post(devices::power))
        .route("/bus", get(bus::show).patch(bus::change))
        .route("/bus/disturb", post(bus::disturb))
        .route("/bus/faults", get(bus::faults).post(bus::add_fault).delete(bus::end_faults))
        .route("/bus/faults/{name}", delete(bus::end_fault))
        .route("/wait", post(wait::wait))
        .route("/time", get(time::show).post(time::advance))
        .route("/cell", get(cell::show))
        .route("/events", get(events::follow))
        .route("/openapi.json", get(description::show))
        .route("/bus/frames", post(frames::send))
        // A route layer applies to the routes above: those below have a query.
        .route_layer(middleware::from_fn(without_query))
        .route("/bus/frames", delete(frames::stop))
        .route("/trace", get(trace::show))
        .route_layer(middleware::from_fn(without_body));
    Router::new()
        .nest("/api/v1", api)
        .route("/", get(panel::page))
        .route("/panel/{name}", get(panel::file))
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .layer(DefaultBodyLimit::max(BODY_MAX))
        .layer(middleware::from_fn(guard))
        .with_state(world)
}

async fn not_found() -> Failure {
    Failure::Request(StatusCode::NOT_FOUND, "no such resource; see /api/v1/openapi.json".to_owned())
}

async fn method_not_allowed() -> Failure {
    let error = "the resource does not support this method; see /api/v1/openapi.json".to_owned();
    Failure::Request(StatusCode::METHOD_NOT_ALLOWED, error)
}
