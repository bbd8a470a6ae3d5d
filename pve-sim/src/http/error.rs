//! Error responses as JSON, and the extractors of request bodies, queries and names.

use std::fmt;
use std::time::Duration;

use axum::Json;
use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use serde::de::{self, DeserializeOwned, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};
use tokio::time::timeout;
use utoipa::ToSchema;

use hal_sim::simulation::Refusal;
use hal_sim::state::Invalid;
use hal_sim::state::schema::Schemas;

/// The JSON body of an error response. Nothing has changed, except for the time until a cancelled call ended.
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

/// The maximum size of a request body, in bytes.
pub(super) const BODY_MAX: usize = 64 * 1024;

/// The time limit for receiving the body of a request.
const BODY_TIMEOUT: Duration = Duration::from_secs(10);

/// The body of a request, as JSON.
#[derive(Debug)]
pub(super) struct Body<T>(pub(super) T);

impl<T: DeserializeOwned + ToSchema + 'static, S: Send + Sync> FromRequest<S> for Body<T> {
    type Rejection = Failure;

    async fn from_request(request: Request, state: &S) -> Result<Self, Failure> {
        use axum::extract::rejection::JsonRejection::MissingJsonContentType;

        let (parts, body) = request.into_parts();
        let collected = Bytes::from_request(Request::from_parts(parts.clone(), body), state);
        let Ok(collected) = timeout(BODY_TIMEOUT, collected).await else {
            return Err(Failure::Request(StatusCode::REQUEST_TIMEOUT, "the body was not received in time".to_owned()));
        };
        let bytes = collected.map_err(|error| {
            let reason = match error.status() {
                StatusCode::PAYLOAD_TOO_LARGE => format!("the body is too large; accepted: up to {BODY_MAX} bytes"),
                _ => "the body was not received".to_owned(),
            };
            Failure::Request(error.status(), reason)
        })?;
        let request = Request::from_parts(parts, bytes.into());
        let value = match Json::<Unique>::from_request(request, state).await {
            Ok(Json(Unique(value))) => value,
            Err(MissingJsonContentType(_)) => {
                let reason = "the body must have the Content-Type application/json".to_owned();
                return Err(Failure::Request(StatusCode::UNSUPPORTED_MEDIA_TYPE, reason));
            }
            Err(error) => return Err(not_json(&error)),
        };
        Schemas::of::<T>().check(&T::name(), &value, "null").map_err(Invalid::from)?;
        serde_json::from_value(value).map(Self).map_err(|error| Failure::bad_request(error.to_string()))
    }
}

/// Creates the error for invalid JSON or a duplicate member, without the framework's own wording.
fn not_json(error: &dyn std::error::Error) -> Failure {
    let first = std::iter::successors(Some(error), |error| error.source()).last();
    let reason = first.map_or_else(String::new, ToString::to_string);
    Failure::bad_request(match reason.rsplit_once(" at line ") {
        Some((duplicate, _)) if duplicate.contains(DUPLICATE) => duplicate.to_owned(),
        _ => format!("the body is not JSON: {reason}"),
    })
}

/// The message about a duplicate member, after its place and before its name.
const DUPLICATE: &str = "duplicate member ";

/// A JSON value without duplicate members, of which [`Value`] would keep the last. Whole numbers are integers, because
/// JSON does not distinguish 8.0 from 8.
struct Unique(Value);

impl<'de> Deserialize<'de> for Unique {
    fn deserialize<D: Deserializer<'de>>(value: D) -> Result<Self, D::Error> {
        value.deserialize_any(UniqueVisitor).map(Self)
    }
}

struct UniqueVisitor;

impl<'de> Visitor<'de> for UniqueVisitor {
    type Value = Value;

    fn expecting(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        text.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        /// The limit up to which every whole number has an exact representation.
        const EXACT: f64 = (1_u64 << 53) as f64;
        let is_whole = value.fract() == 0.0 && value.abs() < EXACT;
        Ok(if is_whole { (value as i64).into() } else { value.into() })
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Unique(item)) = items.next_element()? {
            list.push(item);
        }
        Ok(list.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some((key, Unique(value))) = members.next_entry::<String, _>()? {
            if object.contains_key(&key) {
                return Err(de::Error::custom(format_args!("{DUPLICATE}{key}")));
            }
            object.insert(key, value);
        }
        Ok(object.into())
    }
}

/// The query of a request.
#[derive(Debug)]
pub(super) struct Query<T>(pub(super) T);

impl<T: DeserializeOwned + ToSchema + 'static, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Failure;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Failure> {
        let pairs = axum::extract::Query::<Vec<(String, String)>>::from_request_parts(parts, state).await;
        let axum::extract::Query(pairs) = pairs.map_err(|_| Failure::bad_request("the query is not valid"))?;
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
            Err(_) => Err(Failure::bad_request("the name in the path is not UTF-8")),
        }
    }
}
