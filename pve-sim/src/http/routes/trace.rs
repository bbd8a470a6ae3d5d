//! `/trace`: the last frames and errors of the bus.

use axum::Json;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::Control;
use crate::control::Message;
use crate::http::error::{Failure, Query};
use hal_sim::simulation::{KEPT, TraceRecord};

/// The default number of entries.
const LIMIT: usize = 100;

/// The query of a request for the trace.
#[derive(Clone, Copy, Debug, Deserialize, IntoParams, ToSchema)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Part {
    /// The number of latest entries, 100 by default. The simulator keeps the last 4096.
    #[param(maximum = 4294967295_i64)]
    #[schema(maximum = 4294967295_i64)]
    limit: Option<u32>,
}

/// The last frames and errors of the bus, oldest first; an error has no `id`
#[utoipa::path(
    get, path = "/trace", operation_id = "showTrace", tag = "trace",
    params(Part),
    responses((status = 200, body = Vec<TraceRecord>))
)]
pub(super) async fn show(control: Control, Query(part): Query<Part>) -> Result<Json<Vec<TraceRecord>>, Failure> {
    let limit = part.limit.map_or(LIMIT, |limit| usize::try_from(limit).unwrap_or(KEPT)).min(KEPT);
    control.ask(|answer| Message::Trace(limit, answer)).await.map(|excerpt| Json(excerpt.records()))
}
