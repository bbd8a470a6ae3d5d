//! Decodes the requests of socketcand and encodes the replies. No I/O; the only state is an incomplete message.

use std::fmt::Write;

use protocol_core::frame::{self, Frame, Id, MAX_LEN};

use crate::gateway::guard::Verdict;
use hal_sim::log::{ErrorClass, ErrorFrame, Timestamp, write_hex};

/// The maximum message length between `<` and `>`, in bytes; a client that sends every number in 64 bits needs 160.
pub const MESSAGE_MAX: usize = 256;

/// The greeting of a client.
pub(super) const HI: &str = "< hi >";
/// The answer to `< echo >`.
pub(super) const ECHO: &str = "< echo >";
/// The answer to an executed request.
pub(super) const OK: &str = "< ok >";

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

/// The reason why a message was refused, which goes to the client.
pub type Refusal = &'static str;

/// The refusal of a number that is no identifier.
const IDENTIFIER: Refusal = "bad identifier; accepted: 0 to 1FFFFFFF in hex";
/// The refusal of more than [`MESSAGE_MAX`] bytes without an end.
pub(super) const TOO_LONG: Refusal = "message too long";
/// The refusal of a message before whose end another one begins.
pub(super) const UNTERMINATED: Refusal = "unterminated message";

/// Parses messages from a byte stream, independent of read boundaries. Skips the bytes between messages, and the rest
/// of a message that is too long.
#[derive(Debug, Default)]
pub struct Parser {
    is_inside: bool,
    message: Vec<u8>,
}

impl Parser {
    /// Processes the next byte. Returns a request if the byte completes a message, or the refusal that the byte causes.
    pub fn push(&mut self, byte: u8) -> Option<Result<Request, Refusal>> {
        match byte {
            b'<' => {
                self.message.clear();
                std::mem::replace(&mut self.is_inside, true).then_some(Err(UNTERMINATED))
            }
            _ if !self.is_inside => None,
            b'>' => {
                self.is_inside = false;
                Some(parse(&String::from_utf8_lossy(&self.message)))
            }
            _ if self.message.len() == MESSAGE_MAX => {
                self.is_inside = false;
                Some(Err(TOO_LONG))
            }
            _ => {
                self.message.push(byte);
                None
            }
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
fn parse(message: &str) -> Result<Request, Refusal> {
    let words: Vec<&str> = message.split_ascii_whitespace().collect();
    match words.as_slice() {
        ["open", name] => Ok(Request::Open((*name).to_owned())),
        ["rawmode"] => Ok(Request::RawMode),
        ["echo"] => Ok(Request::Echo),
        ["send", id, len, bytes @ ..] => send(id, len, bytes).map(Request::Send),
        ["open" | "rawmode" | "echo" | "send", ..] => Err("wrong number of arguments"),
        _ => Err("unknown command; accepted: open, rawmode, send, echo"),
    }
}

fn send(id: &str, len: &str, bytes: &[&str]) -> Result<Frame, Refusal> {
    let id = identifier(id)?;
    let len = hex(len, 8).and_then(|len| u8::try_from(len).ok()).filter(|len| usize::from(*len) <= MAX_LEN);
    let len = len.ok_or("bad length; accepted: 0 to 8")?;
    if bytes.is_empty() && len > 0 {
        return Ok(Frame::remote(id, len));
    }
    if bytes.len() != usize::from(len) {
        return Err("length and number of bytes differ");
    }
    let mut data = [0; MAX_LEN];
    for (slot, word) in data.iter_mut().zip(bytes) {
        let [byte, ..] = hex(word, 8).ok_or("bad data byte; accepted: 00 to FF")?.to_le_bytes();
        *slot = byte;
    }
    Ok(Frame::with_len(id, data, len))
}

/// Parses an identifier. An identifier is extended if the word has eight characters, or if bit 31 is set (the flag in
/// SocketCAN's `can_id`), which may appear as the sign of the number.
fn identifier(word: &str) -> Result<Id, Refusal> {
    const EXTENDED: u32 = 1 << 31;
    let raw = hex(word, 32).ok_or(IDENTIFIER)?;
    let number = raw & !EXTENDED;
    let is_extended = word.len() == 8 || raw & EXTENDED != 0;
    match frame::identifier(number, is_extended) {
        Some(id) => Ok(id),
        None if frame::identifier(number, true).is_some() => Err("an identifier above 7FF needs eight digits"),
        None => Err(IDENTIFIER),
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
pub(super) fn emit_error(out: &mut String, at: Timestamp, class: ErrorClass) {
    let _ = write!(out, "< error {:03X} {at} >", ErrorFrame::from(class).class);
}

/// Returns `< error … >` with the reason why a message was refused.
pub(super) fn emit_refusal(reason: &str) -> String {
    format!("< error {reason} >")
}

#[cfg(test)]
#[path = "protocol_tests.rs"]
mod tests;
