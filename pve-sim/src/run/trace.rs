//! The trace of a run on stdout and in the log: `candump -L` lines with meanings, or the human-readable layout.

use std::io::{self, IsTerminal as _};

use anstream::AutoStream;
use protocol_core::device::pve::Protocol;
use terminal_size::{Width, terminal_size};

use super::log::{Log, Output};
use super::options::ColorChoice;
use super::printer::Printer;
use hal_sim::explain::Explainer;
use hal_sim::log::candump::write_entry;
use hal_sim::log::{Entry, Record, Timestamp};
use hal_sim::simulation::{Happened, Simulation};
use hal_sim::trace::Layout;

/// The number of pending bytes at which the lines are printed.
const BATCH: usize = 32 * 1024;

/// Returns the layout of stdout; `None` unless stdout is a terminal or colour is always used.
pub(super) fn layout(color: ColorChoice, verbose: bool) -> Option<Layout> {
    let stdout = std::io::stdout();
    let wished = match color {
        ColorChoice::Always => true,
        ColorChoice::Never => false,
        // Respects NO_COLOR, CLICOLOR and TERM.
        ColorChoice::Auto => AutoStream::choice(&stdout) != anstream::ColorChoice::Never,
    };
    let people = stdout.is_terminal() || color == ColorChoice::Always;
    if people && wished {
        // Enables escape sequences on a Windows console; does nothing elsewhere.
        let _ = AutoStream::always_ansi(stdout);
    }
    people.then(|| {
        let mut layout = Layout::new(wished, verbose);
        layout.fit(terminal_size().map(|(Width(columns), _)| columns.into()));
        layout
    })
}

pub(super) struct Trace {
    bus: String,
    pub(super) printer: Printer,
    log: Option<Log>,
    /// Whether the log is incomplete because of a write error.
    log_is_cut: bool,
    /// The human-readable layout; `None` prints `candump -L` lines.
    layout: Option<Layout>,
    /// The buffer of the current line, reused to avoid allocations.
    line: String,
    /// The lines not printed yet.
    lines: String,
}

impl Trace {
    /// Creates a trace, in `candump -L` lines or in the human-readable layout.
    pub(super) fn new(bus: &str, printer: Printer, log: Option<Log>, layout: Option<Layout>) -> Self {
        Self { layout, bus: bus.to_owned(), printer, log, log_is_cut: false, line: String::new(), lines: String::new() }
    }

    /// Reserves space for 29-bit identifiers if a device is on ISOBUS.
    pub(super) fn fit(&mut self, simulation: &Simulation) {
        let is_isobus = simulation.devices().iter().any(|(_, kind)| kind.protocol() == Protocol::Isobus);
        if let Some(layout) = self.layout.as_mut().filter(|_| is_isobus) {
            layout.expect_extended();
        }
    }

    /// Writes a frame, a reported error, or the effect of a communication fault to the log, and adds its line to the
    /// pending lines of stdout.
    pub(super) fn tell(&mut self, happened: &Happened, at: Timestamp, explainer: &Explainer) {
        let Happened { event, error, .. } = happened;
        let entry = match (event.frame(), error) {
            (Some(frame), _) => Some(Entry::Frame(*frame)),
            (None, Some((class, _))) => class.map(|class| Entry::Error(class.into())),
            (None, None) => return,
        };
        self.line.clear();
        match (entry, error) {
            (Some(entry), _) => {
                write_entry(&mut self.line, at, &self.bus, &entry);
                self.log(|log| log.write(&Record { at, entry }));
            }
            (None, Some((_, text))) => {
                // As a comment, which readers of `candump -L` lines skip.
                self.line.push_str(&format!("# ({at})"));
                self.log(|log| log.comment(at, text));
            }
            (None, None) => {}
        }
        match (&mut self.layout, event.frame(), error) {
            (Some(layout), ..) => happened.lay_out(&mut self.lines, layout, explainer),
            (None, Some(frame), _) => self.plain(&explainer.explain(frame, Some(&event.who))),
            (None, None, Some((_, text))) => self.plain(text),
            (None, None, None) => {}
        }
        if self.lines.len() >= BATCH {
            self.print();
        }
    }

    /// Appends the current line and its meaning to the pending lines.
    fn plain(&mut self, meaning: &str) {
        for part in [&self.line, "  ", meaning, "\n"] {
            self.lines.push_str(part);
        }
    }

    pub(super) fn flush(&mut self) {
        if let Some(layout) = &mut self.layout {
            layout.fit(terminal_size().map(|(Width(columns), _)| columns.into()));
        }
        self.log(Output::flush);
        if !self.lines.is_empty() {
            self.print();
        }
    }

    /// Flushes all lines, and waits until they are printed or stdout is closed. Returns whether stdout and the log are
    /// complete; any failure was reported to the user.
    pub(super) fn finish(mut self) -> bool {
        if let Some(layout) = &mut self.layout {
            layout.finish(&mut self.lines);
        }
        self.flush();
        if let Some(Err(complaint)) = self.log.take().map(Log::finish) {
            self.printer.warn(complaint);
            self.log_is_cut = true;
        }
        self.printer.finish() && !self.log_is_cut
    }

    fn print(&mut self) {
        let room = String::with_capacity(self.lines.len());
        self.printer.trace(std::mem::replace(&mut self.lines, room));
    }

    fn log(&mut self, act: impl FnOnce(&mut Output) -> io::Result<()>) {
        if let Some(log) = &mut self.log
            && let Err(complaint) = log.write(act)
        {
            self.printer.warn(complaint);
            self.log = None;
            self.log_is_cut = true;
        }
    }
}
