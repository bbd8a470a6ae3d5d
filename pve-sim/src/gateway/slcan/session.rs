//! One client: reads its commands, hands them to the world, and writes what the world has for it.

use std::collections::VecDeque;
use std::future::pending;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::mpsc::Receiver;
use tokio::sync::oneshot;
use tokio::time::{Instant, sleep, timeout_at};

use super::protocol::{BELL, Command, OK, Parser, Refused, SERIAL, VERSION, emit_frame, flags, sent};
use crate::inbox::BATCH;
use crate::inbox::{ClientId, Entrance, Leash, Mailbox, Outbox, Reply, ToClient, ToWorld};

/// The serial line that a client is at.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    /// Its URL, for warnings.
    pub url: &'a str,
    /// The time that a client has to open the channel; `None`: all the time that it takes.
    pub patience: Option<Duration>,
    /// The time that a client has to read its last answers after its own last word.
    pub farewell: Duration,
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
pub async fn serve(
    reader: impl AsyncRead + Unpin,
    writer: impl AsyncWrite + Unpin,
    world: Entrance,
    line: Line<'_>,
) -> End {
    let (outbox, Mailbox { queue, leash }) = Outbox::new();
    let client = Client { id: ClientId::next(), leash, world, line, talk: Mutex::default() };
    client.world.tell(ToWorld::Join(client.id, outbox));
    let end = tokio::select! {
        () = client.leash.dismissed() => End::Dismissed,
        // A client that has said its last word still gets the answers: the queue ends when the world has let it go.
        () = async { client.listen(reader).await; sleep(line.farewell).await } => End::Left,
        () = async {
            // A client that takes nothing more may have said something before.
            if write(writer, queue, &client.talk).await.is_err() {
                pending::<()>().await;
            }
        } => End::Left,
    };
    client.world.tell(ToWorld::Leave(client.id));
    end
}

struct Client<'a> {
    id: ClientId,
    leash: Leash,
    world: Entrance,
    line: Line<'a>,
    talk: Mutex<Talk>,
}

/// What the reader of commands and the writer of answers have to tell each other.
#[derive(Debug, Default)]
struct Talk {
    /// The answers that were asked for.
    asked: u64,
    /// The openings whose answer was not written yet: the number of that answer, and whether frames have time stamps from it
    /// on. A frame before it came to the channel as it was opened before.
    opened: VecDeque<(u64, bool)>,
    /// Whether there was an error since the client last asked for the flags.
    has_error: bool,
}

/// The client's channel.
#[derive(Debug, Default)]
struct Channel {
    state: State,
    /// The bit rate that the client has set, in bit/s.
    rate: Option<u32>,
    /// Whether frames have time stamps from the next opening on.
    has_stamps: bool,
    /// Whether it was opened at any time.
    was_open: bool,
    /// Whether the user knows that the client has set another bit rate than that of the bus.
    has_told: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Closed,
    Open,
    /// Open, and sends nothing.
    Listening,
}

impl Client<'_> {
    async fn listen(&self, mut reader: impl AsyncRead + Unpin) {
        let mut parser = Parser::default();
        let mut channel = Channel::default();
        let mut bytes = [0; 4096];
        let patience = self.line.patience.map(|patience| Instant::now() + patience);
        loop {
            let read = reader.read(&mut bytes);
            let read = match patience.filter(|_| !channel.was_open) {
                Some(patience) => timeout_at(patience, read).await.unwrap_or(Ok(0)),
                None => read.await,
            };
            let len = match read {
                Ok(0) | Err(_) => break,
                Ok(len) => len,
            };
            for command in bytes.iter().take(len).filter_map(|byte| parser.push(*byte)) {
                self.obey(command, &mut channel).await;
            }
        }
        self.world.tell(ToWorld::Leave(self.id));
    }

    /// Carries a line out, and answers it.
    async fn obey(&self, command: Result<Command, Refused>, channel: &mut Channel) {
        let answer = match (command, channel.state) {
            (Ok(Command::Nothing | Command::AutoSend), _) => OK,
            (Ok(Command::Version), _) => VERSION,
            (Ok(Command::Serial), _) => SERIAL,
            (Ok(Command::SetRate(rate)), State::Closed) => {
                channel.rate = Some(rate);
                OK
            }
            (Ok(Command::Stamps(on)), State::Closed) => {
                channel.has_stamps = on;
                OK
            }
            (Ok(command @ (Command::Open | Command::Listen)), State::Closed) if self.is_at_rate(channel).await => {
                channel.state = if command == Command::Open { State::Open } else { State::Listening };
                channel.was_open = true;
                return self.ask(ToWorld::Listen(self.id, Reply::new(OK)), Some(channel.has_stamps)).await;
            }
            (Ok(Command::Close), State::Open | State::Listening) => {
                channel.state = State::Closed;
                return self.ask(ToWorld::Unlisten(self.id, Reply::new(OK)), None).await;
            }
            (Ok(Command::Flags), State::Open | State::Listening) => {
                flags(std::mem::take(&mut lock(&self.talk).has_error))
            }
            (Ok(Command::Send(frame)), State::Open) => {
                self.leash.spend().await;
                self.world.tell(ToWorld::Send(self.id, frame));
                sent(&frame)
            }
            (Ok(_) | Err(Refused), _) => BELL,
        };
        self.ask(ToWorld::Reply(self.id, Reply::new(answer)), None).await;
    }

    /// Asks the world for an answer; one that opens the channel says whether frames have time stamps from then on.
    async fn ask(&self, message: ToWorld, has_stamps: Option<bool>) {
        self.leash.spend().await;
        let mut talk = lock(&self.talk);
        talk.asked += 1;
        let answer = talk.asked;
        talk.opened.extend(has_stamps.map(|has_stamps| (answer, has_stamps)));
        drop(talk);
        self.world.tell(message);
    }

    /// Returns whether the bus has the bit rate that the client has set, if it has set one. Tells the user the first
    /// time that it has not.
    async fn is_at_rate(&self, channel: &mut Channel) -> bool {
        let Some(rate) = channel.rate else { return true };
        let (asked, answer) = oneshot::channel();
        self.world.tell(ToWorld::AskBitRate(asked));
        // A world that has ended answers nobody, and nobody reads what comes of it.
        let Ok(bus) = answer.await.map(|bus| bus.bits_per_second()) else { return false };
        if bus != rate && !std::mem::replace(&mut channel.has_told, true) {
            self.world.tell(ToWorld::Warn(format!(
                "{}: a client set {rate} bit/s, the bus runs at {bus} bit/s: its channel is not opened",
                self.line.url
            )));
        }
        bus == rate
    }
}

fn lock(talk: &Mutex<Talk>) -> MutexGuard<'_, Talk> {
    talk.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes what is in the queue, in as few writes as possible, until the world lets go of it or the client is gone.
async fn write(
    mut writer: impl AsyncWrite + Unpin,
    mut queue: Receiver<ToClient>,
    talk: &Mutex<Talk>,
) -> std::io::Result<()> {
    let mut batch = Vec::with_capacity(BATCH);
    let mut out = String::new();
    let (mut has_stamps, mut answers) = (false, 0);
    while queue.recv_many(&mut batch, BATCH).await > 0 {
        for message in batch.drain(..) {
            match message {
                ToClient::Frame(at, frame) => emit_frame(&mut out, &frame, has_stamps.then_some(at)),
                ToClient::Error(..) => lock(talk).has_error = true,
                ToClient::Reply(reply) => {
                    out.push_str(&reply.text);
                    answers += 1;
                    if let Some((_, opened)) = lock(talk).opened.pop_front_if(|(answer, _)| *answer == answers) {
                        has_stamps = opened;
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
