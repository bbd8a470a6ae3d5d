//! The session of one client: executes lines, and writes answers and frames.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::oneshot;

use super::protocol::{BELL, Command, OK, Parser, Refused, SERIAL, VERSION, emit_frame, flags, judge, sent};
use crate::gateway::guard::Judge;
use crate::gateway::session::{Client, Dialogue};
use crate::inbox::{Reply, ToClient, ToWorld};

/// The dialogue with one client, which has its own adapter.
#[derive(Debug)]
pub struct Session {
    /// The URL of the adapter, for warnings.
    url: Arc<str>,
    parser: Parser,
    state: State,
    /// The bit rate that the client has set, in bit/s.
    rate: Option<u32>,
    /// Whether frames have time stamps after the next opening.
    has_stamps: bool,
    /// Whether the channel has been open at least once.
    was_open: bool,
    /// Whether the user was warned that the client's bit rate differs from that of the bus.
    has_told: bool,
    talk: Arc<Mutex<Talk>>,
}

/// The state of the client's channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Closed,
    Open,
    /// Open in listen-only mode.
    Listening,
}

/// The data shared by the command reader and the answer writer.
#[derive(Debug, Default)]
struct Talk {
    /// The number of requested answers.
    asked: u64,
    /// The pending answers that open the channel: the number of the answer, and whether frames after the answer have
    /// time stamps. Frames before the answer use the previous setting.
    opened: VecDeque<(u64, bool)>,
    /// Whether a bus error has occurred since the client last read the flags.
    has_error: bool,
}

impl Talk {
    /// Counts a requested answer. `has_stamps` is `Some` only for an answer that opens the channel: whether later
    /// frames have time stamps.
    fn note(&mut self, has_stamps: Option<bool>) {
        self.asked += 1;
        self.opened.extend(has_stamps.map(|has_stamps| (self.asked, has_stamps)));
    }
}

impl Session {
    /// Creates the dialogue with a new client of this URL.
    #[must_use]
    pub fn new(url: Arc<str>) -> Self {
        Self {
            url,
            parser: Parser::default(),
            state: State::Closed,
            rate: None,
            has_stamps: false,
            was_open: false,
            has_told: false,
            talk: Arc::default(),
        }
    }

    /// Executes a line and answers it.
    async fn execute(&mut self, command: Result<Command, Refused>, client: &Client) {
        let answer = match (command, self.state) {
            (Ok(Command::Nothing | Command::AutoSend), _) => OK,
            (Ok(Command::Version), _) => VERSION,
            (Ok(Command::Serial), _) => SERIAL,
            (Ok(Command::SetRate(rate)), State::Closed) => {
                self.rate = Some(rate);
                OK
            }
            (Ok(Command::Stamps(on)), State::Closed) => {
                self.has_stamps = on;
                OK
            }
            (Ok(command @ (Command::Open | Command::Listen)), State::Closed) if self.is_at_rate(client).await => {
                self.state = if command == Command::Open { State::Open } else { State::Listening };
                self.was_open = true;
                return self.ask(client, ToWorld::Listen(client.id, Reply::new(OK)), Some(self.has_stamps)).await;
            }
            (Ok(Command::Close), State::Open | State::Listening) => {
                self.state = State::Closed;
                return self.ask(client, ToWorld::Unlisten(client.id, Reply::new(OK)), None).await;
            }
            (Ok(Command::Flags), State::Open | State::Listening) => {
                flags(std::mem::take(&mut lock(&self.talk).has_error))
            }
            (Ok(Command::Send(frame)), State::Open) => {
                client.tell(ToWorld::Send(client.id, frame)).await;
                sent(&frame)
            }
            (Ok(_) | Err(Refused), _) => BELL,
        };
        self.ask(client, ToWorld::Reply(client.id, Reply::new(answer)), None).await;
    }

    /// Sends the world a message that requests an answer, and counts the answer. `has_stamps` is `Some` only for an
    /// answer that opens the channel: whether later frames have time stamps.
    async fn ask(&self, client: &Client, message: ToWorld, has_stamps: Option<bool>) {
        lock(&self.talk).note(has_stamps);
        client.tell(message).await;
    }

    /// Returns whether the client's bit rate is unset or equal to that of the bus. Reports the client's first mismatch
    /// to the user.
    async fn is_at_rate(&mut self, client: &Client) -> bool {
        let Some(rate) = self.rate else { return true };
        let (asked, answer) = oneshot::channel();
        client.world.tell(ToWorld::AskBitRate(asked));
        // The world has ended: it will not answer, and the client will be disconnected.
        let Ok(bus) = answer.await.map(|bus| bus.bits_per_second()) else { return false };
        if bus != rate && !std::mem::replace(&mut self.has_told, true) {
            client.world.tell(ToWorld::Warn(format!(
                "{}: a client set {rate} bit/s, but the bus runs at {bus} bit/s: the channel stays closed",
                self.url
            )));
        }
        bus == rate
    }
}

impl Dialogue for Session {
    const JUDGE: Judge = judge;
    const NO_PLACE: &'static str = BELL;
    const GREETING: Option<&'static str> = None;

    fn is_opened(&self) -> bool {
        self.was_open
    }

    async fn hear(&mut self, bytes: &[u8], client: &Client) {
        for byte in bytes {
            if let Some(command) = self.parser.push(*byte) {
                self.execute(command, client).await;
            }
        }
    }

    fn emitter(&self) -> impl FnMut(&mut String, ToClient) -> Duration + Send + use<> {
        let talk = Arc::clone(&self.talk);
        let (mut has_stamps, mut answers) = (false, 0);
        move |out, message| {
            match message {
                ToClient::Frame(at, frame) => emit_frame(out, &frame, has_stamps.then_some(at)),
                ToClient::Error(..) => lock(&talk).has_error = true,
                ToClient::Reply(reply) => {
                    out.push_str(&reply.text);
                    answers += 1;
                    if let Some((_, opened)) = lock(&talk).opened.pop_front_if(|(answer, _)| *answer == answers) {
                        has_stamps = opened;
                    }
                }
            }
            Duration::ZERO
        }
    }
}

fn lock(talk: &Mutex<Talk>) -> MutexGuard<'_, Talk> {
    talk.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
