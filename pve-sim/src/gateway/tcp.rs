//! Gateways over TCP: the listening address, the listening socket, and the admission of clients.

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

use super::guard::{ForeignWarning, Guarded};
use super::session::{Dialogue, End, serve};
use crate::inbox::WorldSender;

/// The delay after a failed accept, for example while no file descriptor is free.
const RETRY: Duration = Duration::from_millis(50);

/// The time that a new client waits for a place, because the world may not yet have processed the disconnection of
/// another client.
const WAIT_FOR_PLACE: Duration = Duration::from_secs(1);

/// The maximum number of clients that wait for a place; further clients are refused immediately.
pub(crate) const WAITING: usize = 8;

/// The time limit for opening the bus, because places are few.
pub(super) const OPEN_TIMEOUT: Duration = Duration::from_secs(60);

/// The time limit for reading the last answers after the client's end of stream.
pub(super) const DRAIN_TIMEOUT: Duration = Duration::from_secs(10);

/// An address to listen on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// A name, an IPv4 address, or an IPv6 address in brackets.
    pub(super) host: String,
    /// The TCP port; 0 selects a free one.
    pub(super) port: u16,
}

impl Endpoint {
    /// Parses `HOST:PORT`; `form` is the URL form for the error.
    ///
    /// # Errors
    /// The reason, with the accepted form.
    pub(super) fn parse(text: &str, form: &str) -> Result<Self, String> {
        let (host, port) = text.rsplit_once(':').ok_or_else(|| format!("the port is missing; accepted: {form}"))?;
        if host.is_empty() || (host.contains(':') && !(host.starts_with('[') && host.ends_with(']'))) {
            return Err(format!("'{host}' is not a valid host; accepted: {form}"));
        }
        let port = port
            .parse()
            .map_err(|_| format!("'{port}' is not a valid port; accepted: 0–65535, 0 selects a free one"))?;
        Ok(Self { host: host.to_owned(), port })
    }

    /// Binds the address.
    ///
    /// # Errors
    /// When the host cannot be resolved, or the port is in use.
    pub(super) async fn bind(&self) -> io::Result<Listener> {
        let listener = TcpListener::bind(self.to_string()).await?;
        Ok(Listener { address: listener.local_addr()?, listener })
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

#[derive(Debug)]
pub(super) struct Listener {
    listener: TcpListener,
    pub(super) address: SocketAddr,
}

impl Listener {
    /// Serves clients forever; each client has its own dialogue and occupies a place. A client without a place receives
    /// an error and is disconnected. The first foreign connection is reported to the user, with `url` as the name of
    /// the bus.
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
                    None => drop(stream.try_write(D::REFUSAL.as_bytes())),
                }
            });
        }
    }
}

/// Serves a TCP client that occupies a place, until the client disconnects or is dismissed. A connection that does not
/// begin like a client of the protocol is closed before any byte takes effect.
pub async fn enter<D: Dialogue>(
    reader: impl AsyncRead + Unpin,
    writer: impl AsyncWrite + Unpin,
    world: WorldSender,
    warning: Arc<ForeignWarning>,
    dialogue: D,
) -> End {
    let reader = Guarded::new(reader, D::JUDGE, warning);
    serve(reader, writer, world, Some(OPEN_TIMEOUT), DRAIN_TIMEOUT, dialogue).await
}

/// Returns a free place, after waiting at most [`WAIT_FOR_PLACE`]; `None` on time-out, or if too many clients already
/// wait.
async fn place(places: Arc<Semaphore>, waiting: &Semaphore) -> Option<OwnedSemaphorePermit> {
    if let Ok(place) = Arc::clone(&places).try_acquire_owned() {
        return Some(place);
    }
    let _waits = waiting.try_acquire().ok()?;
    timeout(WAIT_FOR_PLACE, places.acquire_owned()).await.ok()?.ok()
}

fn halves(stream: TcpStream) -> (QuickAck, OwnedWriteHalf) {
    // Without TCP_NODELAY, frames would wait for the acknowledgement of earlier frames. If the socket refuses the
    // option, frames are only delayed.
    let _ = stream.set_nodelay(true);
    let (reader, writer) = stream.into_split();
    (QuickAck(reader), writer)
}

/// A connection that acknowledges each read immediately, because a client without TCP_NODELAY holds back its next frame
/// until the acknowledgement. The option is set after each read, because Linux resets it.
pub(super) struct QuickAck(OwnedReadHalf);

impl AsyncRead for QuickAck {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let poll = Pin::new(&mut self.0).poll_read(cx, buf);
        #[cfg(target_os = "linux")]
        if poll.is_ready() {
            let _ = self.0.as_ref().set_quickack(true);
        }
        poll
    }
}

/// Returns the address at which this machine reaches a bound address: loopback for an unspecified address, because
/// 0.0.0.0 is not a valid destination and a socket at \[::\] also accepts IPv4.
pub(crate) fn joinable(bound: SocketAddr) -> SocketAddr {
    let ip = if bound.ip().is_unspecified() { IpAddr::V4(Ipv4Addr::LOCALHOST) } else { bound.ip() };
    SocketAddr::new(ip, bound.port())
}
