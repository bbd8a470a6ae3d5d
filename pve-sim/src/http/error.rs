//! Error responses as JSON, and the extractors of request bodies, queries and names.

use std::time::Duration;

use axum::Json;
use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use tokio::time::timeout;
use utoipa::ToSchema;

use hal_sim::simulation::Refusal;
use hal_sim::state::Invalid;
use hal_sim::state::schema::{Schemas, with_whole_numbers};

/// The JSON body of an error response; the request has changed nothing.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Error {
    /// The reason.
    pub(super) error: String,
}

/// A refused request, with its status.
#[derive(Debug)]
pub(super) enum Failure {
    /// Refused before it reached the world.
    Request(StatusCode, String),
    /// Refused by the world.
    World(Refusal),
}

impl Failure {
    /// Creates the error for an invalid value.
    pub(super) fn bad_request(error: impl Into<String>) -> Self {
        Self::Request(StatusCode::BAD_REQUEST, error.into())
    }

    /// Creates the error of a simulator that is shutting down.
    pub(super) fn ending() -> Self {
        Self::Request(StatusCode::SERVICE_UNAVAILABLE, "the simulator is shutting down".to_owned())
    }

    /// Creates the error for a call that waits when its client closes the sending half of the connection.
    pub(super) fn cancelled() -> Self {
        Self::bad_request("cancelled by the end of the requests; a call that waits must keep the connection open")
    }

    /// Creates the error for a call beyond the limit of waiting calls.
    pub(super) fn crowded() -> Self {
        let error = "too many calls are waiting for virtual time; try again later".to_owned();
        Self::Request(StatusCode::SERVICE_UNAVAILABLE, error)
    }
}

impl From<Invalid> for Failure {
    fn from(Invalid(reason): Invalid) -> Self {
        Self::bad_request(reason)
    }
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Self::World(refusal)
    }
}

impl IntoResponse for Failure {
    fn into_response(self) -> Response {
        let (status, error) = match self {
            Self::Request(status, error) => (status, error),
            Self::World(Refusal::TimedOut(timed_out)) => {
                return (StatusCode::REQUEST_TIMEOUT, Json(timed_out)).into_response();
            }
            Self::World(refusal) => (status(&refusal), refusal.to_string()),
        };
        (status, Json(Error { error })).into_response()
    }
}

const fn status(refusal: &Refusal) -> StatusCode {
    match refusal {
        Refusal::Unknown(_) => StatusCode::NOT_FOUND,
        Refusal::Conflict(_) => StatusCode::CONFLICT,
        Refusal::TimedOut(_) => StatusCode::REQUEST_TIMEOUT,
        Refusal::TooMany(_) => StatusCode::SERVICE_UNAVAILABLE,
        _ => StatusCode::BAD_REQUEST,
    }
}

/// The time limit for receiving the body of a request.
const BODY_TIMEOUT: Duration = Duration::from_secs(10);

/// The body of a request, as JSON.
#[derive(Debug)]
pub(super) struct Body<T>(pub(super) T);

impl<T: DeserializeOwned + ToSchema + 'static, S: Send + Sync> FromRequest<S> for Body<T> {
    type Rejection = Failure;

    async fn from_request(request: Request, state: &S) -> Result<Self, Failure> {
        use axum::extract::rejection::JsonRejection::JsonSyntaxError;
        let (parts, body) = request.into_parts();
        let collected = Bytes::from_request(Request::from_parts(parts.clone(), body), state);
        let Ok(collected) = timeout(BODY_TIMEOUT, collected).await else {
            return Err(Failure::Request(StatusCode::REQUEST_TIMEOUT, "the body was not received in time".to_owned()));
        };
        let bytes = collected.map_err(|error| Failure::Request(error.status(), error.body_text()))?;
        let request = Request::from_parts(parts, bytes.clone().into());
        let value = match Json::<Value>::from_request(request, state).await {
            Ok(Json(value)) => with_whole_numbers(value),
            Err(JsonSyntaxError(error)) => return Err(not_json(&error)),
            Err(error) => return Err(Failure::Request(error.status(), error.body_text())),
        };
        Schemas::of::<T>().check(&T::name(), &value, "null").map_err(Invalid::from)?;
        // The text is parsed first, because a JSON value has only the last of duplicate members.
        match serde_json::from_slice(&bytes) {
            Err(error) if !error.to_string().starts_with(TWICE) => serde_json::from_value(value),
            read => read,
        }
        .map(Self)
        .map_err(|error| not_json(&error))
    }
}

/// The beginning of the message about a duplicate member.
const TWICE: &str = "duplicate field `";

/// Creates the error for invalid JSON or a duplicate member, without the framework's own wording.
fn not_json(error: &dyn std::error::Error) -> Failure {
    let first = std::iter::successors(Some(error), |error| error.source()).last();
    let reason = first.map_or_else(String::new, ToString::to_string);
    let twice = reason.strip_prefix(TWICE).and_then(|rest| rest.split_once('`'));
    Failure::bad_request(match twice {
        Some((member, _)) => format!("duplicate member {member}"),
        None if reason.contains(" must be ") => reason,
        None => format!("the body is not JSON: {reason}"),
    })
}

/// The query of a request.
#[derive(Debug)]
pub(super) struct Query<T>(pub(super) T);

impl<T: DeserializeOwned + ToSchema + 'static, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Failure> {
        let pairs = axum::extract::Query::<Vec<(String, String)>>::from_request_parts(parts, state).await;
        let axum::extract::Query(pairs) = pairs.map_err(|error| Failure::bad_request(error.body_text()))?;
        let schemas = Schemas::of::<T>();
        let mut query = Map::new();
        for (key, text) in pairs {
            let value = schemas.value_of(&T::name(), &key, &text);
            if query.insert(key.clone(), value).is_some() {
                return Err(Failure::bad_request(format!("duplicate parameter {key}")));
            }
        }
        let query = Value::Object(query);
        schemas.check(&T::name(), &query, "null").map_err(Invalid::from)?;
        serde_json::from_value(query).map(Self).map_err(|error| Failure::bad_request(error.to_string()))
    }
}

/// A name in the path.
#[derive(Debug)]
pub(super) struct Name(pub(super) String);

impl<S: Send + Sync> FromRequestParts<S> for Name {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Failure> {
        match axum::extract::Path::from_request_parts(parts, state).await {
            Ok(axum::extract::Path(name)) => Ok(Self(name)),
            Err(error) => Err(Failure::bad_request(error.body_text())),
        }
    }
}
