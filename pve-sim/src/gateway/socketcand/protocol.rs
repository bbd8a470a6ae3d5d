//! Decodes the requests of socketcand and encodes the replies. No I/O; the only state is an incomplete message.

use std::fmt::Write;

use protocol_core::frame::{Frame, Id, MAX_LEN, extended, standard};

use crate::gateway::guard::Verdict;
use hal_sim::log::{ErrorClass, Timestamp, write_hex};

/// The maximum message length between `<` and `>`, in bytes; a client that sends every number in 64 bits needs 160.
pub const MESSAGE_MAX: usize = 256;

/// The greeting of a client.
pub const HI: &str = "< hi >";
/// The answer to `< echo >`.
pub const ECHO: &str = "< echo >";
/// The answer to an executed request.
pub const OK: &str = "< ok >";

/// A request of a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// `< open NAME >`
    Open(String),
    /// `< rawmode >`
    RawMode,
    /// `< echo >`
    Echo,
    /// `< send ID LEN BYTE… >`
    Send(Frame),
}

/// The reason why a message was refused; its text goes to the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    /// Unknown command.
    #[error("unknown command; accepted: open, rawmode, send, echo")]
    UnknownCommand,
    /// Wrong number of words for the command.
    #[error("wrong number of arguments")]
    Arguments,
    /// Not a hex number of at most 29 bits.
    #[error("bad identifier; accepted: 0 to 1FFFFFFF in hex")]
    Identifier,
    /// An identifier above 7FF that is not marked as extended.
    #[error("an identifier above 7FF needs eight digits")]
    NotExtended,
    /// Not a length of a classic CAN frame.
    #[error("bad length; accepted: 0 to 8")]
    Length,
    /// A number of bytes that differs from the length.
    #[error("length and number of bytes differ")]
    Count,
    /// Not a hex number of at most eight bits.
    #[error("bad data byte; accepted: 00 to FF")]
    Byte,
    /// More than [`MESSAGE_MAX`] bytes without an end.
    #[error("message too long")]
    TooLong,
    /// A message began before the previous one ended.
    #[error("unterminated message")]
    Interrupted,
}

/// Parses messages from a byte stream, independent of read boundaries. Skips the bytes between messages.
#[derive(Debug, Default)]
pub struct Parser {
    state: State,
    message: Vec<u8>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Between,
    Inside,
    /// The message is too long; its remaining bytes are skipped.
    Skipping,
}

impl Parser {
    /// Processes the next byte. Returns a request if the byte completes a message, or the error that the byte reveals.
    pub fn push(&mut self, byte: u8) -> Option<Result<Request, RequestError>> {
        match (self.state, byte) {
            (State::Inside, b'<') => {
                self.message.clear();
                Some(Err(RequestError::Interrupted))
            }
            (State::Between | State::Skipping, b'<') => {
                self.message.clear();
                self.state = State::Inside;
                None
            }
            (State::Inside, b'>') => {
                self.state = State::Between;
                Some(parse(&String::from_utf8_lossy(&self.message)))
            }
            (State::Inside, _) if self.message.len() == MESSAGE_MAX => {
                self.state = State::Skipping;
                Some(Err(RequestError::TooLong))
            }
            (State::Inside, _) => {
                self.message.push(byte);
                None
            }
            (State::Skipping, b'>') => {
                self.state = State::Between;
                None
            }
            (State::Between | State::Skipping, _) => None,
        }
    }
}

/// Judges the first bytes of a connection: a client begins with `<`, optionally after white space. An HTTP method
/// contains neither.
#[must_use]
pub(super) const fn judge(byte: u8) -> Verdict {
    match byte {
        b'<' => Verdict::Client,
        _ if byte.is_ascii_whitespace() => Verdict::Undecided,
        _ => Verdict::Foreign,
    }
}

/// Parses the text between `<` and `>`.
fn parse(message: &str) -> Result<Request, RequestError> {
    let words: Vec<&str> = message.split_ascii_whitespace().collect();
    match words.as_slice() {
        ["open", name] => Ok(Request::Open((*name).to_owned())),
        ["rawmode"] => Ok(Request::RawMode),
        ["echo"] => Ok(Request::Echo),
        ["send", id, len, bytes @ ..] => send(id, len, bytes).map(Request::Send),
        ["open" | "rawmode" | "echo" | "send", ..] => Err(RequestError::Arguments),
        _ => Err(RequestError::UnknownCommand),
    }
}

fn send(id: &str, len: &str, bytes: &[&str]) -> Result<Frame, RequestError> {
    let id = identifier(id)?;
    let len = hex(len, 8).and_then(|len| u8::try_from(len).ok()).filter(|len| usize::from(*len) <= MAX_LEN);
    let len = len.ok_or(RequestError::Length)?;
    if bytes.is_empty() && len > 0 {
        return Ok(Frame::remote(id, len));
    }
    if bytes.len() != usize::from(len) {
        return Err(RequestError::Count);
    }
    let mut data = [0; MAX_LEN];
    for (slot, word) in data.iter_mut().zip(bytes) {
        let [byte, ..] = hex(word, 8).ok_or(RequestError::Byte)?.to_le_bytes();
        *slot = byte;
    }
    Ok(Frame::with_len(id, data, len))
}

/// Parses an identifier. An identifier is extended if the word has eight characters, or if bit 31 is set (the flag in
/// SocketCAN's `can_id`), which may appear as the sign of the number.
fn identifier(word: &str) -> Result<Id, RequestError> {
    const EXTENDED: u32 = 1 << 31;
    const MAX: u32 = 0x1FFF_FFFF;
    let raw = hex(word, 32).ok_or(RequestError::Identifier)?;
    let number = raw & !EXTENDED;
    match u16::try_from(number) {
        _ if number > MAX => Err(RequestError::Identifier),
        _ if word.len() == 8 || raw & EXTENDED != 0 => Ok(extended(number).into()),
        Ok(number @ 0..=0x7FF) => Ok(standard(number).into()),
        _ => Err(RequestError::NotExtended),
    }
}

/// Parses a hex number of `bits` bits, as the reference daemon does: with or without `0x`. Clients that treat the
/// number as signed send a sign, or sign-extend to 32 or 64 bits, so that 80 becomes -80 or ffffff80.
fn hex(word: &str, bits: u32) -> Option<u32> {
    let (negative, digits) = word.strip_prefix('-').map_or((false, word), |digits| (true, digits));
    let digits = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")).unwrap_or(digits);
    if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    let number = u64::from_str_radix(digits, 16).ok()?;
    let wide = if negative { number.wrapping_neg() } else { number };
    let narrow = wide & ((1 << bits) - 1);
    // The sign extension repeats the highest bit.
    let widened = narrow | u64::MAX << (bits - 1);
    let fits = [narrow, widened, widened & u64::from(u32::MAX)].contains(&wide);
    u32::try_from(narrow).ok().filter(|_| fits)
}

/// Writes `< frame 18A 1795223549.715344 0102 >`, without blanks between the bytes. An empty frame ends with two blanks
/// before `>`.
///
/// Writes nothing for a remote frame, which the protocol cannot express.
pub fn emit_frame(out: &mut String, at: Timestamp, frame: &Frame) {
    if frame.is_remote() {
        return;
    }
    // Writing to a string cannot fail.
    let _ = match frame.id() {
        Id::Standard(id) => write!(out, "< frame {:03X} {at} ", id.as_raw()),
        Id::Extended(id) => write!(out, "< frame {:08X} {at} ", id.as_raw()),
    };
    write_hex(out, frame.data());
    out.push_str(" >");
}

/// Writes `< error 040 1795223549.715344 >`: an error frame.
pub fn emit_error(out: &mut String, at: Timestamp, class: ErrorClass) {
    let _ = write!(out, "< error {:03X} {at} >", class.code());
}

/// Returns `< error … >` with the reason why a message was refused.
#[must_use]
pub fn emit_refusal(error: RequestError) -> String {
    format!("< error {error} >")
}

#[cfg(test)]
#[path = "protocol_tests.rs"]
mod tests;
