//! Where a bus is reachable: the URLs of `--bus`.

use std::fmt;
use std::str::FromStr;

/// The longest name of a bus, in characters: fits a line of the trace and every client's field for it.
const NAME_MAX: usize = 32;

/// A socketcand server to be opened: `socketcand://HOST:PORT/NAME`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusUrl {
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
        Self { host: "127.0.0.1".to_owned(), port: 29536, name: "pve0".to_owned() }
    }

    /// Host and port, as a resolver takes them.
    #[must_use]
    pub fn authority(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }
}

impl fmt::Display for BusUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "socketcand://{}:{}/{}", self.host, self.port, self.name)
    }
}

impl FromStr for BusUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.starts_with("socketcan:") {
            return Err(format!("socketcan interfaces are not served yet; {ACCEPTED}"));
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
        Ok(Self { host: host.to_owned(), port, name: name.to_owned() })
    }
}

const ACCEPTED: &str = "accepted: socketcand://HOST:PORT/NAME";
