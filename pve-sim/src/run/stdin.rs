//! Reads the lines on stdin on a separate thread. The end of stdin does not end the run.

use std::io::{self, Read};

use tokio::sync::oneshot;

use super::system;
use crate::inbox::{ToWorld, WorldSender};

/// The maximum line length, in bytes; longer lines are cut and marked with [`CUT`].
pub(super) const LINE: usize = 256;

/// The mark of a cut line; no word contains it.
const CUT: char = '…';

/// Starts the thread, which is never joined. If the thread cannot start, there is no console.
pub(super) fn listen(world: WorldSender) {
    let _ = std::thread::Builder::new().name("stdin".to_owned()).spawn(move || {
        let stdin = io::stdin();
        execute(&world, |bytes| if system::wait_for_input() { stdin.lock().read(bytes) } else { Ok(0) });
    });
}

/// Executes the lines of an input one at a time. A program that writes too fast is therefore blocked, and messages of
/// other clients can take effect between two lines.
fn execute(world: &WorldSender, mut read: impl FnMut(&mut [u8]) -> io::Result<usize>) {
    let mut lines = Lines::default();
    let mut bytes = [0; LINE];
    loop {
        match read(&mut bytes) {
            Ok(0) => break,
            Ok(len) => lines.push(&bytes[..len], |line| tell(world, line)),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(_) => break,
        }
    }
}

/// Sends a line to the world, and waits for its execution.
pub(super) fn tell(world: &WorldSender, line: String) {
    let (obeyed, done) = oneshot::channel();
    world.tell(ToWorld::Typed(line, obeyed));
    let _ = done.blocking_recv();
}

/// The parser of lines.
#[derive(Debug, Default)]
pub struct Lines {
    /// The incomplete line, at most [`LINE`] + 1 bytes. A line of that length is too long; its further bytes are
    /// dropped.
    line: Vec<u8>,
}

impl Lines {
    /// Processes bytes, and passes each completed line to `tell`.
    pub fn push(&mut self, bytes: &[u8], mut tell: impl FnMut(String)) {
        for byte in bytes {
            match byte {
                b'\n' => {
                    let kept = self.line.len().min(LINE);
                    let mut line = String::from_utf8_lossy(&self.line[..kept]).into_owned();
                    if kept < self.line.len() {
                        line.push(CUT);
                    }
                    self.line.clear();
                    tell(line);
                }
                byte if self.line.len() <= LINE => self.line.push(*byte),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread;

    use super::*;

    #[test]
    fn lines_come_whole_however_they_are_cut() {
        let (mut lines, mut told) = (Lines::default(), Vec::new());
        for part in ["sta", "tus\nhelp\r\n", "\nrest"] {
            lines.push(part.as_bytes(), |line| told.push(line));
        }
        assert_eq!(told, ["status", "help\r", ""]);
    }

    /// A cut line is not taken for a shorter word or number.
    #[test]
    fn a_line_that_is_too_long_says_so_at_its_end() {
        let (mut lines, mut told) = (Lines::default(), Vec::new());
        let blanks = " ".repeat(LINE - "status".len());
        for line in [format!("status{blanks}\n"), format!("status{blanks}x\n"), "x".repeat(100 * LINE)] {
            lines.push(line.as_bytes(), |line| told.push(line));
        }
        assert!(lines.line.len() <= LINE + 1);
        lines.push(b"\nstatus\n", |line| told.push(line));
        assert_eq!(
            told,
            [format!("status{blanks}"), format!("status{blanks}…"), "x".repeat(LINE) + "…", "status".into()]
        );
    }

    #[test]
    fn stdin_is_not_read_before_the_world_has_obeyed_a_line() {
        const READS: usize = 1000;
        let (world, inbox) = WorldSender::new();
        let reads = Arc::<AtomicUsize>::default();
        let reader = thread::spawn({
            let reads = Arc::clone(&reads);
            move || {
                execute(&world, |bytes| {
                    let is_over = reads.fetch_add(1, Ordering::SeqCst) == READS;
                    bytes[..14].copy_from_slice(b"status\nstatus\n");
                    Ok(if is_over { 0 } else { 14 })
                });
            }
        });
        for line in 0..2 * READS {
            let ToWorld::Typed(text, obeyed) = inbox.messages.recv().expect("a line").message else {
                panic!("no line")
            };
            assert_eq!(text, "status");
            assert!(inbox.messages.try_recv().is_err(), "a second line arrived before line {line} was executed");
            assert_eq!(reads.load(Ordering::SeqCst), line / 2 + 1);
            drop(obeyed);
        }
        reader.join().expect("no panic");
    }
}
