//! One client: reads its requests, hands them to the world, and writes what the world has for it.

use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep, timeout_at};

use super::protocol::{ECHO, HI, OK, Parser, Request, RequestError, emit_error, emit_frame, emit_refusal};
use crate::gateway::tcp::{FAREWELL, HANDSHAKE};
use crate::inbox::BATCH;
use crate::inbox::{ClientId, Entrance, Leash, Mailbox, Outbox, Reply, ToClient, ToWorld};

/// How long frames are held back after raw mode was answered: python-can takes what comes in one read with the answer
/// for a wrong answer.
const HOLD_BACK: Duration = Duration::from_millis(20);

/// Serves one client until it leaves, fails, or is told to go because it does not keep up.
pub async fn serve(reader: impl AsyncRead + Unpin, writer: impl AsyncWrite + Unpin, bus: &str, world: Entrance) {
    let (outbox, Mailbox { queue, leash }) = Outbox::new();
    let client = Client { id: ClientId::next(), bus, leash, world };
    client.world.tell(ToWorld::Join(client.id, outbox));
    tokio::select! {
        () = client.leash.dismissed() => {}
        // A client that has said its last word still gets the answers: the queue ends when the world has let it go.
        () = async { client.listen(reader).await; sleep(FAREWELL).await } => {}
        _ = write(writer, queue) => {}
    }
    client.world.tell(ToWorld::Leave(client.id));
}

struct Client<'a> {
    id: ClientId,
    bus: &'a str,
    leash: Leash,
    world: Entrance,
}

/// How far a client has got with the handshake.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeted,
    Open,
    /// In raw mode: frames pass in both directions.
    Raw,
}

impl Client<'_> {
    async fn listen(&self, mut reader: impl AsyncRead + Unpin) {
        self.leash.spend().await;
        self.world.tell(ToWorld::Reply(self.id, Reply::new(HI)));
        let mut parser = Parser::default();
        let mut stage = Stage::Greeted;
        let mut bytes = [0; 4096];
        let patience = Instant::now() + HANDSHAKE;
        loop {
            let read = reader.read(&mut bytes);
            let read = match stage {
                Stage::Greeted => timeout_at(patience, read).await.unwrap_or(Ok(0)),
                Stage::Open | Stage::Raw => read.await,
            };
            let len = match read {
                Ok(0) | Err(_) => break,
                Ok(len) => len,
            };
            for message in bytes.iter().take(len).filter_map(|byte| parser.push(*byte)) {
                self.leash.spend().await;
                self.world.tell(self.answer(message, &mut stage));
            }
        }
        self.world.tell(ToWorld::Leave(self.id));
    }

    fn answer(&self, message: Result<Request, RequestError>, stage: &mut Stage) -> ToWorld {
        let reply = |text| ToWorld::Reply(self.id, Reply::new(text));
        match (message, *stage) {
            (Err(error), _) => ToWorld::Reply(self.id, Reply::new(emit_refusal(error))),
            (Ok(Request::Echo), _) => reply(ECHO),
            (Ok(Request::Open(name)), Stage::Greeted) if name == self.bus => {
                *stage = Stage::Open;
                reply(OK)
            }
            (Ok(Request::Open(_)), Stage::Greeted) => ToWorld::Reply(
                self.id,
                Reply::new(format!("< error there is no bus of that name, only {} >", self.bus)),
            ),
            (Ok(Request::Open(_)), Stage::Open | Stage::Raw) => reply("< error the bus is open already >"),
            (Ok(_), Stage::Greeted) => reply("< error open the bus first >"),
            (Ok(Request::RawMode), Stage::Open | Stage::Raw) => {
                *stage = Stage::Raw;
                ToWorld::Listen(self.id, Reply { text: OK.into(), pause: HOLD_BACK })
            }
            (Ok(Request::Send(_)), Stage::Open) => reply("< error ask for rawmode first >"),
            (Ok(Request::Send(frame)), Stage::Raw) => ToWorld::Send(self.id, frame),
        }
    }
}

/// Writes what is in the queue, in as few writes as possible, until the world lets go of it or the client is gone.
async fn write(mut writer: impl AsyncWrite + Unpin, mut queue: Receiver<ToClient>) -> std::io::Result<()> {
    let mut batch = Vec::with_capacity(BATCH);
    let mut out = String::new();
    while queue.recv_many(&mut batch, BATCH).await > 0 {
        for message in batch.drain(..) {
            match message {
                ToClient::Frame(at, frame) => emit_frame(&mut out, at, &frame),
                ToClient::Error(at, class) => emit_error(&mut out, at, class),
                ToClient::Reply(Reply { text, pause }) => {
                    out.push_str(&text);
                    if !pause.is_zero() {
                        writer.write_all(out.as_bytes()).await?;
                        writer.flush().await?;
                        out.clear();
                        sleep(pause).await;
                    }
                }
            }
        }
        writer.write_all(out.as_bytes()).await?;
        writer.flush().await?;
        out.clear();
    }
    writer.shutdown().await
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
