//! The listening socket of a bus, and the options of the connections that it accepts.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, ReadBuf};
use tokio::net::tcp::OwnedReadHalf;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use super::session;
use crate::gateway::Entrance;

/// How long to wait before the next try when no connection can be accepted, as when the process has no descriptor left.
const RETRY: Duration = Duration::from_millis(50);

/// A client without a place waits so long for one: the departure of another may not be noticed yet.
const WAIT_FOR_PLACE: Duration = Duration::from_secs(1);

/// The answer to a client that finds no place.
const NO_PLACE: &[u8] = b"< error too many clients >";

/// A bus that is served at an address.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    bus: Arc<str>,
}

impl Server {
    /// Binds the address, `HOST:PORT`; port 0 takes a free one.
    ///
    /// # Errors
    /// When it cannot be resolved or is in use.
    pub async fn bind(authority: &str, bus: &str) -> io::Result<Self> {
        Ok(Self { listener: TcpListener::bind(authority).await?, bus: bus.into() })
    }

    /// The address that was bound.
    ///
    /// # Errors
    /// When the system does not tell.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves clients for ever; each takes one of the places. A client that finds none is told so and let go.
    pub async fn run(self, world: Entrance, places: Arc<Semaphore>) {
        loop {
            match self.listener.accept().await {
                Ok((stream, _)) => match timeout(WAIT_FOR_PLACE, Arc::clone(&places).acquire_owned()).await {
                    Ok(Ok(place)) => {
                        tokio::spawn(connection(stream, Arc::clone(&self.bus), world.clone(), place));
                    }
                    _ => drop(stream.try_write(NO_PLACE)),
                },
                Err(_) => tokio::time::sleep(RETRY).await,
            }
        }
    }
}

async fn connection(stream: TcpStream, bus: Arc<str>, world: Entrance, _place: OwnedSemaphorePermit) {
    // Without it, frames would wait for the client's acknowledgement of those before; with a socket that refuses it the
    // client is served all the same, only later.
    let _ = stream.set_nodelay(true);
    let (reader, writer) = stream.into_split();
    session::serve(Prompt(reader), writer, &bus, world).await;
}

/// A connection whose reads are acknowledged at once: a client that has not set TCP_NODELAY holds its next frame back
/// until then. Linux forgets the option, so it is set again after each read.
struct Prompt(OwnedReadHalf);

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
