//! python-can's `udp_multicast`: a bus of datagrams to a multicast group, a frame each. Who is in the group is on the
//! bus.
//!
//! ```text
//! message  datagrams ↔ frames, no I/O
//! group    the sockets, and the way of frames through them
//! address  the URL, and what to type to join
//! ```

mod address;
mod group;
mod message;

pub(super) use address::SCHEME;
pub use message::{NoFrame, emit, parse};
