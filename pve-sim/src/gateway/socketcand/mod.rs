//! socketcand: a CAN bus over TCP in readable text, compatible with the daemon of that name.
//!
//! The server greets a client with `< hi >`; the client opens the bus by name, requests raw mode, and then sends and
//! receives frames:
//!
//! ```text
//! server                                          client
//! < hi >
//!                                                 < open pve0 >
//! < ok >
//!                                                 < rawmode >
//! < ok >
//!                                                 < send 000 2 1 0 >
//! < frame 1A0 1795223549.715344 0100 >
//! ```
//!
//! The other modes of the reference daemon (`bcmmode`, `controlmode`, `isotpmode`) are not supported: no client in the
//! README's table uses them.
//!
//! The protocol has no form for remote frames. python-can sends a remote frame as a `send` with a length and no bytes,
//! which is accepted as a remote frame. Remote frames of other senders are not passed on, because they would become
//! data frames.

mod beacon;
mod protocol;
mod session;

pub use protocol::{MESSAGE_MAX, Parser, Refusal, Request, emit_frame};
pub use session::Session;

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use super::Gateway;
use super::tcp::{Endpoint, joinable};
use beacon::Beacon;

/// Opens the gateway: a bus of this name, announced by beacons if `beacon` is set.
pub(super) async fn open(endpoint: &Endpoint, name: &str, beacon: bool) -> io::Result<Gateway> {
    let listener = endpoint.bind().await?;
    let address = listener.address;
    let beacon = match beacon {
        true => Some(Beacon::new(address, name).await.map_err(|error| io::Error::other(format!("--beacon: {error}")))?),
        false => None,
    };
    let (url, name) = (url(address, name), Arc::<str>::from(name));
    let hint = hint(address, &name);
    Ok(Gateway::new(url.clone(), hint, |world, places| {
        if let Some(beacon) = beacon {
            tokio::spawn(beacon.run());
        }
        listener.run(url, world, places, move || Session::new(Arc::clone(&name)))
    }))
}

fn url(address: SocketAddr, name: &str) -> String {
    format!("socketcand://{address}/{name}")
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
            url(([127, 0, 0, 1], port).into(), name)
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
