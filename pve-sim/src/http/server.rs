//! The socket of the control interface.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _, copy, join, simplex, split};
use tokio::net::TcpListener;
use tokio::runtime;
use tokio_util::io::{InspectReader, InspectWriter};

use super::connection::{Connection, Connections};
use super::routes::router;
use crate::inbox::WorldSender;

/// The delay after a failed accept, for example while no file descriptor is free.
const RETRY: Duration = Duration::from_millis(50);

/// The time limit for receiving the head of a request.
const HEAD_TIMEOUT: Duration = Duration::from_secs(60);

/// The number of bytes that are read ahead of a pending request, because the end of the stream comes after them.
const READ_AHEAD: usize = 64 * 1024;

/// The response to a new connection while all existing ones have pending requests.
const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\nConnection: close\r\n\r\n\
                      {\"error\":\"too many connections are waiting for responses; try again later\"}";

/// Serves at most `places` connections until the process ends. A separate thread keeps HTTP traffic from delaying bus
/// clients.
pub(crate) fn start(listener: std::net::TcpListener, world: WorldSender, places: usize) -> io::Result<()> {
    listener.set_nonblocking(true)?;
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    let listener = {
        let _runtime = runtime.enter();
        TcpListener::from_std(listener)?
    };
    let run = move || runtime.block_on(accept(listener, router(world), places));
    thread::Builder::new().name("control".to_owned()).spawn(run).map(drop)
}

async fn accept(listener: TcpListener, router: Router, places: usize) {
    let connections = Arc::new(Connections::new(places));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(RETRY).await;
            continue;
        };
        let Ok(local) = stream.local_addr() else { continue };
        let Some(connection) = connections.admit(local) else {
            let _ = stream.try_write(FULL);
            continue;
        };
        // Without TCP_NODELAY, the events of the bus would wait for each other.
        let _ = stream.set_nodelay(true);
        let (router, connections) = (router.clone(), Arc::clone(&connections));
        tokio::spawn(async move {
            tokio::select! {
                () = converse(stream, router, Arc::clone(&connection)) => {}
                () = connection.dismissed() => {}
            }
            connections.leave(&connection);
        });
    }
}

/// Serves one client over a stream accepted at an address, until the client disconnects.
pub async fn serve(stream: impl AsyncRead + AsyncWrite + Unpin, local: SocketAddr, world: WorldSender) {
    if let Some(connection) = Connections::new(1).admit(local) {
        converse(stream, router(world), connection).await;
    }
}

async fn converse(stream: impl AsyncRead + AsyncWrite + Unpin, router: Router, connection: Arc<Connection>) {
    let service = TowerToHyperService::new(router.layer(Extension(Arc::clone(&connection))));
    let touch = |_: &[u8]| connection.touch();
    let (mut reader, writer) = split(InspectReader::new(InspectWriter::new(stream, touch), touch));
    let (received, mut ahead) = simplex(READ_AHEAD);
    let read_ahead = async {
        // An error, too, is the end of the client's requests.
        let _ = copy(&mut reader, &mut ahead).await;
        let _ = ahead.shutdown().await;
        connection.end_requests();
        std::future::pending().await
    };
    // An error ends only this connection.
    tokio::select! {
        _ = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD_TIMEOUT)
            .half_close(true)
            .serve_connection(TokioIo::new(join(received, writer)), service) => {}
        () = read_ahead => {}
    }
}
