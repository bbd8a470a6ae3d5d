//! The URLs of `--bus`, with a variant for every gateway.

use std::fmt;
use std::io;
use std::net::{IpAddr, SocketAddr};
#[cfg(unix)]
use std::path::PathBuf;
use std::str::FromStr;

#[cfg(target_os = "linux")]
use super::socketcan;
use super::tcp::Endpoint;
use super::{Gateway, slcan, socketcand, udp_multicast};

/// The name of a bus whose URL contains no name.
const UNNAMED: &str = "pve0";

/// The maximum length of the name of a socketcand bus, in characters: fits a trace line and every client's name field.
const BUS_NAME_MAX: usize = 32;

/// The maximum length of a Linux interface name, in characters.
#[cfg(target_os = "linux")]
const INTERFACE_NAME_MAX: usize = 15;

/// The default port of a multicast group, as in python-can.
const MULTICAST_PORT: u16 = 43113;

/// The URL of a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BusUrl {
    /// `socketcand://HOST:PORT/NAME`: an endpoint, and the name by which clients open the bus.
    Socketcand(Endpoint, String),
    /// `socketcan:IFACE`: an interface of the Linux kernel, which may not exist.
    #[cfg(target_os = "linux")]
    Socketcan(String),
    /// `slcan://HOST:PORT`: an endpoint.
    Slcan(Endpoint),
    /// `slcan+pty:PATH`: the path of the link to the pseudo-terminal.
    #[cfg(unix)]
    SlcanPty(PathBuf),
    /// `udp-multicast://GROUP:PORT`: a group with its port.
    UdpMulticast(SocketAddr),
}

impl BusUrl {
    /// Returns the name of the bus in traces and logs.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Socketcand(_, name) => name,
            #[cfg(target_os = "linux")]
            Self::Socketcan(name) => name,
            _ => UNNAMED,
        }
    }

    /// Returns whether the bus is an interface of the kernel, which runs only in wall time and may have real devices.
    #[must_use]
    pub const fn is_interface(&self) -> bool {
        #[cfg(target_os = "linux")]
        return matches!(self, Self::Socketcan(_));
        #[cfg(not(target_os = "linux"))]
        false
    }

    /// Returns whether other programs share the bus. If such a bus were given twice, each frame would circulate
    /// forever.
    #[must_use]
    pub const fn is_shared(&self) -> bool {
        self.is_interface() || matches!(self, Self::UdpMulticast(_))
    }

    /// Opens the gateway; requires a Tokio runtime. `beacon` announces a socketcand bus, and `allow_remote` opens a
    /// multicast group to other machines.
    ///
    /// # Errors
    /// When the address is in use or unreachable, or the interface does not exist.
    pub async fn open(&self, beacon: bool, allow_remote: bool) -> io::Result<Gateway> {
        let opened = match self {
            Self::Socketcand(endpoint, name) => socketcand::open(endpoint, name, beacon).await,
            #[cfg(target_os = "linux")]
            Self::Socketcan(name) => socketcan::open(name),
            Self::Slcan(endpoint) => slcan::open(endpoint).await,
            #[cfg(unix)]
            Self::SlcanPty(path) => slcan::pty::open(path),
            Self::UdpMulticast(group) => udp_multicast::open(*group, allow_remote),
        };
        opened.map_err(|error| match self.with_free_port().filter(|_| error.kind() == io::ErrorKind::AddrInUse) {
            Some(free) => {
                io::Error::other(format!("{error}; is another pve-sim running? --bus {free} selects a free port"))
            }
            None => error,
        })
    }

    /// Returns the URL with port 0, if it is served over TCP.
    fn with_free_port(&self) -> Option<Self> {
        let mut free = self.clone();
        let (Self::Socketcand(endpoint, _) | Self::Slcan(endpoint)) = &mut free else { return None };
        endpoint.port = 0;
        Some(free)
    }
}

/// The default of `--bus`: the port of the reference daemon, on loopback only.
impl Default for BusUrl {
    fn default() -> Self {
        Self::Socketcand(Endpoint { host: "127.0.0.1".to_owned(), port: 29536 }, UNNAMED.to_owned())
    }
}

impl fmt::Display for BusUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socketcand(endpoint, name) => write!(f, "socketcand://{endpoint}/{name}"),
            #[cfg(target_os = "linux")]
            Self::Socketcan(name) => write!(f, "socketcan:{name}"),
            Self::Slcan(endpoint) => write!(f, "slcan://{endpoint}"),
            #[cfg(unix)]
            Self::SlcanPty(path) => write!(f, "slcan+pty:{}", path.display()),
            Self::UdpMulticast(group) => write!(f, "udp-multicast://{group}"),
        }
    }
}

const SOCKETCAND: &str = "socketcand://HOST:PORT/NAME";
const SOCKETCAN: &str = "socketcan:IFACE";
const SLCAN: &str = "slcan://HOST:PORT";
const SLCAN_PTY: &str = "slcan+pty:PATH";
const UDP_MULTICAST: &str = "udp-multicast://GROUP:PORT";

/// The forms of the URLs that this system supports.
const FORMS: &[&str] = &[
    SOCKETCAND,
    #[cfg(target_os = "linux")]
    SOCKETCAN,
    SLCAN,
    #[cfg(unix)]
    SLCAN_PTY,
    UDP_MULTICAST,
];

impl FromStr for BusUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(rest) = text.strip_prefix("socketcand://") {
            bus(rest)
        } else if let Some(name) = text.strip_prefix("socketcan:") {
            interface(name)
        } else if let Some(rest) = text.strip_prefix("slcan://") {
            Endpoint::parse(rest, SLCAN).map(Self::Slcan)
        } else if let Some(path) = text.strip_prefix("slcan+pty:") {
            link(path)
        } else if let Some(rest) = text.strip_prefix("udp-multicast://") {
            group(rest)
        } else {
            Err(format!("not a supported bus; accepted: {}", FORMS.join(", ")))
        }
    }
}

fn bus(text: &str) -> Result<BusUrl, String> {
    let (endpoint, name) =
        text.split_once('/').ok_or_else(|| format!("the bus has no name; accepted: {SOCKETCAND}"))?;
    let endpoint = Endpoint::parse(endpoint, SOCKETCAND)?;
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.is_empty() || name.len() > BUS_NAME_MAX || !name.chars().all(allowed) {
        return Err(format!(
            "'{name}' is not a valid bus name; accepted: 1–{BUS_NAME_MAX} letters, digits, '-', '_' and '.', as in pve0"
        ));
    }
    Ok(BusUrl::Socketcand(endpoint, name.to_owned()))
}

#[cfg(not(target_os = "linux"))]
fn interface(_: &str) -> Result<BusUrl, String> {
    Err(format!("{SOCKETCAN} is available on Linux only; accepted: {}", FORMS.join(", ")))
}

#[cfg(target_os = "linux")]
fn interface(name: &str) -> Result<BusUrl, String> {
    let allowed = |c: char| c.is_ascii_graphic() && c != '/' && c != ':';
    if name.is_empty() || name.len() > INTERFACE_NAME_MAX || !name.chars().all(allowed) {
        return Err(format!(
            "'{name}' is not a valid interface name; accepted: 1–{INTERFACE_NAME_MAX} visible characters without / and :, as in vcan0"
        ));
    }
    Ok(BusUrl::Socketcan(name.to_owned()))
}

#[cfg(not(unix))]
fn link(_: &str) -> Result<BusUrl, String> {
    Err(format!("{SLCAN_PTY} is available on Unix only; accepted: {}", FORMS.join(", ")))
}

#[cfg(unix)]
fn link(path: &str) -> Result<BusUrl, String> {
    // In the ready line, a space ends each URL.
    if path.is_empty() || path.chars().any(|c| c.is_whitespace() || c.is_control()) {
        return Err(format!(
            "'{path}' is not a valid path for a link; accepted: {SLCAN_PTY}, without spaces, as in slcan+pty:/tmp/pve0"
        ));
    }
    Ok(BusUrl::SlcanPty(path.into()))
}

fn group(text: &str) -> Result<BusUrl, String> {
    let without_port = || text.trim_matches(['[', ']']).parse::<IpAddr>().map(|ip| SocketAddr::new(ip, MULTICAST_PORT));
    match text.parse().or_else(|_| without_port()) {
        Ok(group) if group.ip().is_multicast() && group.port() != 0 => Ok(BusUrl::UdpMulticast(group)),
        _ => Err(format!(
            "'{text}' is not a multicast group with a port; accepted: {UDP_MULTICAST}, as in \
             udp-multicast://239.74.163.2:{MULTICAST_PORT}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_port_in_use_names_the_way_out() {
        let taken = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let open = async |url: String| {
            let opened = url.parse::<BusUrl>().expect("a URL").open(false, false).await;
            opened.err().expect("an error").to_string()
        };
        let told = open(format!("slcan://{}", taken.local_addr().expect("its address"))).await;
        assert!(told.ends_with("is another pve-sim running? --bus slcan://127.0.0.1:0 selects a free port"), "{told}");
        let told = open("slcan://192.0.2.1:0".to_owned()).await;
        assert!(!told.contains("--bus"), "no address of this machine: {told}");
    }
}
