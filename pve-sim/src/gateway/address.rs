//! The interface of gateways: a URL scheme, the address in such a URL, and the gateway opened there.

use std::fmt::{Debug, Display};
use std::io;
use std::pin::Pin;
use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::inbox::WorldSender;

/// The name of a bus whose URL has none.
const UNNAMED: &str = "pve0";

/// A URL scheme of `--bus`.
#[derive(Debug)]
pub struct Scheme {
    /// The prefix of its URLs, unique among the schemes.
    pub prefix: &'static str,
    /// The form of its URLs, for messages.
    pub form: &'static str,
    /// The parser of the text after the prefix.
    pub parse: Parse,
}

/// The parser of a URL.
#[derive(Debug)]
pub enum Parse {
    /// A function; its error has the reason and the accepted form.
    With(fn(&str) -> Result<Arc<dyn Address>, String>),
    /// A refusal on this system; the error names the systems that support the scheme.
    OnlyOn(&'static str),
}

/// The address of a bus. It prints as its URL.
pub trait Address: Debug + Display + Send + Sync {
    /// Returns the name of the bus in traces and logs.
    fn name(&self) -> &str {
        UNNAMED
    }

    /// Returns whether the peers run in wall time only.
    fn is_real_time(&self) -> bool {
        false
    }

    /// Returns whether the address is a bus shared with others. Joined twice, it would circulate each frame forever.
    fn is_shared(&self) -> bool {
        false
    }

    /// Returns whether real devices may be on the bus.
    fn may_be_real(&self) -> bool {
        false
    }

    /// Opens the gateway. Needs a Tokio runtime.
    fn open(&self, access: Access) -> Opening<'_>;
}

/// The opening of a gateway.
pub type Opening<'a> = Pin<Box<dyn Future<Output = Result<Box<dyn Gateway>, OpenError>> + Send + 'a>>;

/// The visibility of a bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Beacons announce it.
    pub beacon: bool,
    /// Frames pass between this machine and others, where the URL does not decide.
    pub remote: bool,
}

/// An open gateway without clients. Dropping it closes it.
pub trait Gateway: Send {
    /// Returns the URL at which the bus is reachable, with the port that was bound.
    fn url(&self) -> String;

    /// Returns an example command for joining.
    fn hint(&self) -> String;

    /// Serves clients on the caller's runtime until that ends. Each client of a server takes one of the places.
    fn start(self: Box<Self>, world: WorldSender, places: Arc<Semaphore>);
}

/// The reason why a gateway cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct OpenError(String);

impl OpenError {
    /// Returns an error with this text.
    pub fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

impl From<io::Error> for OpenError {
    fn from(error: io::Error) -> Self {
        Self(error.to_string())
    }
}
