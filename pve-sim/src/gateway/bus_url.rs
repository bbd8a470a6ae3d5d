//! The URLs of `--bus`.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use super::address::{Address, Parse, Scheme};
use super::{slcan, socketcan, socketcand, udp_multicast};

/// The schemes of all gateways.
const SCHEMES: [&Scheme; 5] =
    [&socketcand::SCHEME, &socketcan::SCHEME, &slcan::TCP, &slcan::PTY, &udp_multicast::SCHEME];

/// The URL of a bus. URLs are equal if they print equally.
#[derive(Clone, Debug)]
pub struct BusUrl(Arc<dyn Address>);

impl BusUrl {
    /// Returns the address in the URL.
    #[must_use]
    pub fn address(&self) -> &dyn Address {
        &*self.0
    }
}

/// The default of `--bus`.
impl Default for BusUrl {
    fn default() -> Self {
        Self(Arc::new(socketcand::ServerAddress::default()))
    }
}

impl PartialEq for BusUrl {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

impl Eq for BusUrl {}

impl fmt::Display for BusUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl FromStr for BusUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        for scheme in SCHEMES {
            let Some(rest) = text.strip_prefix(scheme.prefix) else { continue };
            return match scheme.parse {
                Parse::With(parse) => parse(rest).map(Self),
                Parse::OnlyOn(systems) => {
                    Err(format!("{} is available on {systems} only; {}", scheme.form, accepted()))
                }
            };
        }
        Err(format!("not a supported bus; {}", accepted()))
    }
}

/// Returns the schemes supported on this system.
fn accepted() -> String {
    let here = SCHEMES.iter().filter(|scheme| matches!(scheme.parse, Parse::With(_)));
    let forms: Vec<&str> = here.map(|scheme| scheme.form).collect();
    format!("accepted: {}", forms.join(", "))
}
