//! A bus served over TCP: its URL, and an example command for joining.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use tokio::sync::Semaphore;

use super::beacon::Beacon;
use super::session::Session;
use crate::gateway::address::{Access, Address, Gateway, OpenError, Opening, Parse, Scheme};
use crate::gateway::tcp::{Endpoint, Listener, joinable};
use crate::inbox::WorldSender;

const FORM: &str = "socketcand://HOST:PORT/NAME";

/// The URL scheme of this gateway.
pub(in crate::gateway) const SCHEME: Scheme = Scheme { prefix: "socketcand://", form: FORM, parse: Parse::With(parse) };

/// The maximum length of a bus name, in characters: fits a trace line and the field of every client.
const NAME_MAX: usize = 32;

/// The address of the served bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerAddress {
    endpoint: Endpoint,
    /// The name by which clients open the bus.
    name: String,
}

fn parse(rest: &str) -> Result<Arc<dyn Address>, String> {
    let (endpoint, name) = rest.split_once('/').ok_or_else(|| format!("the bus has no name; accepted: {FORM}"))?;
    let endpoint = Endpoint::parse(endpoint, FORM)?;
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.is_empty() || name.len() > NAME_MAX || !name.chars().all(allowed) {
        return Err(format!(
            "'{name}' is not a valid bus name; accepted: 1–{NAME_MAX} letters, digits, '-', '_' and '.', as in pve0"
        ));
    }
    Ok(Arc::new(ServerAddress { endpoint, name: name.to_owned() }))
}

/// The port of the reference daemon, on loopback only.
impl Default for ServerAddress {
    fn default() -> Self {
        Self { endpoint: Endpoint { host: "127.0.0.1".to_owned(), port: 29536 }, name: "pve0".to_owned() }
    }
}

impl fmt::Display for ServerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&url(&self.endpoint, &self.name))
    }
}

impl Address for ServerAddress {
    fn name(&self) -> &str {
        &self.name
    }

    fn open(&self, access: Access) -> Opening<'_> {
        Box::pin(async move {
            let listener = self.endpoint.bind(|endpoint| url(endpoint, &self.name)).await?;
            let beacon = if access.beacon {
                let beacon = Beacon::new(listener.address, &self.name).await;
                Some(beacon.map_err(|error| OpenError::new(format!("--beacon: {error}")))?)
            } else {
                None
            };
            Ok(Box::new(Server { listener, name: self.name.as_str().into(), beacon }) as Box<dyn Gateway>)
        })
    }
}

fn url(endpoint: impl fmt::Display, name: &str) -> String {
    format!("socketcand://{endpoint}/{name}")
}

/// A bus served at an address.
#[derive(Debug)]
struct Server {
    listener: Listener,
    name: Arc<str>,
    beacon: Option<Beacon>,
}

impl Gateway for Server {
    fn url(&self) -> String {
        url(self.listener.address, &self.name)
    }

    fn hint(&self) -> String {
        hint(self.listener.address, &self.name)
    }

    fn start(self: Box<Self>, world: WorldSender, places: Arc<Semaphore>) {
        let url = self.url();
        let Self { listener, name, beacon } = *self;
        if let Some(beacon) = beacon {
            tokio::spawn(beacon.run());
        }
        tokio::spawn(listener.run(url, world, places, move || Session::new(Arc::clone(&name))));
    }
}

/// Returns an example command for joining a bus, with an address that is reachable from this machine.
fn hint(bound: SocketAddr, name: &str) -> String {
    let address = joinable(bound);
    let port = address.port();
    match address.ip() {
        IpAddr::V4(host) => format!(
            "Join the bus with python-can:\n  \
             can_logger -i socketcand -c {name} --bus-kwargs host={host} port={port}\n  \
             can.Bus(interface=\"socketcand\", host=\"{host}\", port={port}, channel=\"{name}\")\n\
             or with SavvyCAN: {name}@(can://{host}:{port})"
        ),
        IpAddr::V6(_) => format!(
            "Join the bus at can://{address}, name {name}. python-can supports IPv4 only; for python-can, use \
             --bus {}",
            url(format_args!("127.0.0.1:{port}"), name)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hint_at(address: &str) -> String {
        hint(address.parse().expect(address), "pve0")
    }

    #[test]
    fn the_hint_names_an_address_that_works() {
        for (bound, host) in [("127.0.0.2:7", "127.0.0.2"), ("0.0.0.0:7", "127.0.0.1"), ("[::]:7", "127.0.0.1")] {
            let text = hint_at(bound);
            assert!(text.contains(&format!("host={host} port=7\n")), "{text}");
            assert!(text.contains(&format!("host=\"{host}\", port=7, channel=\"pve0\"")), "{text}");
            assert!(text.contains(&format!("pve0@(can://{host}:7)")), "{text}");
        }
        let text = hint_at("[::1]:7");
        assert!(text.contains("can://[::1]:7") && text.contains("--bus socketcand://127.0.0.1:7/pve0"), "{text}");
    }
}
