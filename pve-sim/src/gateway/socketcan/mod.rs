//! SocketCAN: an interface of the Linux kernel as a client of the bus.
//!
//! Frames on the interface, from other programs or from a real bus behind an adapter, reach the world like those of any
//! client; frames of others in the world reach the interface. The kernel does not echo them back.
//!
//! ```text
//! address    the URL, and an example command for joining
//! interface  the socket, and the frames through it
//! health     an interface that takes no frames: retries, and messages to the user. No I/O
//! ```

mod address;
#[cfg(target_os = "linux")]
mod health;
#[cfg(target_os = "linux")]
mod interface;

pub(super) use address::SCHEME;
