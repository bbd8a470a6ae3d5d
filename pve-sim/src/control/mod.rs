//! The control interface at the world's end: it executes messages, and watches the world for waiting and following
//! clients.
//!
//! ```text
//! message     messages to the world, and their answers
//! server      executes messages and returns their answers
//! events      the event stream for followers
//! ```
//!
//! The world executes each message at the virtual instant of its arrival, and an answer describes a single instant.
//! Only the server touches the world, and it never waits for a client.

pub(crate) mod events;
pub(crate) mod message;
mod server;

#[cfg(test)]
pub(crate) use message::Answer;
pub use message::Message;
pub(crate) use server::ControlServer;
