//! The session of one client over a stream: joins the world, exchanges messages in the client's protocol, and leaves.

use std::pin::pin;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::guard::Judge;
use crate::inbox::{BATCH, ClientEnd, ClientId, ClientQueue, Permits, Reply, ToClient, ToWorld, WorldSender};

/// The protocol of one client: handles requests, and encodes answers and frames.
pub trait Dialogue: Send {
    /// The judge of the first bytes of a TCP connection.
    const JUDGE: Judge;

    /// The answer to a TCP client when all places are taken.
    const REFUSAL: &'static str;

    /// The greeting sent to a new client, if any.
    const GREETING: Option<&'static str>;

    /// Returns whether the client has opened the bus at least once; otherwise the session times out.
    fn is_opened(&self) -> bool;

    /// Executes the requests completed by these bytes.
    fn receive(&mut self, bytes: &[u8], client: &Client) -> impl Future<Output = ()> + Send;

    /// Returns the message writer: a function that appends a message in the client's protocol, and returns the pause
    /// after it.
    fn encoder(&self) -> impl FnMut(&mut String, ToClient) -> Duration + Send + use<Self>;
}

/// A client of the world.
#[derive(Debug)]
pub struct Client {
    pub(super) id: ClientId,
    pub(super) world: WorldSender,
    permits: Permits,
}

impl Client {
    /// Sends a message of this client to the world as soon as a permit is available.
    pub(super) async fn tell(&self, message: ToWorld) {
        self.permits.spend().await;
        self.world.tell(message);
    }
}

/// The reason why a session ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The client has disconnected.
    Left,
    /// The client did not read its messages in time, and was disconnected.
    Dismissed,
}

/// Serves one client until it disconnects, fails, or is disconnected because it reads too slowly. `open_timeout` limits
/// the time for opening the bus, and `drain_timeout` that for reading the last answers after the client's end of stream.
pub(super) async fn serve(
    reader: impl AsyncRead + Unpin,
    writer: impl AsyncWrite + Unpin,
    world: WorldSender,
    open_timeout: Option<Duration>,
    drain_timeout: Duration,
    dialogue: impl Dialogue,
) -> End {
    let (to_client, ClientEnd { queue, permits }) = ClientQueue::new();
    let client = Client { id: ClientId::next(), world, permits };
    client.world.tell(ToWorld::Join(client.id, to_client));
    let mut write = pin!(write(writer, queue, dialogue.encoder()));
    let mut listen = pin!(listen(reader, dialogue, &client, open_timeout));
    let end = tokio::select! {
        () = client.permits.dismissed() => End::Dismissed,
        () = async {
            tokio::select! {
                // After its end of stream, a client still receives pending answers: the queue ends when the world has
                // removed the client.
                () = &mut listen => drop(timeout(drain_timeout, write).await),
                // A client that stopped reading may still have sent requests.
                written = &mut write => if written.is_err() { listen.await },
            }
        } => End::Left,
    };
    client.world.tell(ToWorld::Leave(client.id));
    end
}

/// Executes the client's requests until the client's end of stream, a read error, or the expiry of the time limit for
/// opening the bus. Then the client leaves the world.
async fn listen<D: Dialogue>(
    mut reader: impl AsyncRead + Unpin,
    mut dialogue: D,
    client: &Client,
    open_timeout: Option<Duration>,
) {
    if let Some(greeting) = D::GREETING {
        client.tell(ToWorld::Reply(client.id, Reply::new(greeting))).await;
    }
    let mut bytes = [0; 4096];
    let open_timeout = open_timeout.map(|open_timeout| Instant::now() + open_timeout);
    loop {
        let read = reader.read(&mut bytes);
        let read = match open_timeout.filter(|_| !dialogue.is_opened()) {
            Some(open_timeout) => timeout_at(open_timeout, read).await.unwrap_or(Ok(0)),
            None => read.await,
        };
        match read {
            Ok(0) | Err(_) => break,
            Ok(len) => dialogue.receive(&bytes[..len], client).await,
        }
    }
    client.world.tell(ToWorld::Leave(client.id));
}

/// Writes the messages of the queue in as few writes as possible, until the world drops the queue or a write fails.
async fn write(
    mut writer: impl AsyncWrite + Unpin,
    mut queue: Receiver<ToClient>,
    mut emit: impl FnMut(&mut String, ToClient) -> Duration,
) -> std::io::Result<()> {
    let mut batch = Vec::with_capacity(BATCH);
    let mut out = String::new();
    while queue.recv_many(&mut batch, BATCH).await > 0 {
        for message in batch.drain(..) {
            let pause = emit(&mut out, message);
            if !pause.is_zero() {
                send(&mut writer, &mut out).await?;
                sleep(pause).await;
            }
        }
        send(&mut writer, &mut out).await?;
    }
    writer.shutdown().await
}

async fn send(writer: &mut (impl AsyncWrite + Unpin), out: &mut String) -> std::io::Result<()> {
    writer.write_all(out.as_bytes()).await?;
    out.clear();
    writer.flush().await
}
