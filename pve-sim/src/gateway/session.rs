//! One client over a stream: it joins the world, is heard and answered in its protocol, and leaves.

use std::pin::pin;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::guard::Judge;
use crate::inbox::{BATCH, ClientEnd, ClientId, ClientQueue, Permits, Reply, ToClient, ToWorld, WorldSender};

/// The protocol of one client: its requests, and how it gets answers and frames.
pub trait Dialogue: Send {
    /// Judges the first bytes of a connection over TCP.
    const JUDGE: Judge;

    /// The answer to a client over TCP that finds no place.
    const NO_PLACE: &'static str;

    /// The first words to a client.
    const GREETING: Option<&'static str>;

    /// Returns whether the client has ever opened the bus; one that has not is let go after a time.
    fn is_opened(&self) -> bool;

    /// Carries out the requests that end in these bytes.
    fn hear(&mut self, bytes: &[u8], client: &Client) -> impl Future<Output = ()> + Send;

    /// Returns the writer of messages: it appends each in the client's protocol, and returns how long nothing follows it.
    fn emitter(&self) -> impl FnMut(&mut String, ToClient) -> Duration + Send + use<Self>;
}

/// A client of the world.
#[derive(Debug)]
pub struct Client {
    pub(super) id: ClientId,
    pub(super) world: WorldSender,
    permits: Permits,
}

impl Client {
    /// Sends the world a message of this client, as soon as the client has a permit for it.
    pub(super) async fn tell(&self, message: ToWorld) {
        self.permits.spend().await;
        self.world.tell(message);
    }
}

/// The time that a client has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// To open the bus; `None`: all the time that it takes.
    pub(super) patience: Option<Duration>,
    /// To read its last answers after its own last word.
    pub(super) farewell: Duration,
}

/// Why a session has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The client is gone.
    Left,
    /// The client did not read what it was sent.
    Dismissed,
}

/// Serves one client until it leaves, fails, or is told to go because it does not keep up.
pub(super) async fn serve(
    reader: impl AsyncRead + Unpin,
    writer: impl AsyncWrite + Unpin,
    world: WorldSender,
    limits: Limits,
    dialogue: impl Dialogue,
) -> End {
    let (to_client, ClientEnd { queue, permits }) = ClientQueue::new();
    let client = Client { id: ClientId::next(), world, permits };
    client.world.tell(ToWorld::Join(client.id, to_client));
    let mut write = pin!(write(writer, queue, dialogue.emitter()));
    let mut listen = pin!(listen(reader, dialogue, &client, limits.patience));
    let end = tokio::select! {
        () = client.permits.dismissed() => End::Dismissed,
        () = async {
            tokio::select! {
                // A client that has said its last word still gets the answers: the queue ends when the world has let it go.
                () = &mut listen => drop(timeout(limits.farewell, write).await),
                // A client that takes nothing more may have said something before.
                written = &mut write => if written.is_err() { listen.await },
            }
        } => End::Left,
    };
    client.world.tell(ToWorld::Leave(client.id));
    end
}

/// Hears the client until its last word, or until it has not opened the bus in time.
async fn listen<D: Dialogue>(
    mut reader: impl AsyncRead + Unpin,
    mut dialogue: D,
    client: &Client,
    patience: Option<Duration>,
) {
    if let Some(greeting) = D::GREETING {
        client.tell(ToWorld::Reply(client.id, Reply::new(greeting))).await;
    }
    let mut bytes = [0; 4096];
    let patience = patience.map(|patience| Instant::now() + patience);
    loop {
        let read = reader.read(&mut bytes);
        let read = match patience.filter(|_| !dialogue.is_opened()) {
            Some(patience) => timeout_at(patience, read).await.unwrap_or(Ok(0)),
            None => read.await,
        };
        match read {
            Ok(0) | Err(_) => break,
            Ok(len) => dialogue.hear(&bytes[..len], client).await,
        }
    }
    client.world.tell(ToWorld::Leave(client.id));
}

/// Writes what is in the queue, in as few writes as possible, until the world lets go of it or the client is gone.
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
