//! python-can's `udp_multicast`: a bus of datagrams to a multicast group, one per frame. Every member of the group is
//! on the bus.
//!
//! ```text
//! message  datagrams ↔ frames, no I/O
//! group    the sockets, and the frames through them
//! ```

mod group;
mod message;

pub use message::{NoFrame, emit, parse};

use std::io;
use std::net::SocketAddr;

use super::{Gateway, Member as _};
use group::Group;

/// Opens the gateway to a group; `is_remote` lets frames pass to and from other machines.
pub(super) fn open(address: SocketAddr, is_remote: bool) -> io::Result<Gateway> {
    let group = Group::join(address, is_remote)?;
    let (ip, port) = (address.ip(), address.port());
    let hint = format!(
        "Join the bus with python-can and msgpack:\n  \
         can_logger -i udp_multicast -c {ip} --bus-kwargs port={port}\n  \
         can.Bus(interface=\"udp_multicast\", channel=\"{ip}\", port={port})"
    );
    Ok(Gateway::new(format!("udp-multicast://{address}"), hint, |world, _| group.run(world)))
}
