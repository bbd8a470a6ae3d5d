//! Bytes on stdin, which become the lines of the console.

use pve_sim::run::Lines;

/// Longest line, in bytes.
const LINE: usize = 256;

/// A user, or a script, whose bytes arrive in pieces.
#[derive(Default)]
pub(crate) struct Keyboard {
    lines: Lines,
    /// Bytes since the last end of a line.
    begun: Vec<u8>,
}

impl Keyboard {
    /// Types bytes, and perhaps the end of the line; returns the line that comes of it, if one does.
    pub(crate) fn enter(&mut self, bytes: &[u8], is_whole: bool) -> Option<String> {
        self.begun.extend(bytes);
        let typed = [bytes, if is_whole { b"\n" } else { b"" }].concat();
        let mut told = Vec::new();
        // As long as the line before the first blank: neither words nor lines end where a piece does.
        let piece = 1 + bytes.iter().take_while(|byte| **byte != b' ').count();
        typed.chunks(piece).for_each(|piece| self.lines.push(piece, |line| told.push(line)));
        let expected = is_whole.then(|| line(&std::mem::take(&mut self.begun)));
        assert_eq!(told.as_slice(), expected.as_slice());
        expected
    }
}

/// Returns the line that bytes are: cut where it is too long, and marked so.
fn line(bytes: &[u8]) -> String {
    let (kept, cut) = bytes.split_at_checked(LINE).unwrap_or((bytes, &[]));
    String::from_utf8_lossy(kept).into_owned() + if cut.is_empty() { "" } else { "…" }
}
