//! The control interface: state, faults and time of the simulator over HTTP, under `/api/v1`, and the panel, which uses
//! it.
//!
//! ```text
//! server      the socket                connection the connections, and which goes when there are too many
//! guard       which requests are refused: foreign hosts, foreign pages
//! error       refusals as JSON, and what reads a request
//! routes/     the calls, by resource, their description in OpenAPI, and the panel at `/`
//!
//! message     what the calls ask of the world, and its answers
//! record      frames as JSON
//!
//! desk        the world's end: obeys messages, and watches the world
//! wait        clients that wait          events     clients that follow
//! ```
//!
//! The world obeys each message at the virtual instant of its arrival, and an answer tells of one instant. Nobody but
//! the desk touches the world, and the desk waits for nobody.

mod connection;
mod desk;
mod error;
mod events;
mod guard;
mod message;
mod record;
mod routes;
mod server;
mod wait;

#[cfg(test)]
mod tests;

pub(crate) use desk::Desk;
pub use message::Message;
#[cfg(test)]
pub(crate) use message::{Answer, Refusal, Waited};
pub(crate) use server::Server;
pub use server::serve;
