//! `/events`: what happens, as server-sent events.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::response::sse::{Event, KeepAlive, Sse};
use serde::Serialize;
use tokio_stream::wrappers::BroadcastStream;
use tokio_stream::wrappers::errors::BroadcastStreamRecvError;
use tokio_stream::{Stream, StreamExt as _};
use utoipa::ToSchema;

use super::Control;
use crate::control::events::{ControlEvent, Follower, Subscription, json};
use crate::control::message::Message;
use crate::http::error::{Error, Failure};

/// A quiet bus sends a comment so often: a client that is gone is noticed.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The data of a `lost` event: the client was too slow.
#[derive(Serialize, ToSchema)]
pub(super) struct LostEvent {
    /// How many events were lost.
    events: u64,
}

/// What happens from now on, as server-sent events
///
/// First a `device` event for each device; then `frame` for each frame on the bus, `device` for each change of a
/// device, its position up to 50 times a second, and `error` as the trace tells it: the first error frame of a frame
/// that is being destroyed, and changes of error modes. A client that is too slow loses events, and is told by `lost`
/// how many.
#[utoipa::path(
    get, path = "/events", operation_id = "followEvents", tag = "events",
    responses(
        (status = 200, content_type = "text/event-stream", body = String),
        (status = 503, body = Error, description = "Too many clients follow")
    )
)]
pub(super) async fn follow(control: Control) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Failure> {
    let Subscription { states, events, follower } = control.ask(Message::Subscribe).await?;
    let first = tokio_stream::iter(states).map(|state| event("device", &json(&state)));
    let next = BroadcastStream::new(events).map(move |event| follower.event(event));
    Ok(Sse::new(first.chain(next).map(Ok)).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)))
}

impl Follower {
    /// The event of something that happened, or that was missed.
    fn event(&self, received: Result<Arc<ControlEvent>, BroadcastStreamRecvError>) -> Event {
        match received {
            Ok(received) => event(received.name(), received.json()),
            Err(BroadcastStreamRecvError::Lagged(events)) => event("lost", &json(&LostEvent { events })),
        }
    }
}

fn event(name: &str, data: &str) -> Event {
    Event::default().event(name).data(data)
}
