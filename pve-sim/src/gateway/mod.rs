//! Gateways: connect clients outside the simulator to the bus.
//!
//! ```text
//! bus_url      the URLs of --bus, with a line for every gateway
//! address      the interface of gateways: Scheme, Address, Gateway
//! tcp          gateways over TCP: the listening socket and its clients
//! guard        the guard of connections over TCP against web pages
//! session      the session of one client over a stream
//! socketcand/  a bus over TCP in readable text
//! socketcan/   an interface of the Linux kernel
//! slcan/       an adapter on a serial line, over TCP or on a pseudo-terminal
//! udp_multicast/ the bus of python-can's udp_multicast
//! member       gateways that are a single client for the whole run
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
