//! The socket of the control interface, and its connections.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;

use super::guard::LocalAddress;
use super::routes::router;
use crate::gateway::Entrance;

/// How long to wait before the next try when no connection can be accepted, as when the process has no descriptor left.
const RETRY: Duration = Duration::from_millis(50);

/// A client has so long to send the head of a request.
const HEAD: Duration = Duration::from_secs(10);

/// A control interface at an address.
#[derive(Debug)]
pub(crate) struct Server {
    listener: TcpListener,
}

impl Server {
    /// Binds the address; port 0 takes a free one.
    pub(crate) async fn bind(address: SocketAddr) -> io::Result<Self> {
        Ok(Self { listener: TcpListener::bind(address).await? })
    }

    /// The address that was bound.
    pub(crate) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves clients for ever, so many at once.
    pub(crate) async fn run(self, world: Entrance, places: usize) {
        let router = router(world);
        let places = Arc::new(Semaphore::new(places));
        loop {
            let Ok(place) = Arc::clone(&places).acquire_owned().await else { return };
            match self.listener.accept().await {
                Ok((stream, _)) => {
                    let router = router.clone();
                    tokio::spawn(async move {
                        let _place = place;
                        connection(stream, router).await;
                    });
                }
                Err(_) => tokio::time::sleep(RETRY).await,
            }
        }
    }
}

async fn connection(stream: TcpStream, router: Router) {
    let Ok(local) = stream.local_addr() else { return };
    // Without it the events of the bus would wait for each other.
    let _ = stream.set_nodelay(true);
    let service = TowerToHyperService::new(router.layer(Extension(LocalAddress(local))));
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEAD);
    // Whatever ends a connection ends that one alone.
    let _ = builder.serve_connection(TokioIo::new(stream), service).await;
}
