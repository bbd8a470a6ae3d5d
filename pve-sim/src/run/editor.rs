//! The console's line editor on a terminal, with history and completion. It keeps the input line below the trace
//! output.

use std::borrow::Cow;
use std::io::{self, IsTerminal as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::DefaultHistory;
use rustyline::validate::Validator;
use rustyline::{
    Cmd, ColorMode, CompletionType, ConditionalEventHandler, Config, Context, Event, EventContext, EventHandler,
    Helper, KeyCode, KeyEvent, Modifiers, RepeatCount,
};
use tokio_util::sync::CancellationToken;

use super::screen::{self, Screen};
use super::stdin::{self, Lines};
use super::{console, system};
use crate::inbox::WorldSender;
use hal_sim::devices::NamedDevice;

const PROMPT: &str = "> ";

/// The time limit for the bytes of one key, in milliseconds.
const KEY_MS: u16 = 100;

/// The line editor on the terminal of the run. Dropping it restores the terminal.
pub(super) struct Typing {
    screen: Screen,
    modes: Modes,
}

/// The terminal modes to restore when no editor is active.
type Modes = Arc<Mutex<system::Modes>>;

impl Typing {
    /// Creates the editor; `None` unless stdin, stdout and stderr are the same terminal, of a supported kind.
    pub(super) fn new() -> Option<Self> {
        let are_terminals = io::stdin().is_terminal() && io::stdout().is_terminal() && io::stderr().is_terminal();
        let modes = system::Modes::of_the_terminal().filter(|_| are_terminals)?;
        let screen = Screen::default();
        Editor::new(&screen, &Arc::default(), &[])?;
        Some(Self { screen, modes: Arc::new(Mutex::new(modes)) })
    }

    /// Returns the screen, which prints text above the line.
    pub(super) fn screen(&self) -> Screen {
        self.screen.clone()
    }

    /// Starts the thread that reads lines; Ctrl-C in the editor ends the run. The thread is never joined.
    pub(super) fn listen(&self, world: WorldSender, devices: &[NamedDevice], stop: CancellationToken) {
        let (screen, modes, devices) = (self.screen.clone(), Arc::clone(&self.modes), Arc::from(devices));
        let _ = std::thread::Builder::new().name("stdin".to_owned()).spawn(move || {
            let typed = edit(&screen, &modes, &world, &devices);
            restore(&modes);
            if typed == Typed::Interrupt {
                // Interrupts all processes of the job, as the terminal would.
                system::interrupt();
            }
            if matches!(typed, Typed::Interrupt | Typed::Signal) {
                stop.cancel();
            }
        });
    }
}

impl Drop for Typing {
    fn drop(&mut self) {
        let has_line = self.screen.close();
        restore(&self.modes);
        if has_line {
            // Moves the cursor off the line being typed.
            let _ = screen::print(b"\n");
        }
    }
}

fn restore(modes: &Modes) {
    modes.lock().unwrap_or_else(PoisonError::into_inner).restore();
}

/// Executes lines until typing ends; returns the reason.
fn edit(screen: &Screen, modes: &Modes, world: &WorldSender, devices: &Arc<[NamedDevice]>) -> Typed {
    let (mut lines, mut history) = (Lines::default(), Vec::new());
    loop {
        // A background job must not touch its terminal. After each return to the foreground a new editor is created,
        // because the screen may wait until the old editor is dropped.
        system::wait_for_foreground();
        if let Some(found) = system::Modes::of_the_terminal() {
            found.without_suspend_key();
            *modes.lock().unwrap_or_else(PoisonError::into_inner) = found;
        }
        let Some(mut editor) = Editor::new(screen, devices, &history) else { return Typed::End };
        let typed = loop {
            match editor.line(screen) {
                Typed::Line(line) => lines.push(format!("{line}\n").as_bytes(), |line| stdin::tell(world, line)),
                Typed::Garbage => {}
                other => break other,
            }
        };
        if typed != Typed::Suspend {
            return typed;
        }
        history = editor.editor.history().into_iter().cloned().collect();
        drop(editor);
        restore(modes);
        system::suspend();
    }
}

/// The result of reading a line.
#[derive(Debug, PartialEq)]
enum Typed {
    /// A line, without its end.
    Line(String),
    /// Bytes that are not UTF-8.
    Garbage,
    /// Ctrl-Z.
    Suspend,
    /// Ctrl-C.
    Interrupt,
    /// SIGINT, which the editor intercepts.
    Signal,
    /// Ctrl-D, or the loss of the terminal.
    End,
}

struct Editor {
    editor: rustyline::Editor<Assistant, DefaultHistory>,
    key: Key,
}

impl Editor {
    /// Returns an editor; `None` on a terminal that cannot display it.
    fn new(screen: &Screen, devices: &Arc<[NamedDevice]>, history: &[String]) -> Option<Self> {
        let config = Config::builder()
            .auto_add_history(true)
            // A list of candidates would wait for keys between its pages, and block the trace.
            .completion_type(CompletionType::Circular)
            .bracketed_paste(false)
            .keyseq_timeout(Some(KEY_MS))
            // With colours, the editor calls `highlight_prompt` at each redraw, which adds the trace.
            .color_mode(ColorMode::Forced)
            .build();
        let mut editor = rustyline::Editor::with_config(config).ok()?;
        screen.attach(Box::new(editor.create_external_printer().ok()?));
        editor.set_helper(Some(Assistant { screen: screen.clone(), devices: Arc::clone(devices) }));
        for line in history {
            editor.add_history_entry(line.as_str()).ok()?;
        }
        let key = Key::default();
        let leaving = if system::HAS_JOBS { &[INTERRUPT, SUSPEND][..] } else { &[INTERRUPT] };
        for leaves in leaving {
            editor.bind_sequence(*leaves, EventHandler::Conditional(Box::new(Leave(Arc::clone(&key)))));
        }
        editor.bind_sequence(Event::Any, EventHandler::Conditional(Box::new(Keys::of(devices))));
        // A search, or a key that waits for another one, would block the trace.
        for waits in ['R', 'S', 'V', 'Q', 'X', ']'] {
            editor.bind_sequence(KeyEvent::ctrl(waits), Cmd::Noop);
        }
        for digit in ('0'..='9').chain(['-']) {
            editor.bind_sequence(KeyEvent::alt(digit), Cmd::Noop);
        }
        Some(Self { editor, key })
    }

    fn line(&mut self, screen: &Screen) -> Typed {
        // Another process may have stopped the job between two lines.
        system::wait_for_foreground();
        if !screen.begin_line() {
            return Typed::End;
        }
        let line = self.editor.readline(PROMPT);
        screen.end_line();
        let key = self.key.lock().unwrap_or_else(PoisonError::into_inner).take();
        match (line, key) {
            (Ok(line), _) => Typed::Line(line),
            (Err(ReadlineError::Interrupted), Some(SUSPEND)) => Typed::Suspend,
            (Err(ReadlineError::Interrupted), Some(_)) => Typed::Interrupt,
            (Err(ReadlineError::Interrupted), None) => Typed::Signal,
            (Err(ReadlineError::Io(error)), _) if error.kind() == io::ErrorKind::InvalidData => Typed::Garbage,
            (Err(_), _) => Typed::End,
        }
    }
}

const INTERRUPT: KeyEvent = KeyEvent(KeyCode::Char('C'), Modifiers::CTRL);
const SUSPEND: KeyEvent = KeyEvent(KeyCode::Char('Z'), Modifiers::CTRL);

/// The key that ended a line.
type Key = Arc<Mutex<Option<KeyEvent>>>;

/// The key handler that ends the line and records the key.
struct Leave(Key);

impl ConditionalEventHandler for Leave {
    fn handle(&self, event: &Event, _: RepeatCount, _: bool, _: &EventContext<'_>) -> Option<Cmd> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = event.get(0).copied();
        Some(Cmd::Interrupt)
    }
}

/// The handler of the keys without a handler of their own.
struct Keys {
    devices: Arc<[NamedDevice]>,
    /// True while each Tab shows the next of several candidates.
    is_cycling: AtomicBool,
}

impl Keys {
    fn of(devices: &Arc<[NamedDevice]>) -> Self {
        Self { devices: Arc::clone(devices), is_cycling: AtomicBool::new(false) }
    }
}

impl ConditionalEventHandler for Keys {
    fn handle(&self, event: &Event, _: RepeatCount, _: bool, context: &EventContext<'_>) -> Option<Cmd> {
        let was_cycling = self.is_cycling.swap(false, Ordering::Relaxed);
        match event.get(0)? {
            KeyEvent(KeyCode::Tab, Modifiers::NONE) => {
                let (start, candidates) = completions(context.line(), context.pos(), &self.devices);
                match candidates.as_slice() {
                    // The editor would take back a single candidate at the second Tab.
                    [only] if !was_cycling => Some(Cmd::Insert(1, only[context.pos() - start..].to_owned())),
                    candidates => {
                        self.is_cycling.store(was_cycling || candidates.len() > 1, Ordering::Relaxed);
                        None
                    }
                }
            }
            // The editor draws the whole line again for each character. A line of this length is refused.
            KeyEvent(KeyCode::Char(_), Modifiers::NONE) if context.line().len() > stdin::LINE => Some(Cmd::Noop),
            _ => None,
        }
    }
}

/// The helper of the editor: completes words, and prints the trace at each redraw.
struct Assistant {
    screen: Screen,
    devices: Arc<[NamedDevice]>,
}

impl Completer for Assistant {
    type Candidate = String;

    fn complete(&self, line: &str, end: usize, _: &Context<'_>) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(completions(line, end, &self.devices))
    }
}

/// Returns the beginning of the word that ends at `end`, and the words that it may become.
fn completions(line: &str, end: usize, devices: &[NamedDevice]) -> (usize, Vec<String>) {
    let typed = &line[..end];
    let start = typed.rfind(|c: char| c.is_ascii_whitespace()).map_or(0, |blank| blank + 1);
    let (before, begun) = typed.split_at(start);
    let before: Vec<&str> = before.split_ascii_whitespace().collect();
    let mut candidates = console::candidates(&before, devices);
    candidates.retain(|word| word.starts_with(begun));
    (start, candidates.into_iter().map(|word| word + " ").collect())
}

impl Highlighter for Assistant {
    /// Returns the prompt, preceded by the pending text of the screen.
    fn highlight_prompt<'b, 's: 'b, 'p: 'b>(&'s self, prompt: &'p str, _: bool) -> Cow<'b, str> {
        Cow::Owned(self.screen.draw() + prompt)
    }
}

impl Hinter for Assistant {
    type Hint = String;
}

impl Validator for Assistant {}

impl Helper for Assistant {}
