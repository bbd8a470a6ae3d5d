//! SocketCAN: an interface of the Linux kernel as a client of the bus.
//!
//! Frames on the interface, from other programs or from a real bus behind an adapter, reach the world as those of any
//! client; frames that others send in the world reach the interface. The kernel does not echo them back.
//!
//! ```text
//! address    the URL, and what to type to join
//! interface  the socket, and the way of frames through it
//! health     an interface that takes no frames: whether a frame is tried again, and what the user is told. No I/O
//! ```

mod address;
#[cfg(target_os = "linux")]
mod health;
#[cfg(target_os = "linux")]
mod interface;

pub(super) use address::SCHEME;
