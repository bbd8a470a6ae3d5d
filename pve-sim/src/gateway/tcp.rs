//! Gateways over TCP: the address to listen at, the listening socket, and the one way in for the clients that it accepts.

use std::fmt;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use super::address::OpenError;
use super::guard::{ForeignWarning, Guarded};
use super::session::{Dialogue, End, Limits, serve};
use crate::inbox::WorldSender;

/// How long to wait before the next try when no connection can be accepted, as when the process has no descriptor left.
const RETRY: Duration = Duration::from_millis(50);

/// A client without a place waits so long for one: the world may not have noticed yet that another has left.
const WAIT_FOR_PLACE: Duration = Duration::from_secs(1);

/// The most clients of one listener that wait for a place; further ones are refused at once.
pub(crate) const WAITING: usize = 8;

/// The time that a client has to open the bus: places are few.
pub(super) const HANDSHAKE: Duration = Duration::from_secs(60);

/// The time that a client has to read its last answers after its own last word.
pub(super) const FAREWELL: Duration = Duration::from_secs(10);

/// An address to listen at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Endpoint {
    /// A name, an IPv4 address, or an IPv6 address in brackets.
    pub(super) host: String,
    /// The TCP port; 0 takes a free one.
    pub(super) port: u16,
}

impl Endpoint {
    /// Reads `HOST:PORT`, a part of a URL of this form.
    ///
    /// # Errors
    /// What is wrong, and what is accepted.
    pub(super) fn parse(text: &str, form: &str) -> Result<Self, String> {
        let (host, port) = text.rsplit_once(':').ok_or_else(|| format!("the port is missing; accepted: {form}"))?;
        if host.is_empty() || (host.contains(':') && !(host.starts_with('[') && host.ends_with(']'))) {
            return Err(format!("'{host}' is no host; accepted: {form}"));
        }
        let port = port.parse().map_err(|_| format!("'{port}' is no port; accepted: 0–65535, 0 takes a free one"))?;
        Ok(Self { host: host.to_owned(), port })
    }

    /// Binds it. `url` writes the URL with another endpoint: the way out where the port is in use.
    ///
    /// # Errors
    /// When the host cannot be resolved, or the port is in use.
    pub(super) async fn bind(&self, url: impl Fn(&Self) -> String + Send) -> Result<Listener, OpenError> {
        match TcpListener::bind(self.to_string()).await {
            Ok(listener) => Ok(Listener { address: listener.local_addr()?, listener }),
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                let free = url(&Self { port: 0, ..self.clone() });
                Err(OpenError::new(format!("{error}; does another pve-sim run? --bus {free} takes a free port")))
            }
            Err(error) => Err(error.into()),
        }
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

/// A socket that listens.
#[derive(Debug)]
pub(super) struct Listener {
    listener: TcpListener,
    /// The address that was bound.
    pub(super) address: SocketAddr,
}

impl Listener {
    /// Serves clients for ever, each in a dialogue of its own and on one of the places. A client that finds none is told so
    /// and let go. The first foreign connection is told to the user; `url` names the bus there.
    pub(super) async fn run<D: Dialogue + 'static>(
        self,
        url: String,
        world: WorldSender,
        places: Arc<Semaphore>,
        dialogue: impl Fn() -> D + Send,
    ) {
        let warning = Arc::new(ForeignWarning::new(url, world.clone()));
        let waiting = Arc::new(Semaphore::new(WAITING));
        loop {
            let Ok((stream, _)) = self.listener.accept().await else {
                tokio::time::sleep(RETRY).await;
                continue;
            };
            let (places, waiting) = (Arc::clone(&places), Arc::clone(&waiting));
            let (world, warning, dialogue) = (world.clone(), Arc::clone(&warning), dialogue());
            tokio::spawn(async move {
                match place(places, &waiting).await {
                    Some(_place) => {
                        let (reader, writer) = halves(stream);
                        enter(reader, writer, world, warning, dialogue).await;
                    }
                    None => drop(stream.try_write(D::NO_PLACE.as_bytes())),
                }
            });
        }
    }
}

/// Serves a client over TCP that has a place, until it leaves or is told to go. A connection that does not begin as a client
/// does is closed before anything is obeyed.
pub async fn enter<D: Dialogue>(
    reader: impl AsyncRead + Unpin,
    writer: impl AsyncWrite + Unpin,
    world: WorldSender,
    warning: Arc<ForeignWarning>,
    dialogue: D,
) -> End {
    let limits = Limits { patience: Some(HANDSHAKE), farewell: FAREWELL };
    serve(Guarded::new(reader, D::JUDGE, warning), writer, world, limits, dialogue).await
}

/// Returns one of the places. Where there is none, it waits for one, if few others do.
async fn place(places: Arc<Semaphore>, waiting: &Semaphore) -> Option<OwnedSemaphorePermit> {
    if let Ok(place) = Arc::clone(&places).try_acquire_owned() {
        return Some(place);
    }
    let _waits = waiting.try_acquire().ok()?;
    timeout(WAIT_FOR_PLACE, places.acquire_owned()).await.ok()?.ok()
}

fn halves(stream: TcpStream) -> (Prompt, OwnedWriteHalf) {
    // Without it, frames would wait for the client's acknowledgement of those before; with a socket that refuses it the
    // client is served all the same, only later.
    let _ = stream.set_nodelay(true);
    let (reader, writer) = stream.into_split();
    (Prompt(reader), writer)
}

/// A connection whose reads are acknowledged at once: a client that has not set TCP_NODELAY holds its next frame back
/// until then. Linux forgets the option, so it is set again after each read.
pub(super) struct Prompt(OwnedReadHalf);

impl AsyncRead for Prompt {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let poll = Pin::new(&mut self.0).poll_read(cx, buf);
        #[cfg(target_os = "linux")]
        if poll.is_ready() {
            let _ = self.0.as_ref().set_quickack(true);
        }
        poll
    }
}

/// Returns the address at which this machine reaches a bound one: nobody connects to 0.0.0.0, and a socket at \[::\]
/// takes IPv4, too.
pub(crate) fn joinable(bound: SocketAddr) -> SocketAddr {
    let ip = if bound.ip().is_unspecified() { IpAddr::V4(Ipv4Addr::LOCALHOST) } else { bound.ip() };
    SocketAddr::new(ip, bound.port())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn way_out(endpoint: &Endpoint) -> String {
        format!("slcan://{endpoint}")
    }

    #[tokio::test]
    async fn a_port_in_use_names_the_way_out() {
        let taken = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let endpoint = Endpoint::parse(&taken.local_addr().expect("its address").to_string(), "").expect("an endpoint");
        let told = endpoint.bind(way_out).await.expect_err("it is taken").to_string();
        assert!(told.ends_with("does another pve-sim run? --bus slcan://127.0.0.1:0 takes a free port"), "{told}");
        let elsewhere = Endpoint::parse("192.0.2.1:0", "").expect("an endpoint");
        let told = elsewhere.bind(way_out).await.expect_err("no address of this machine").to_string();
        assert!(!told.contains("--bus"), "{told}");
    }
}
