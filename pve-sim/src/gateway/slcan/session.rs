//! The session of one client: executes lines, and writes answers and frames.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::oneshot;

use super::protocol::{
    BELL, BUS_ERROR, Command, NO_ERROR, OK, Parser, Refused, SENT_EXTENDED, SENT_STANDARD, SERIAL, VERSION, emit_frame,
    judge,
};
use crate::gateway::guard::Judge;
use crate::gateway::session::{Client, Dialogue};
use crate::inbox::{Note, Reply, ToClient, ToWorld};

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
    has_warned: bool,
    /// Whether a bus error has occurred since the client last read the flags; set by the writer of messages.
    has_error: Arc<AtomicBool>,
}

/// The state of the client's channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Closed,
    Open,
    /// Open in listen-only mode.
    Listening,
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
            has_warned: false,
            has_error: Arc::default(),
        }
    }

    /// Executes a line and answers it.
    async fn execute(&mut self, command: Result<Command, Refused>, client: &Client) {
        let answer =
            match (command, self.state) {
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
                    let opened = Reply { text: OK.into(), note: Note::Stamps(self.has_stamps) };
                    return client.tell(ToWorld::Listen(client.id, opened)).await;
                }
                (Ok(Command::Close), State::Open | State::Listening) => {
                    self.state = State::Closed;
                    return client.tell(ToWorld::Unlisten(client.id, Reply::new(OK))).await;
                }
                (Ok(Command::Flags), State::Open | State::Listening) => {
                    if self.has_error.swap(false, Ordering::Relaxed) { BUS_ERROR } else { NO_ERROR }
                }
                (Ok(Command::Send(frame)), State::Open) => {
                    client.tell(ToWorld::Send(client.id, frame)).await;
                    if frame.is_extended() { SENT_EXTENDED } else { SENT_STANDARD }
                }
                (Ok(_) | Err(Refused), _) => BELL,
            };
        client.tell(ToWorld::Reply(client.id, Reply::new(answer))).await;
    }

    /// Returns whether the client's bit rate is unset or equal to that of the bus. Reports the client's first mismatch
    /// to the user.
    async fn is_at_rate(&mut self, client: &Client) -> bool {
        let Some(rate) = self.rate else { return true };
        let (asked, answer) = oneshot::channel();
        client.world.tell(ToWorld::AskBitRate(asked));
        // Without an answer, the world has ended, and the client will be disconnected.
        let Ok(bus) = answer.await.map(|bus| bus.bits_per_second()) else { return false };
        if bus != rate && !std::mem::replace(&mut self.has_warned, true) {
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
    const REFUSAL: &'static str = BELL;
    const GREETING: Option<&'static str> = None;

    fn is_opened(&self) -> bool {
        self.was_open
    }

    async fn receive(&mut self, bytes: &[u8], client: &Client) {
        for byte in bytes {
            if let Some(command) = self.parser.push(*byte) {
                self.execute(command, client).await;
            }
        }
    }

    fn encoder(&self) -> impl FnMut(&mut String, ToClient) -> Duration + Send + use<> {
        let has_error = Arc::clone(&self.has_error);
        let mut has_stamps = false;
        move |out, message| {
            match message {
                ToClient::Frame(at, frame) => emit_frame(out, &frame, has_stamps.then_some(at)),
                ToClient::Error(..) => has_error.store(true, Ordering::Relaxed),
                ToClient::Reply(Reply { text, note }) => {
                    out.push_str(&text);
                    if let Note::Stamps(on) = note {
                        has_stamps = on;
                    }
                }
            }
            Duration::ZERO
        }
    }
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
