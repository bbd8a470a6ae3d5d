//! The control interface at the world's end: it obeys messages, and watches the world for those who wait or follow.
//!
//! ```text
//! message     what is asked of the world, and its answers
//! desk        hands commands to the simulation, and answers to those who gave them
//! events      clients that follow
//! ```
//!
//! The world obeys each message at the virtual instant of its arrival, and an answer tells of one instant. Nobody but
//! the desk touches the world, and the desk waits for nobody.

mod desk;
pub(crate) mod events;
pub(crate) mod message;

pub(crate) use desk::Desk;
#[cfg(test)]
pub(crate) use message::Answer;
pub use message::Message;
