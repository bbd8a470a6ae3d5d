//! The trace of a run, on stdout and in the log: there as `candump -L`, with what a frame means, and for people laid
//! out.

use std::collections::HashMap;
use std::io::IsTerminal as _;
use std::sync::Arc;

use anstream::AutoStream;
use protocol_core::device::Device;
use protocol_core::device::pve::Protocol;
use terminal_size::{Width, terminal_size};

use super::log::Log;
use super::options::ColorChoice;
use super::printer::Printer;
use hal_sim::explain::Explainer;
use hal_sim::log::candump::write_entry;
use hal_sim::log::{Entry, ErrorClass, Record, Timestamp};
use hal_sim::trace::Layout;
use hal_sim::world::{Event, EventKind, NodeId, World};

/// Lines are printed at the latest when they have so many bytes.
const BATCH: usize = 32 * 1024;

/// Returns the layout that stdout gets: none, unless it is a terminal or colour is asked for.
pub(super) fn layout(color: ColorChoice, verbose: bool) -> Option<Layout> {
    let stdout = std::io::stdout();
    let wished = match color {
        ColorChoice::Always => true,
        ColorChoice::Never => false,
        // Looks at NO_COLOR, CLICOLOR and TERM.
        ColorChoice::Auto => AutoStream::choice(&stdout) != anstream::ColorChoice::Never,
    };
    let people = stdout.is_terminal() || color == ColorChoice::Always;
    if people && wished {
        // Tells a console of Windows to obey escape sequences; elsewhere this does nothing.
        let _ = AutoStream::always_ansi(stdout);
    }
    people.then(|| {
        let mut layout = Layout::new(wished, verbose);
        layout.fit(terminal_size().map(|(Width(columns), _)| columns.into()));
        layout
    })
}

/// The trace of a run.
pub(super) struct Trace {
    /// The name of the bus.
    bus: String,
    explainer: Explainer,
    /// The place of each device in the explainer.
    places: HashMap<Arc<str>, (NodeId, usize)>,
    printer: Printer,
    log: Option<Log>,
    /// True when the log has ended before the run.
    log_is_cut: bool,
    /// The layout for people; `None`: lines as `candump -L` writes them.
    layout: Option<Layout>,
    /// The current line; the allocation is used again.
    line: String,
    /// Lines that are not printed yet.
    lines: String,
}

impl Trace {
    /// Returns a trace of the devices that the explainer knows, as `candump -L` or for people.
    pub(super) fn new(
        bus: &str,
        explainer: Explainer,
        printer: Printer,
        log: Option<Log>,
        layout: Option<Layout>,
    ) -> Self {
        Self {
            layout,
            bus: bus.to_owned(),
            explainer,
            places: HashMap::new(),
            printer,
            log,
            log_is_cut: false,
            line: String::new(),
            lines: String::new(),
        }
    }

    /// Returns what explains the frames, with the node IDs of now.
    pub(super) const fn explainer(&self) -> &Explainer {
        &self.explainer
    }

    /// Learns the present node IDs of all devices: those of the explainer, in the same order.
    pub(super) fn learn(&mut self, world: &World) {
        if let Some(layout) = &mut self.layout
            && self.explainer.nodes_mut().iter().any(|node| node.kind.protocol() == Protocol::Isobus)
        {
            layout.expect_extended();
        }
        for (place, id) in world.devices().enumerate() {
            self.places.insert(world.name(id).into(), (id, place));
            self.look_at(id, place, world);
        }
    }

    /// Writes the line of a frame, or of an error that is told.
    pub(super) fn tell(&mut self, event: &Event, at: Timestamp, error: Option<(ErrorClass, String)>, world: &World) {
        let entry = match (&event.what, &error) {
            (EventKind::Frame { frame, .. }, _) => Entry::Frame(*frame),
            (_, Some((class, _))) => Entry::Error((*class).into()),
            (_, None) => return,
        };
        self.line.clear();
        write_entry(&mut self.line, at, &self.bus, &entry);
        self.log(|log| log.write(&Record { at, entry }));
        // With the node IDs before the frame: the frame may change them.
        let from_device = self.places.contains_key(&event.who);
        match (&event.what, error, &mut self.layout) {
            (EventKind::Frame { frame, .. }, _, Some(layout)) => {
                let meaning = || self.explainer.explain_and_mark(frame, Some(&event.who));
                layout.frame(&mut self.lines, (event.at, &event.who, frame), from_device, meaning);
            }
            (EventKind::Frame { frame, .. }, _, None) => {
                self.plain(&self.explainer.explain(frame, Some(&event.who)));
            }
            (_, Some((_, text)), Some(layout)) => layout.error(&mut self.lines, event.at, &text),
            (_, Some((_, text)), None) => self.plain(&text),
            (_, None, _) => {}
        }
        if let EventKind::Frame { frame, .. } = &event.what {
            self.explainer.observe(frame);
        }
        if self.lines.len() >= BATCH {
            self.print();
        }
        // A device with a new node ID sends a frame of its own: boot-up, or a claim.
        if let Some((id, place)) = self.places.get(&event.who).copied() {
            self.look_at(id, place, world);
        }
    }

    /// Adds the line, with what it means.
    fn plain(&mut self, meaning: &str) {
        for part in [&self.line, "  ", meaning, "\n"] {
            self.lines.push_str(part);
        }
    }

    /// Hands all lines to their readers.
    pub(super) fn hand_out(&mut self) {
        if let Some(layout) = &mut self.layout {
            layout.fit(terminal_size().map(|(Width(columns), _)| columns.into()));
        }
        self.log(Log::flush);
        if !self.lines.is_empty() {
            self.print();
        }
    }

    /// Prints the answer to what the user typed.
    pub(super) fn answer(&self, text: String) {
        self.printer.note(text);
    }

    /// Prints a line for the user.
    pub(super) fn warn(&self, line: String) {
        self.printer.warn(line);
    }

    /// Hands all lines out, and waits until they are printed or nobody reads them. Returns whether stdout and the log
    /// took all; the user has been told why not.
    pub(super) fn finish(mut self) -> bool {
        if let Some(layout) = &mut self.layout {
            layout.finish(&mut self.lines);
        }
        self.hand_out();
        if let Some(Err(complaint)) = self.log.take().map(Log::finish) {
            self.printer.warn(complaint);
            self.log_is_cut = true;
        }
        self.printer.finish() && !self.log_is_cut
    }

    fn look_at(&mut self, id: NodeId, place: usize, world: &World) {
        if let Some(node) = self.explainer.nodes_mut().get_mut(place) {
            node.node_id = world.device(id).and_then(Device::node_id);
        }
    }

    fn print(&mut self) {
        let room = String::with_capacity(self.lines.len());
        self.printer.trace(std::mem::replace(&mut self.lines, room));
    }

    fn log(&mut self, act: impl FnOnce(&mut Log) -> Result<(), String>) {
        if let Some(log) = &mut self.log
            && let Err(complaint) = act(log)
        {
            self.printer.warn(complaint);
            self.log = None;
            self.log_is_cut = true;
        }
    }
}
