//! The control interface at the world's end: it executes messages and watches the world for waiting and following clients.
//!
//! ```text
//! message     what is asked of the world, and its answers
//! server      hands commands to the simulation, and answers to those who gave them
//! events      clients that follow
//! ```
//!
//! The world executes each message at the virtual instant of its arrival, and an answer tells of one instant. Nobody but
//! the server touches the world, and it waits for nobody.

pub(crate) mod events;
pub(crate) mod message;
mod server;

#[cfg(test)]
pub(crate) use message::Answer;
pub use message::Message;
pub(crate) use server::ControlServer;
