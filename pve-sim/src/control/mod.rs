//! The world's side of the control interface: executes messages, and monitors the world for clients that wait or
//! follow the events.
//!
//! ```text
//! message     messages to the world, and their answers
//! server      executes messages and returns their answers
//! events      the event stream for followers
//! ```
//!
//! The world executes each message at the virtual instant of its arrival, and an answer describes a single instant.
//! Only the server accesses the world, and the server never waits for a client.

pub(crate) mod events;
pub(crate) mod message;
mod server;

#[cfg(test)]
pub(crate) use message::Answer;
pub use message::Message;
pub(crate) use server::ControlServer;
