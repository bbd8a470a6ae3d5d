//! python-can's `udp_multicast`: a bus of datagrams to a multicast group, one per frame. Every member of the group is
//! on the bus.
//!
//! ```text
//! message  datagrams ↔ frames, no I/O
//! group    the sockets, and the frames through them
//! address  the URL, and an example command for joining
//! ```

mod address;
mod group;
mod message;

pub(super) use address::SCHEME;
pub use message::{NoFrame, emit, parse};
