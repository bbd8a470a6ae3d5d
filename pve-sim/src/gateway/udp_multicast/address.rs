//! The URL of a group, and an example command for joining.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use tokio::sync::Semaphore;

use super::group::Group;
use crate::gateway::member::Member;
use crate::gateway::{Access, Address, Gateway, Opening, Parse, Scheme};
use crate::inbox::WorldSender;

const FORM: &str = "udp-multicast://GROUP:PORT";

/// The URL scheme of this gateway.
pub(in crate::gateway) const SCHEME: Scheme =
    Scheme { prefix: "udp-multicast://", form: FORM, parse: Parse::With(parse) };

/// The default port, as in python-can.
const PORT: u16 = 43113;

/// A group with its port.
#[derive(Clone, Copy, Debug)]
struct GroupAddress(SocketAddr);

fn parse(rest: &str) -> Result<Arc<dyn Address>, String> {
    let without_port = || rest.trim_matches(['[', ']']).parse::<IpAddr>().map(|ip| SocketAddr::new(ip, PORT));
    match rest.parse().or_else(|_| without_port()) {
        Ok(address) if address.ip().is_multicast() && address.port() != 0 => Ok(Arc::new(GroupAddress(address))),
        _ => Err(format!(
            "'{rest}' is not a multicast group with a port; accepted: {FORM}, as in udp-multicast://239.74.163.2:{PORT}"
        )),
    }
}

impl fmt::Display for GroupAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "udp-multicast://{}", self.0)
    }
}

impl Address for GroupAddress {
    fn is_shared(&self) -> bool {
        true
    }

    fn open(&self, access: Access) -> Opening<'_> {
        Box::pin(async move {
            let group = Group::join(self.0, access.remote)?;
            Ok(Box::new(Joined { address: *self, group }) as Box<dyn Gateway>)
        })
    }
}

/// A joined group.
#[derive(Debug)]
struct Joined {
    address: GroupAddress,
    group: Group,
}

impl Gateway for Joined {
    fn url(&self) -> String {
        self.address.to_string()
    }

    fn hint(&self) -> String {
        let GroupAddress(address) = self.address;
        let (group, port) = (address.ip(), address.port());
        format!(
            "Join the bus with python-can and msgpack:\n  \
             can_logger -i udp_multicast -c {group} --bus-kwargs port={port}\n  \
             can.Bus(interface=\"udp_multicast\", channel=\"{group}\", port={port})"
        )
    }

    fn start(self: Box<Self>, world: WorldSender, _: Arc<Semaphore>) {
        tokio::spawn(self.group.run(world));
    }
}
