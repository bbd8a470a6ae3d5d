//! The control interface over HTTP, under `/api/v1`, and the panel, which uses it.
//!
//! ```text
//! server      the socket                connection the connections, and which goes when there are too many
//! guard       which requests are refused: foreign hosts, foreign pages
//! error       refusals as JSON, and what reads a request
//! routes/     the calls, by resource, their description in OpenAPI, and the panel at `/`
//! ```

mod connection;
mod error;
mod guard;
mod routes;
mod server;

pub(crate) use server::Server;
pub use server::serve;
