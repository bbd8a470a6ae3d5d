//! `/time`: virtual time.

use axum::Json;
use protocol_core::time::Duration;
use serde::Deserialize;
use utoipa::ToSchema;

use super::Control;
use crate::control::{Message, Speed, Time};
use crate::http::error::{Body, Error, Failure};
use hal_sim::simulation::{Advanced, Command, Reply};

/// An advance of virtual time.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Advance {
    /// The duration in milliseconds of virtual time.
    #[schema(maximum = 4294967295_i64)]
    advance_ms: u32,
}

/// The virtual time
#[utoipa::path(get, path = "/time", operation_id = "showTime", tag = "time", responses((status = 200, body = Time)))]
pub(super) async fn show(control: Control) -> Result<Json<Time>, Failure> {
    control.ask(Message::Time).await.map(Json)
}

/// Advances virtual time, and answers afterwards; requires `--speed step`
#[utoipa::path(
    post, path = "/time", operation_id = "advanceTime", tag = "time",
    request_body = Advance,
    responses(
        (status = 200, body = Time),
        (status = 409, body = Error, description = "Time advances automatically without --speed step")
    )
)]
pub(super) async fn advance(
    control: Control,
    Body(Advance { advance_ms }): Body<Advance>,
) -> Result<Json<Time>, Failure> {
    let span = Duration::from_millis(advance_ms.into());
    let Json(reply) = control.execute(Command::Advance(span)).await?;
    let Reply::Advanced(Advanced { now_us }) = reply else { unreachable!("an advance is answered with the time") };
    Ok(Json(Time { now_us, speed: Speed::STEP }))
}
