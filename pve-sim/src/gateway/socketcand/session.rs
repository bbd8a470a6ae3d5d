//! One client: reads its requests, hands them to the world, and writes what the world has for it.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use protocol_core::frame::Frame;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep, timeout_at};

use super::broadcast::{Broadcast, Full, Mode};
use super::protocol::{
    ECHO, HI, OK, Parser, Request, RequestError, emit_error, emit_frame, emit_refusal, emit_statistics,
};
use crate::gateway::tcp::{FAREWELL, HANDSHAKE};
use crate::inbox::BATCH;
use crate::inbox::{ClientId, Entrance, Leash, Mailbox, Outbox, Reply, ToClient, ToWorld};

/// How long frames are held back after raw mode was answered: python-can takes what comes in one read with the answer
/// for a wrong answer.
const HOLD_BACK: Duration = Duration::from_millis(20);

/// Serves one client until it leaves, fails, or is told to go because it does not keep up.
pub async fn serve(reader: impl AsyncRead + Unpin, writer: impl AsyncWrite + Unpin, bus: &str, world: Entrance) {
    let (outbox, Mailbox { queue, leash }) = Outbox::new();
    let client = Client { id: ClientId::next(), bus, leash, world, broadcast: Mutex::default() };
    client.world.tell(ToWorld::Join(client.id, outbox));
    tokio::select! {
        () = client.leash.dismissed() => {}
        // A client that has said its last word still gets the answers: the queue ends when the world has let it go.
        () = async { client.listen(reader).await; sleep(FAREWELL).await } => {}
        _ = write(writer, queue, &client.broadcast) => {}
    }
    client.world.tell(ToWorld::Leave(client.id));
}

struct Client<'a> {
    id: ClientId,
    bus: &'a str,
    leash: Leash,
    world: Entrance,
    /// Between the reader, which changes it, and the writer.
    broadcast: Mutex<Broadcast>,
}

/// How far a client has got with the handshake.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeted,
    Open,
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
            let due = lock(&self.broadcast).due();
            let read = reader.read(&mut bytes);
            let read = match (stage, due) {
                (Stage::Greeted, _) => timeout_at(patience, read).await.unwrap_or(Ok(0)),
                (Stage::Open, None) => read.await,
                (Stage::Open, Some(due)) => match timeout_at(due, read).await {
                    Ok(read) => read,
                    Err(_) => {
                        self.send_due().await;
                        continue;
                    }
                },
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

    /// Sends the cyclic frames that are due.
    async fn send_due(&self) {
        let now = Instant::now();
        loop {
            let Some(frame) = lock(&self.broadcast).take_due(now) else { return };
            self.leash.spend().await;
            self.world.tell(self.send(frame));
        }
    }

    fn send(&self, frame: Frame) -> ToWorld {
        lock(&self.broadcast).count_sent(&frame);
        ToWorld::Send(self.id, frame)
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
            (Ok(Request::Open(_)), Stage::Open) => reply("< error the bus is open already >"),
            (Ok(_), Stage::Greeted) => reply("< error open the bus first >"),
            (Ok(Request::Send(frame)), Stage::Open) => self.send(frame),
            (Ok(Request::RawMode), Stage::Open) => {
                lock(&self.broadcast).mode = Mode::Raw;
                ToWorld::Listen(self.id, Reply { text: OK.into(), pause: HOLD_BACK })
            }
            (Ok(Request::BcmMode), Stage::Open) => {
                lock(&self.broadcast).mode = Mode::Broadcast;
                reply(OK)
            }
            (Ok(Request::ControlMode), Stage::Open) => {
                lock(&self.broadcast).mode = Mode::Control;
                ToWorld::Listen(self.id, Reply::new(OK))
            }
            (Ok(request), Stage::Open) => {
                let listens = matches!(request, Request::Subscribe(..) | Request::Filter(..));
                match self.obey(request) {
                    // Like the reference daemon, without an answer.
                    Ok(()) if listens => ToWorld::Listen(self.id, Reply::new("")),
                    Ok(()) => reply(""),
                    Err(refusal) => reply(refusal),
                }
            }
        }
    }

    /// Carries out what the broadcast manager is asked for, in the mode that has it.
    fn obey(&self, request: Request) -> Result<(), &'static str> {
        const NO_ROOM: &str = "< error no room for more >";
        let mut broadcast = lock(&self.broadcast);
        let now = Instant::now();
        match (request, broadcast.mode) {
            (Request::Statistics(every), Mode::Control) => broadcast.set_statistics(every, now),
            (Request::Statistics(_), _) => return Err("< error statistics need controlmode first >"),
            (_, Mode::Raw | Mode::Control) => return Err("< error that needs bcmmode first >"),
            (Request::Subscribe(id, throttle), _) => {
                broadcast.subscribe(id, None, throttle).map_err(|Full| NO_ROOM)?;
            }
            (Request::Filter(throttle, mask), _) => {
                broadcast.subscribe(mask.id(), Some(mask.data()), throttle).map_err(|Full| NO_ROOM)?;
            }
            (Request::Unsubscribe(id), _) => broadcast.unsubscribe(id),
            (Request::Add(period, frame), _) => broadcast.add(frame, period, now).map_err(|Full| NO_ROOM)?,
            (Request::Update(frame), _) if !broadcast.update(frame) => return Err("< error nothing to update >"),
            (Request::Delete(id), _) => broadcast.delete(id),
            // Carried out, or answered before.
            (_, Mode::Broadcast) => {}
        }
        Ok(())
    }
}

fn lock(broadcast: &Mutex<Broadcast>) -> MutexGuard<'_, Broadcast> {
    broadcast.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes what is in the queue, in as few writes as possible, until the world lets go of it or the client is gone.
async fn write(
    mut writer: impl AsyncWrite + Unpin,
    mut queue: Receiver<ToClient>,
    broadcast: &Mutex<Broadcast>,
) -> std::io::Result<()> {
    let mut batch = Vec::with_capacity(BATCH);
    let mut out = String::new();
    loop {
        let due = lock(broadcast).statistics_due();
        let received = queue.recv_many(&mut batch, BATCH);
        let received = match due {
            None => Some(received.await),
            Some(due) => timeout_at(due, received).await.ok(),
        };
        if received == Some(0) {
            break;
        }
        if let Some(counts) = lock(broadcast).take_statistics(Instant::now()) {
            emit_statistics(&mut out, counts);
        }
        for message in batch.drain(..) {
            match message {
                ToClient::Frame(at, frame) => {
                    if lock(broadcast).deliver(&frame, Instant::now()) {
                        emit_frame(&mut out, at, &frame);
                    }
                }
                ToClient::Error(at, class) => {
                    if lock(broadcast).mode == Mode::Raw {
                        emit_error(&mut out, at, class);
                    }
                }
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
