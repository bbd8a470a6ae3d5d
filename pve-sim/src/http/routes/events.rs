//! `/events`: server-sent events.

use std::convert::Infallible;
use std::time::Duration;

use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::{Stream, StreamExt as _, stream};
use serde::Serialize;
use tokio_stream::wrappers::BroadcastStream;
use tokio_stream::wrappers::errors::BroadcastStreamRecvError;
use utoipa::ToSchema;

use super::Control;
use crate::control::Message;
use crate::control::events::{Subscription, json};
use crate::http::error::{Error, Failure};

/// The interval between comments on a quiet bus, which reveal a disconnected client.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The data of a `lost` event, for a client that was too slow.
#[derive(Serialize, ToSchema)]
pub(super) struct LostEvent {
    /// The number of lost events.
    events: u64,
}

/// Streams the events of the simulation as server-sent events
///
/// The first events are a `device` event for each device. Later events are `frame` for each frame on the bus, `device`
/// for each change of a device, with its position up to 50 times a second, and `error` as in the trace: for the first
/// error frame of each destroyed frame, and for each change of an error mode. A client that is too slow loses events; a
/// `lost` event has their number.
#[utoipa::path(
    get, path = "/events", operation_id = "followEvents", tag = "events",
    responses(
        (status = 200, content_type = "text/event-stream", body = String),
        (status = 503, body = Error, description = "Too many clients of the event stream")
    )
)]
pub(super) async fn follow(control: Control) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Failure> {
    let Subscription { states, events } = control.ask(Message::Subscribe).await?;
    let first = stream::iter(states).map(|state| event("device", &json(&state)));
    let next = BroadcastStream::new(events).map(|received| match received {
        Ok(received) => event(received.name, &received.json),
        Err(BroadcastStreamRecvError::Lagged(events)) => event("lost", &json(&LostEvent { events })),
    });
    let next = next.take_until(control.connection.ended().clone().cancelled_owned());
    Ok(Sse::new(first.chain(next).map(Ok)).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)))
}

fn event(name: &str, data: &str) -> Event {
    Event::default().event(name).data(data)
}
