//! The bytes on stdin, which become lines of the console.

use pve_sim::run::Lines;

/// The maximum length of a line, in bytes.
const LINE: usize = 256;

/// A user or a script, whose bytes arrive in pieces.
#[derive(Default)]
pub(crate) struct Keyboard {
    lines: Lines,
    /// The bytes since the last end of a line.
    begun: Vec<u8>,
}

impl Keyboard {
    /// Types bytes and, if `is_whole`, the end of the line. Returns a completed line.
    pub(crate) fn enter(&mut self, bytes: &[u8], is_whole: bool) -> Option<String> {
        self.begun.extend(bytes);
        let typed = [bytes, if is_whole { b"\n" } else { b"" }].concat();
        let mut told = Vec::new();
        // The piece is as long as the line before its first blank, so that neither words nor lines end where a piece
        // does.
        let piece = 1 + bytes.iter().take_while(|byte| **byte != b' ').count();
        typed.chunks(piece).for_each(|piece| self.lines.push(piece, |line| told.push(line)));
        let expected = is_whole.then(|| line(&std::mem::take(&mut self.begun)));
        assert_eq!(told.as_slice(), expected.as_slice());
        expected
    }
}

/// Returns the line of these bytes. A line that is too long is cut and marked.
fn line(bytes: &[u8]) -> String {
    let (kept, cut) = bytes.split_at_checked(LINE).unwrap_or((bytes, &[]));
    String::from_utf8_lossy(kept).into_owned() + if cut.is_empty() { "" } else { "…" }
}
