//! One terminal for the trace and the line being typed: text is printed above that line.
//!
//! `rustyline` prints messages above the line, and loses a message that it has not read by the end of the line. The
//! screen therefore keeps the text: the editor fetches it at each redraw, a message only triggers a redraw, and the
//! remaining text is printed at the end of the line.

use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rustyline::ExternalPrinter;

/// The message that makes the editor redraw its line. The editor appends a newline to each message; the escape sequence
/// first moves the cursor up, so that no empty line appears.
const REDRAW: &str = "\x1b[A\n";

/// The maximum wait for an editor that is about to change the terminal modes.
const DRAW_TIMEOUT: Duration = Duration::from_secs(1);

/// The printer whose message makes the line editor redraw its line.
type Redraw = Box<dyn ExternalPrinter + Send>;

/// The terminal, shared by clones. Text is shown at each flush.
#[derive(Clone, Default)]
pub(super) struct Screen {
    shared: Arc<Shared>,
    text: Vec<u8>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    /// The printer of the current editor, if any; locked until the editor has taken the message.
    redraw: Mutex<Option<Redraw>>,
}

#[derive(Default)]
struct State {
    line: Line,
    /// The text for the editor to print above the line being typed.
    waiting: String,
}

/// The state of the line being typed.
#[derive(Clone, Copy, Default, PartialEq)]
enum Line {
    /// No line: text is written to the terminal.
    #[default]
    None,
    /// The editor is about to draw the line.
    Begun,
    /// The editor has drawn the line.
    Drawn,
    /// The run is over: no further line begins.
    Over,
}

impl Screen {
    /// Registers the editor that redraws the line.
    pub(super) fn attach(&self, redraw: Redraw) {
        *self.shared.redraw.lock().unwrap_or_else(PoisonError::into_inner) = Some(redraw);
    }

    /// Hands the terminal to the editor. Returns `false` if the run is over; the editor must not begin a line then.
    pub(super) fn begin_line(&self) -> bool {
        let mut state = self.state();
        if state.line != Line::Over {
            state.line = Line::Begun;
        }
        state.line != Line::Over
    }

    /// Takes the pending text, which the editor prints above the line that it is drawing.
    pub(super) fn draw(&self) -> String {
        let mut state = self.state();
        if state.line == Line::Begun {
            state.line = Line::Drawn;
        }
        self.shared.changed.notify_all();
        std::mem::take(&mut state.waiting)
    }

    /// Takes the terminal back from the editor.
    pub(super) fn end_line(&self) {
        let mut state = self.state();
        // The printer notices a closed terminal with its next text.
        let _ = print(state.waiting.as_bytes());
        state.waiting.clear();
        if state.line != Line::Over {
            state.line = Line::None;
        }
        self.shared.changed.notify_all();
    }

    /// Prevents further lines, after waiting at most [`DRAW_TIMEOUT`] for an editor that is about to draw its line.
    /// Returns whether a line is being typed, in which case the editor has changed the terminal modes.
    pub(super) fn close(&self) -> bool {
        let state = self.state();
        let is_begun = |state: &mut State| state.line == Line::Begun;
        let waited = self.shared.changed.wait_timeout_while(state, DRAW_TIMEOUT, is_begun);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut state.line, Line::Over) != Line::None
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Screen {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.text.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    /// Prints the text. While a line is being typed, waits until the editor has printed the text or the line has ended.
    fn flush(&mut self) -> io::Result<()> {
        let text = std::mem::take(&mut self.text);
        let mut state = self.state();
        if matches!(state.line, Line::None | Line::Over) {
            return print(&text);
        }
        state.waiting.push_str(&String::from_utf8_lossy(&text));
        drop(state);
        // Without the lock: the editor may be drawing.
        if let Some(redraw) = &mut *self.shared.redraw.lock().unwrap_or_else(PoisonError::into_inner) {
            // An editor at the end of its line prints the text then.
            let _ = redraw.print(REDRAW.to_owned());
        }
        let is_waiting = |state: &mut State| !state.waiting.is_empty();
        drop(self.shared.changed.wait_while(self.state(), is_waiting));
        Ok(())
    }
}

/// Writes to the terminal.
pub(super) fn print(text: &[u8]) -> io::Result<()> {
    let mut terminal = io::stdout();
    terminal.write_all(text)?;
    terminal.flush()
}
