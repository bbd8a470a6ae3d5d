//! SocketCAN: a Linux kernel interface as a client of the bus.
//!
//! Frames on the interface, from other programs or from a real bus behind an adapter, enter the world like the frames
//! of any client; all other frames in the world are sent to the interface. The kernel does not echo them back.
//!
//! ```text
//! address    the URL, and an example command for joining
//! interface  the socket, and the frames through it
//! health     retries while an interface accepts no frames, and messages to the user. No I/O
//! ```

mod address;
#[cfg(target_os = "linux")]
mod health;
#[cfg(target_os = "linux")]
mod interface;

pub(super) use address::SCHEME;
