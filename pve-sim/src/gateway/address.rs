//! The traits of gateways: the URL scheme, the address in a URL, and the open gateway.

use std::fmt::{Debug, Display};
use std::io;
use std::pin::Pin;
use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::inbox::WorldSender;

/// The name of a bus whose URL contains no name.
const UNNAMED: &str = "pve0";

/// A URL scheme of `--bus`.
#[derive(Debug)]
pub struct Scheme {
    /// The URL prefix, unique among the schemes.
    pub prefix: &'static str,
    /// The URL form shown in messages.
    pub form: &'static str,
    /// The parser of the text after the prefix.
    pub parse: Parse,
}

/// The parser of a URL.
#[derive(Debug)]
pub enum Parse {
    /// A parser function; its error states the reason and the accepted form.
    With(fn(&str) -> Result<Arc<dyn Address>, String>),
    /// The scheme is not supported on this system; the error names the systems that support it.
    OnlyOn(&'static str),
}

/// The address of a bus; `Display` prints the URL.
pub trait Address: Debug + Display + Send + Sync {
    /// Returns the name of the bus in traces and logs.
    fn name(&self) -> &str {
        UNNAMED
    }

    /// Returns whether the bus can run in wall time only.
    fn is_real_time(&self) -> bool {
        false
    }

    /// Returns whether the address is a bus shared with other programs. If it were joined twice, each frame would
    /// circulate forever.
    fn is_shared(&self) -> bool {
        false
    }

    /// Returns whether real devices may be on the bus.
    fn may_be_real(&self) -> bool {
        false
    }

    /// Opens the gateway; requires a Tokio runtime.
    fn open(&self, access: Access) -> Opening<'_>;
}

/// The future that opens a gateway.
pub type Opening<'a> = Pin<Box<dyn Future<Output = Result<Box<dyn Gateway>, OpenError>> + Send + 'a>>;

/// The visibility of a bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Whether beacons announce the bus.
    pub beacon: bool,
    /// Whether frames may pass to and from other machines, unless the URL specifies this.
    pub remote: bool,
}

/// An open gateway that does not serve clients yet. Dropping it closes the gateway.
pub trait Gateway: Send {
    /// Returns the URL of the bus with the bound port.
    fn url(&self) -> String;

    /// Returns an example command for joining.
    fn hint(&self) -> String;

    /// Serves clients until the caller's runtime ends. Each client of a server occupies one of the `places`.
    fn start(self: Box<Self>, world: WorldSender, places: Arc<Semaphore>);
}

/// The reason why a gateway cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct OpenError(String);

impl OpenError {
    /// Creates an error with this text.
    pub fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

impl From<io::Error> for OpenError {
    fn from(error: io::Error) -> Self {
        Self(error.to_string())
    }
}
