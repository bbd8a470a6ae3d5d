//! `/cell`: the cell of a campaign that is judged.

use axum::Json;

use super::Control;
use crate::control::{JudgedCell, Message};
use crate::http::error::{Error, Failure};

/// The cell of a campaign that is judged, with its verdict once it is final
#[utoipa::path(
    get, path = "/cell", operation_id = "showCell", tag = "time",
    responses(
        (status = 200, body = JudgedCell),
        (status = 409, body = Error, description = "No cell is judged: no --plan")
    )
)]
pub(super) async fn show(control: Control) -> Result<Json<JudgedCell>, Failure> {
    control.ask(Message::Cell).await.map(Json)
}
