//! The socket of the control interface.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};

use super::connection::{Connection, Connections, Watched};
use super::routes::router;
use crate::gateway::Entrance;

/// How long to wait before the next try when no connection can be accepted, as when the process has no descriptor left.
const RETRY: Duration = Duration::from_millis(50);

/// A client has so long to send the head of a request.
const HEAD: Duration = Duration::from_secs(60);

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
        let connections = Arc::new(Connections::new(places));
        loop {
            let Ok((stream, _)) = self.listener.accept().await else {
                tokio::time::sleep(RETRY).await;
                continue;
            };
            if let Some(connection) = stream.local_addr().ok().and_then(|local| connections.admit(local)) {
                let (router, connections) = (router.clone(), Arc::clone(&connections));
                tokio::spawn(async move {
                    tokio::select! {
                        () = serve(stream, router, Arc::clone(&connection)) => {}
                        () = connection.dismissed() => {}
                    }
                    connections.leave(&connection);
                });
            }
        }
    }
}

async fn serve(stream: TcpStream, router: Router, connection: Arc<Connection>) {
    // Without it the events of the bus would wait for each other.
    let _ = stream.set_nodelay(true);
    let service = TowerToHyperService::new(router.layer(Extension(Arc::clone(&connection))));
    let stream = TokioIo::new(Watched { stream, connection });
    // Whatever ends a connection ends that one alone.
    let _ = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD)
        .serve_connection(stream, service)
        .await;
}
