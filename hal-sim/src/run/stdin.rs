//! The lines that are typed on stdin, on a thread of their own. The end of stdin ends nothing else.

use std::io::{self, Read};

use super::system;
use crate::gateway::{Entrance, ToWorld};

/// The longest line, in bytes; longer ones are cut, and so not understood.
const LINE: usize = 256;

/// Starts the thread, which nobody waits for. Without it nothing can be typed.
pub(super) fn listen(world: Entrance) {
    let _ = std::thread::Builder::new().name("stdin".to_owned()).spawn(move || {
        let stdin = io::stdin();
        let mut lines = Lines::default();
        let mut bytes = [0; LINE];
        while system::wait_for_input() {
            match stdin.lock().read(&mut bytes) {
                Ok(0) => break,
                Ok(len) => lines.push(&bytes[..len], |line| world.tell(ToWorld::Typed(line))),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => break,
            }
        }
    });
}

/// Lines out of bytes as they come.
#[derive(Debug, Default)]
struct Lines {
    line: Vec<u8>,
}

impl Lines {
    fn push(&mut self, bytes: &[u8], mut tell: impl FnMut(String)) {
        for byte in bytes {
            match byte {
                b'\n' => tell(String::from_utf8_lossy(&std::mem::take(&mut self.line)).into_owned()),
                byte if self.line.len() < LINE => self.line.push(*byte),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_whole_however_they_are_cut() {
        let (mut lines, mut told) = (Lines::default(), Vec::new());
        for part in ["sta", "tus\nhelp\r\n", "\nrest"] {
            lines.push(part.as_bytes(), |line| told.push(line));
        }
        assert_eq!(told, ["status", "help\r", ""]);
        told.clear();
        lines.push(&[b'x'; 2 * LINE], |line| told.push(line));
        lines.push(b"\nstatus\n", |line| told.push(line));
        assert_eq!((told[0].len(), told[1].as_str()), (LINE, "status"));
    }
}
