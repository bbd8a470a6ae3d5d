//! The control interface at the world's end: it obeys messages, and watches the world for those who wait or follow.
//!
//! ```text
//! message     what is asked of the world, and its answers     refusal   why something was refused
//! record      frames as JSON
//! desk        obeys messages, and watches the world
//! wait        clients that wait                               events    clients that follow
//! ```
//!
//! The world obeys each message at the virtual instant of its arrival, and an answer tells of one instant. Nobody but
//! the desk touches the world, and the desk waits for nobody.

mod desk;
pub(crate) mod events;
pub(crate) mod message;
pub(crate) mod record;
pub(crate) mod refusal;
mod wait;

#[cfg(test)]
mod tests;

pub(crate) use desk::Desk;
pub use message::Message;
#[cfg(test)]
pub(crate) use message::{Answer, Waited};
#[cfg(test)]
pub(crate) use refusal::Refusal;
