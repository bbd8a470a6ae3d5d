//! The session of one client: executes requests, and writes answers and frames.

use std::sync::Arc;
use std::time::Duration;

use super::protocol::{ECHO, HI, OK, Parser, Refusal, Request, emit_error, emit_frame, emit_refusal, judge};
use crate::gateway::guard::Judge;
use crate::gateway::session::{Client, Dialogue};
use crate::inbox::{ClientId, Note, Reply, ToClient, ToWorld};

/// The pause between the answer to raw mode and the first frame: python-can mistakes a frame in the same read for a
/// wrong answer.
const HOLD_BACK: Duration = Duration::from_millis(20);

/// The dialogue with one client.
#[derive(Debug)]
pub struct Session {
    bus: Arc<str>,
    parser: Parser,
    is_open: bool,
}

impl Session {
    /// Creates the dialogue with a new client on the bus of this name.
    #[must_use]
    pub fn new(bus: Arc<str>) -> Self {
        Self { bus, parser: Parser::default(), is_open: false }
    }

    fn answer(&mut self, message: Result<Request, Refusal>, id: ClientId) -> ToWorld {
        let reply = |text| ToWorld::Reply(id, Reply::new(text));
        let refuse = |reason: &str| ToWorld::Reply(id, Reply::new(emit_refusal(reason)));
        match (message, self.is_open) {
            (Err(reason), _) => refuse(reason),
            (Ok(Request::Echo), _) => reply(ECHO),
            (Ok(Request::Open(name)), false) if *name == *self.bus => {
                self.is_open = true;
                reply(OK)
            }
            (Ok(Request::Open(_)), false) => refuse(&format!("unknown bus; accepted: {}", self.bus)),
            (Ok(Request::Open(_)), true) => refuse("the bus is already open"),
            (Ok(_), false) => refuse("open the bus first"),
            (Ok(Request::RawMode), true) => {
                ToWorld::Listen(id, Reply { text: OK.into(), note: Note::Pause(HOLD_BACK) })
            }
            (Ok(Request::Send(frame)), true) => ToWorld::Send(id, frame),
        }
    }
}

impl Dialogue for Session {
    const JUDGE: Judge = judge;
    const REFUSAL: &'static str = "< error too many clients >";
    const GREETING: Option<&'static str> = Some(HI);

    fn is_opened(&self) -> bool {
        self.is_open
    }

    async fn receive(&mut self, bytes: &[u8], client: &Client) {
        for byte in bytes {
            if let Some(message) = self.parser.push(*byte) {
                client.tell(self.answer(message, client.id)).await;
            }
        }
    }

    fn encoder(&self) -> impl FnMut(&mut String, ToClient) -> Duration + Send + use<> {
        emit
    }
}

fn emit(out: &mut String, message: ToClient) -> Duration {
    match message {
        ToClient::Frame(at, frame) => emit_frame(out, at, &frame),
        ToClient::Error(at, class) => emit_error(out, at, class),
        ToClient::Reply(Reply { text, note }) => {
            out.push_str(&text);
            if let Note::Pause(pause) = note {
                return pause;
            }
        }
    }
    Duration::ZERO
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
