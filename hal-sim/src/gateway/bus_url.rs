//! Where a bus is reachable: the URLs of `--bus`.

use std::fmt;
use std::str::FromStr;

/// The longest name of a bus, in characters: fits a line of the trace and every client's field for it.
const NAME_MAX: usize = 32;

/// The longest name of an interface that Linux gives, in characters.
#[cfg(target_os = "linux")]
const INTERFACE_MAX: usize = 15;

/// Where a bus is reachable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BusUrl {
    /// `socketcand://HOST:PORT/NAME`
    Socketcand(ServerUrl),
    /// `socketcan:IFACE`, by the name of the interface.
    #[cfg(target_os = "linux")]
    Socketcan(String),
}

/// A socketcand server to be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerUrl {
    /// The address to listen at: a name, an IPv4 address, or an IPv6 address in brackets.
    pub host: String,
    /// The TCP port; 0 takes a free one.
    pub port: u16,
    /// The name by which clients open the bus.
    pub name: String,
}

impl BusUrl {
    /// What `--bus` is when it is not given.
    #[must_use]
    pub fn default_server() -> Self {
        Self::Socketcand(ServerUrl { host: "127.0.0.1".to_owned(), port: 29536, name: "pve0".to_owned() })
    }

    /// The name of the bus, in traces and logs.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Socketcand(server) => &server.name,
            #[cfg(target_os = "linux")]
            Self::Socketcan(interface) => interface,
        }
    }

    /// Whether other programs, or a real bus, are there in wall time alone.
    #[must_use]
    pub const fn is_real_time(&self) -> bool {
        match self {
            Self::Socketcand(_) => false,
            #[cfg(target_os = "linux")]
            Self::Socketcan(_) => true,
        }
    }
}

impl ServerUrl {
    /// Host and port, as a resolver takes them.
    #[must_use]
    pub fn authority(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }
}

impl fmt::Display for BusUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socketcand(server) => server.fmt(f),
            #[cfg(target_os = "linux")]
            Self::Socketcan(interface) => write!(f, "socketcan:{interface}"),
        }
    }
}

impl fmt::Display for ServerUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "socketcand://{}:{}/{}", self.host, self.port, self.name)
    }
}

impl FromStr for BusUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(interface) = text.strip_prefix("socketcan:") {
            return socketcan(interface);
        }
        let rest =
            text.strip_prefix("socketcand://").ok_or_else(|| format!("not a bus that can be served; {ACCEPTED}"))?;
        let (authority, name) = rest.split_once('/').ok_or_else(|| format!("the bus has no name; {ACCEPTED}"))?;
        let (host, port) = authority.rsplit_once(':').ok_or_else(|| format!("the port is missing; {ACCEPTED}"))?;
        if host.is_empty() || (host.contains(':') && !(host.starts_with('[') && host.ends_with(']'))) {
            return Err(format!("'{host}' is no host; {ACCEPTED}"));
        }
        let port = port.parse().map_err(|_| format!("'{port}' is no port; accepted: 0–65535, 0 takes a free one"))?;
        let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        if name.is_empty() || name.len() > NAME_MAX || !name.chars().all(allowed) {
            return Err(format!(
                "'{name}' is no name of a bus; accepted: 1–{NAME_MAX} letters, digits, '-', '_' and '.', as in pve0"
            ));
        }
        Ok(Self::Socketcand(ServerUrl { host: host.to_owned(), port, name: name.to_owned() }))
    }
}

#[cfg(target_os = "linux")]
const ACCEPTED: &str = "accepted: socketcand://HOST:PORT/NAME, socketcan:IFACE";
#[cfg(not(target_os = "linux"))]
const ACCEPTED: &str = "accepted: socketcand://HOST:PORT/NAME";

/// The interface of this name; whether there is one shows when it is opened.
#[cfg(target_os = "linux")]
fn socketcan(interface: &str) -> Result<BusUrl, String> {
    let allowed = |c: char| c.is_ascii_graphic() && c != '/' && c != ':';
    if interface.is_empty() || interface.len() > INTERFACE_MAX || !interface.chars().all(allowed) {
        return Err(format!(
            "'{interface}' is no name of an interface; accepted: 1–{INTERFACE_MAX} characters, as in vcan0"
        ));
    }
    Ok(BusUrl::Socketcan(interface.to_owned()))
}

#[cfg(not(target_os = "linux"))]
fn socketcan(_: &str) -> Result<BusUrl, String> {
    Err(format!("interfaces of SocketCAN exist on Linux alone; {ACCEPTED}"))
}
