//! What every gateway is to the simulator: a scheme of URLs, an address that such a URL names, and the gateway that is
//! opened there.

use std::fmt::{Debug, Display};
use std::io;
use std::pin::Pin;
use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::inbox::WorldSender;

/// The name of a bus whose URL has none.
const UNNAMED: &str = "pve0";

/// A kind of URL that `--bus` takes.
#[derive(Debug)]
pub struct Scheme {
    /// The beginning of such a URL, which no other scheme has.
    pub prefix: &'static str,
    /// Such a URL, as the user is told.
    pub form: &'static str,
    /// Reads what comes after the prefix.
    pub parse: Parse,
}

/// How the rest of a URL is read.
#[derive(Debug)]
pub enum Parse {
    /// By a function, whose error says what is wrong and what is accepted.
    With(fn(&str) -> Result<Arc<dyn Address>, String>),
    /// Not on this system; the error names those that have it.
    OnlyOn(&'static str),
}

/// Where a bus is to be reachable. It prints as its URL.
pub trait Address: Debug + Display + Send + Sync {
    /// Returns the name of the bus in traces and logs.
    fn name(&self) -> &str {
        UNNAMED
    }

    /// Returns whether other programs, or a real bus, are there in wall time alone.
    fn is_real_time(&self) -> bool {
        false
    }

    /// Returns whether others have a bus there already. Given twice, it would pass each frame round for ever.
    fn is_shared(&self) -> bool {
        false
    }

    /// Opens the gateway. Needs a Tokio runtime.
    fn open(&self, access: Access) -> Opening<'_>;
}

/// A gateway on its way.
pub type Opening<'a> = Pin<Box<dyn Future<Output = Result<Box<dyn Gateway>, OpenError>> + Send + 'a>>;

/// Who may find and reach a bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Access {
    /// Whether beacons announce it.
    pub beacon: bool,
    /// Whether frames pass between this machine and others, where the URL leaves that open.
    pub remote: bool,
}

/// A gateway that is open and serves nobody yet. Dropped, it closes.
pub trait Gateway: Send {
    /// Returns the URL at which the bus is reachable, with the port that was bound.
    fn url(&self) -> String;

    /// Returns what to type to join.
    fn hint(&self) -> String;

    /// Serves clients on the runtime of the caller, until that ends. Each client of a server takes one of the places.
    fn start(self: Box<Self>, world: WorldSender, places: Arc<Semaphore>);
}

/// Why a gateway cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct OpenError(String);

impl OpenError {
    /// Returns an error in words.
    pub fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

impl From<io::Error> for OpenError {
    fn from(error: io::Error) -> Self {
        Self(error.to_string())
    }
}
