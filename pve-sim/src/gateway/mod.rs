//! Gateways: clients of the bus that live outside of the world.
//!
//! ```text
//! bus_url      the URLs of --bus: every gateway has one line there
//! address      what a gateway is to the simulator: Scheme, Address, Gateway
//! tcp          gateways over TCP: the listening socket, and the one way in for their clients
//! guard        the first bytes over TCP: connections of web pages are closed before anything is obeyed
//! session      one client over a stream, from its first byte to its last
//! socketcand/  a bus over TCP in readable text
//! socketcan/   an interface of the Linux kernel
//! slcan/       an adapter on a serial line, over TCP or on a pseudo-terminal
//! udp_multicast/ the bus of python-can's udp_multicast
//! member       gateways that are one client for as long as the world runs
//! ```

mod address;
mod bus_url;
mod guard;
mod member;
mod session;
pub mod slcan;
mod socketcan;
pub mod socketcand;
mod tcp;
pub mod udp_multicast;

pub use address::{Access, Address, Gateway, OpenError, Opening, Parse, Scheme};
pub use bus_url::BusUrl;
pub use guard::{ForeignWarning, Judge, Verdict};
pub use session::{Client, Dialogue, End};
pub use tcp::enter;
pub(crate) use tcp::{WAITING, joinable};
