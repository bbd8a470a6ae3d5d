//! A second parser of slcan, line by line after docs/pve-sim.md.

use hal_sim::Frame;
use pve_sim::gateway::Dialogue;
use pve_sim::gateway::slcan::Session;

use super::Model;

const OK: &str = "\r";
const BELL: &str = "\x07";
const BUS_RATE: u32 = 250_000;
const VERSION: &str = concat!("V10", env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), "\r");

#[derive(Default)]
pub(super) struct Slcan {
    is_client: bool,
    is_foreign: bool,
    line: Vec<u8>,
    channel: Channel,
    rate: Option<u32>,
    has_stamps: bool,
    /// The state of timestamps at the last opening.
    is_stamped: bool,
    answers: String,
    frames: Vec<Frame>,
}

#[derive(Clone, Copy, Default, PartialEq)]
enum Channel {
    #[default]
    Closed,
    Open,
    Listening,
}

impl Model for Slcan {
    const LAST_WORD: &'static [u8] = b"\rV\r";
    const NEXT: (&'static [u8], &'static str) = (b"\rO\rt12310A\r", "\r\rz\r");

    fn dialogue() -> impl Dialogue + 'static {
        Session::new("tcp".into())
    }

    fn read(&mut self, piece: &[u8]) {
        for byte in piece {
            if self.is_client || self.is_foreign {
                break;
            }
            self.is_client = *byte == b'\r';
            self.is_foreign |= !(byte.is_ascii_alphanumeric() || matches!(byte, b'\r' | b'\n'));
        }
        let piece = if self.is_foreign { &[] } else { piece };
        for byte in piece.iter().filter(|byte| **byte != b'\n') {
            if *byte == b'\r' {
                let line = std::mem::take(&mut self.line);
                let answer = str::from_utf8(&line).ok().and_then(|line| self.execute(line));
                self.answers.push_str(answer.unwrap_or(BELL));
            } else {
                self.line.push(*byte);
            }
        }
    }

    fn is_foreign(&self) -> bool {
        self.is_foreign
    }

    fn check_answers(&self, heard: &str) {
        assert_eq!(heard, self.answers);
    }

    fn check_frames(&self, frames: &[Frame]) {
        assert_eq!(frames, self.frames);
    }

    fn check_heard(&self, heard: &str) {
        let line = if self.is_foreign || self.channel == Channel::Closed { "" } else { "t7FF101" };
        if self.is_stamped && !line.is_empty() {
            assert!(heard.starts_with(line) && heard.len() == line.len() + 5, "{heard:?}");
        } else {
            assert_eq!(heard.trim_end(), line);
        }
    }
}

impl Slcan {
    /// Returns the answer to a line; `None` for a line that is not executed.
    fn execute(&mut self, line: &str) -> Option<&'static str> {
        let is_closed = self.channel == Channel::Closed;
        let mut chars = line.chars();
        let command = chars.next();
        let rest = chars.as_str();
        let is_hex = !rest.is_empty() && rest.bytes().all(|digit| digit.is_ascii_hexdigit());
        match command {
            None => Some(OK),
            Some('V') if rest.is_empty() => Some(VERSION),
            Some('N') if rest.is_empty() => Some("NPVE0\r"),
            Some('X') if rest == "1" => Some(OK),
            Some('F') if rest.is_empty() && !is_closed => Some("F00\r"),
            Some('C') if rest.is_empty() && !is_closed => {
                self.channel = Channel::Closed;
                Some(OK)
            }
            Some('O' | 'L') if rest.is_empty() && is_closed && self.rate.is_none_or(|rate| rate == BUS_RATE) => {
                self.channel = if command == Some('O') { Channel::Open } else { Channel::Listening };
                self.is_stamped = self.has_stamps;
                Some(OK)
            }
            Some('S') if is_closed && rest.len() == 1 => {
                const KBIT: [u32; 9] = [10, 20, 50, 100, 125, 250, 500, 800, 1000];
                self.rate = Some(KBIT.get(rest.parse::<usize>().ok()?)? * 1000);
                Some(OK)
            }
            Some('s') if is_closed && is_hex && rest.len() == 4 => {
                let registers = u32::from_str_radix(rest, 16).ok()?;
                let (prescaler, first, second) = (registers >> 8 & 63, registers & 15, registers >> 4 & 7);
                self.rate = Some(8_000_000 / ((prescaler + 1) * (3 + first + second)));
                Some(OK)
            }
            Some('Z') if is_closed && matches!(rest, "0" | "1") => {
                self.has_stamps = rest == "1";
                Some(OK)
            }
            Some(kind @ ('t' | 'T' | 'r' | 'R')) if is_hex && self.channel == Channel::Open => {
                let is_long = kind.is_ascii_uppercase();
                let (id, rest) = rest.split_at_checked(if is_long { 8 } else { 3 })?;
                let (length, data) = rest.split_at_checked(1)?;
                let digits: usize = length.parse().ok().filter(|length| *length <= 8)?;
                let text = match kind {
                    't' | 'T' if data.len() == 2 * digits => format!("{id}: {data}"),
                    'r' | 'R' if data.is_empty() => format!("{id}: R{length}"),
                    _ => return None,
                };
                self.frames.push(frame(&text)?);
                Some(if is_long { "Z\r" } else { "z\r" })
            }
            _ => None,
        }
    }
}

/// Parses a printed frame, with or without blanks between its bytes.
pub(super) fn frame(text: &str) -> Option<Frame> {
    let (id, data) = text.split_once(": ")?;
    let pairs: Vec<&str> = match data.strip_prefix('R') {
        Some(_) => vec![data],
        None => (0..data.len()).step_by(2).filter_map(|at| data.get(at..at + 2)).collect(),
    };
    format!("{}: {}", id.to_uppercase(), pairs.join(" ").to_uppercase()).trim_end().parse().ok()
}
