//! `/cell`: the judged cell of a campaign.

use axum::Json;

use super::Control;
use crate::control::{JudgedCell, Message};
use crate::http::error::{Error, Failure};

/// The judged cell of a campaign, with its verdict once the verdict is final
#[utoipa::path(
    get, path = "/cell", operation_id = "showCell", tag = "time",
    responses(
        (status = 200, body = JudgedCell),
        (status = 409, body = Error, description = "No cell is judged without --plan and --cell")
    )
)]
pub(super) async fn show(control: Control) -> Result<Json<JudgedCell>, Failure> {
    control.ask(Message::Cell).await.map(Json)
}
