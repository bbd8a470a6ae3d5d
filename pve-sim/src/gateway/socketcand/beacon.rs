//! The beacon that announces a bus: an XML datagram to UDP port 42000, as the reference daemon sends it.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio::net::UdpSocket;

const PORT: u16 = 42000;

/// The interval between beacons: clients listen for about three seconds.
const EVERY: Duration = Duration::from_secs(2);

#[derive(Debug)]
pub(super) struct Beacon {
    socket: UdpSocket,
    target: SocketAddr,
    text: String,
}

impl Beacon {
    /// Creates the beacon of a bus served at an address. A bus on loopback or on all addresses is announced only on
    /// this machine; the latter as 127.0.0.1.
    ///
    /// # Errors
    /// When the address is not IPv4 (IPv6 has no broadcast), or the system refuses the socket.
    pub(super) async fn new(served: SocketAddr, bus: &str) -> io::Result<Self> {
        let IpAddr::V4(served_ip) = served.ip() else {
            return Err(io::Error::new(io::ErrorKind::Unsupported, "a beacon needs an IPv4 address"));
        };
        let ip = if served_ip.is_unspecified() { Ipv4Addr::LOCALHOST } else { served_ip };
        let all = if ip.is_loopback() { Ipv4Addr::new(127, 255, 255, 255) } else { Ipv4Addr::BROADCAST };
        Self::to((all, PORT).into(), ip, served.port(), bus).await
    }

    async fn to(target: SocketAddr, ip: Ipv4Addr, port: u16, bus: &str) -> io::Result<Self> {
        let socket = UdpSocket::bind((ip, 0)).await?;
        socket.set_broadcast(true)?;
        Ok(Self { socket, target, text: text(ip, port, bus) })
    }

    /// Sends the beacon periodically, forever. A failed datagram is not repeated before the next period.
    pub(super) async fn run(self) {
        let mut every = tokio::time::interval(EVERY);
        loop {
            every.tick().await;
            let _ = self.socket.send_to(self.text.as_bytes(), self.target).await;
        }
    }
}

/// Returns the text of the beacon. Bus names need no XML escaping.
fn text(ip: Ipv4Addr, port: u16, bus: &str) -> String {
    format!(
        "<CANBeacon name=\"pve-sim\" type=\"SocketCAN\" description=\"simulated devices\">\n\
         <URL>can://{ip}:{port}</URL><Bus name=\"{bus}\"/></CANBeacon>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_beacon_names_address_and_bus() {
        let client = UdpSocket::bind("127.0.0.1:0").await.expect("a port");
        let target = client.local_addr().expect("its address");
        let beacon = Beacon::to(target, Ipv4Addr::LOCALHOST, 29536, "pve0").await.expect("a beacon");
        let beacon = tokio::spawn(beacon.run());
        let mut bytes = [0; 512];
        let len = client.recv(&mut bytes).await.expect("a datagram");
        assert_eq!(
            String::from_utf8_lossy(&bytes[..len]),
            "<CANBeacon name=\"pve-sim\" type=\"SocketCAN\" description=\"simulated devices\">\n\
             <URL>can://127.0.0.1:29536</URL><Bus name=\"pve0\"/></CANBeacon>"
        );
        beacon.abort();
    }

    #[tokio::test]
    async fn who_is_told_depends_on_who_can_join() {
        for (served, url) in [("127.0.0.1:7", "can://127.0.0.1:7"), ("0.0.0.0:7", "can://127.0.0.1:7")] {
            let beacon = Beacon::new(served.parse().expect("an address"), "pve0").await.expect("a beacon");
            assert_eq!(beacon.target.to_string(), "127.255.255.255:42000");
            assert!(beacon.text.contains(url), "{}", beacon.text);
        }
        assert!(Beacon::new("[::1]:7".parse().expect("an address"), "pve0").await.is_err());
    }
}
