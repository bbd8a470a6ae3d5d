//! A second parser of socketcand, message by message.

use hal_sim::Frame;
use pve_sim::gateway::Dialogue;
use pve_sim::gateway::socketcand::{MESSAGE_MAX, Session};

use super::Model;

#[derive(Default)]
pub(super) struct Socketcand {
    is_client: bool,
    is_foreign: bool,
    place: Place,
    message: Vec<u8>,
    is_open: bool,
    is_raw: bool,
    answers: Vec<Answer>,
    sent: Vec<Frame>,
}

#[derive(Clone, Copy, Default)]
enum Place {
    #[default]
    Between,
    Inside,
    Skipping,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Answer {
    Hi,
    Ok,
    Echo,
    Error,
}

impl Model for Socketcand {
    const LAST_WORD: &'static [u8] = b"> < echo >";
    const NEXT: (&'static [u8], &'static str) = (b"< open pve0 >< rawmode >< send 123 1 0A >", "< hi >< ok >< ok >");

    fn dialogue() -> impl Dialogue + 'static {
        Session::new("pve0".into())
    }

    fn read(&mut self, piece: &[u8]) {
        let first = piece.iter().find(|byte| !byte.is_ascii_whitespace());
        if !self.is_client
            && let Some(first) = first
        {
            self.is_client = *first == b'<';
            self.is_foreign |= !self.is_client;
        }
        if self.is_foreign {
            return;
        }
        for byte in piece {
            match (self.place, byte) {
                (Place::Inside, b'>') => {
                    self.place = Place::Between;
                    let message = String::from_utf8_lossy(&std::mem::take(&mut self.message)).into_owned();
                    let words: Vec<&str> = message.split_ascii_whitespace().collect();
                    let answer = self.execute(&words).unwrap_or(Some(Answer::Error));
                    self.answers.extend(answer);
                }
                (Place::Inside, byte) => {
                    let is_begun_anew = *byte == b'<';
                    let is_too_long = self.message.len() == MESSAGE_MAX;
                    if is_begun_anew || is_too_long {
                        self.answers.push(Answer::Error);
                        self.message.clear();
                        self.place = if is_begun_anew { Place::Inside } else { Place::Skipping };
                    } else {
                        self.message.push(*byte);
                    }
                }
                (Place::Skipping, b'>') => self.place = Place::Between,
                (_, b'<') => self.place = Place::Inside,
                _ => {}
            }
        }
    }

    fn is_foreign(&self) -> bool {
        self.is_foreign
    }

    fn check_answers(&self, heard: &str) {
        let answers = heard.split_inclusive('>').map(|message| {
            let message = message.trim().strip_prefix('<').and_then(|message| message.strip_suffix('>'));
            let message = message.unwrap_or_else(|| panic!("no message: {heard}")).trim();
            match message.split(' ').next().unwrap_or_default() {
                "hi" => Answer::Hi,
                "ok" => Answer::Ok,
                "echo" => Answer::Echo,
                "error" => Answer::Error,
                _ => panic!("nobody asked for {message}"),
            }
        });
        let answers: Vec<Answer> = answers.collect();
        // A client with foreign first bytes may have been greeted before.
        let expected: Vec<Answer> = [Answer::Hi].into_iter().chain(self.answers.iter().copied()).collect();
        assert_eq!(answers, expected, "{heard}");
    }

    fn check_frames(&self, frames: &[Frame]) {
        assert_eq!(frames, self.sent);
    }

    fn check_heard(&self, heard: &str) {
        if self.is_raw {
            assert!(heard.starts_with("< frame 7FF ") && heard.ends_with(" 01 >"), "{heard}");
        } else {
            assert_eq!(heard, "");
        }
    }
}

impl Socketcand {
    /// Returns the answer to a message, if it has one; the outer `None` stands for a refused message.
    fn execute(&mut self, words: &[&str]) -> Option<Option<Answer>> {
        match words {
            ["echo"] => Some(Some(Answer::Echo)),
            ["open", "pve0"] if !self.is_open => {
                self.is_open = true;
                Some(Some(Answer::Ok))
            }
            ["rawmode"] if self.is_open => {
                self.is_raw = true;
                Some(Some(Answer::Ok))
            }
            ["send", id, length, data @ ..] if self.is_open => {
                self.sent.push(frame(id, length, data)?);
                Some(None)
            }
            _ => None,
        }
    }
}

fn frame(id: &str, length: &str, data: &[&str]) -> Option<Frame> {
    let id = identifier(id)?;
    let length = number(length, 8).filter(|length| *length <= 8)?;
    if data.is_empty() && length > 0 {
        return format!("{id}: R{length}").parse().ok();
    }
    let bytes: Option<Vec<String>> =
        data.iter().map(|byte| number(byte, 8).map(|byte| format!("{byte:02X}"))).collect();
    let bytes = bytes.filter(|bytes| bytes.len() as u64 == length)?;
    format!("{id}: {}", bytes.join(" ")).parse().ok()
}

/// Parses a printed identifier.
fn identifier(word: &str) -> Option<String> {
    const EXTENDED: u64 = 1 << 31;
    let raw = number(word, 32)?;
    let id = raw & !EXTENDED;
    match id {
        _ if word.len() == 8 || raw & EXTENDED != 0 => (id <= 0x1FFF_FFFF).then(|| format!("{id:08X}")),
        0..=0x7FF => Some(format!("{id:03X}")),
        _ => None,
    }
}

/// Parses a hexadecimal number of `bits` bits, which may be sign-extended to 32 or 64 bits.
fn number(word: &str, bits: u32) -> Option<u64> {
    let (sign, digits) = word.strip_prefix('-').map_or((1, word), |digits| (-1, digits));
    let digits = digits.strip_prefix("0x").or(digits.strip_prefix("0X")).unwrap_or(digits);
    let is_hex = !digits.is_empty() && digits.chars().all(|digit| digit.is_ascii_hexdigit());
    let value = i128::from(u64::from_str_radix(digits, 16).ok().filter(|_| is_hex)?) * sign;
    let value = value.rem_euclid(1 << 64);
    let (end, half) = (1_i128 << bits, 1_i128 << (bits - 1));
    let is_in = |width: u32| ((1_i128 << width) - half..1_i128 << width).contains(&value);
    (value < end || is_in(32) || is_in(64)).then(|| value.rem_euclid(end) as u64)
}
