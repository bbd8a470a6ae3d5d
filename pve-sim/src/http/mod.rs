//! The control interface over HTTP, under `/api/v1`, and the panel, which uses it.
//!
//! ```text
//! server      the socket
//! connection  the connections, limited in number
//! guard       the guard against foreign hosts and pages
//! error       refusals as JSON, and the extractors of requests
//! routes/     the calls, by resource, their description in OpenAPI, and the panel at `/`
//! ```

mod connection;
mod error;
mod guard;
mod routes;
mod server;

pub use server::serve;
pub(crate) use server::start;
