//! The human-readable trace: aligned columns, arrows, colours, and counts in place of repeated cyclic frames.
//!
//! ```text
//!    300.768 ms  ->  220: 0F 00 00 20               master → pvea-canopen: RPDO …   sent by a client
//!    301.424 ms  <-  1A0: 0F 00 99 19               pvea-canopen: TPDO …            sent by a device
//!                    220: 0F 00 00 20               12 more times, every 100 ms
//! ```

use std::collections::HashMap;
use std::fmt::Write;
use std::sync::Arc;

use anstyle::{AnsiColor, Style};
use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, since};

use crate::explain::{Mark, is_cyclic};
use crate::log::write_hex;

/// The pause after which an unchanged frame is printed again.
const CYCLE: Duration = Duration::from_secs(2);

/// The maximum time between two reports of repeated frames.
const REMINDER: Duration = Duration::from_secs(5);

/// The delay, in addition to the period, after which the cycle of a frame counts as ended.
const LATE: Duration = Duration::from_millis(20);

/// The time, in milliseconds, from which times are printed as h:mm:ss.mmm.
const MINUTE: u64 = 60_000;

/// The width of the columns before the frame: time, unit, arrow.
const MARGIN: usize = 19;

/// The number of terminal columns from which data bytes are separated by blanks.
const ROOMY: usize = 100;

/// The minimum width of a wrapped explanation.
const NARROWEST: usize = 20;

const TIME: Style = Style::new().dimmed();
const DEVICE: Style = AnsiColor::Cyan.on_default();
const CLIENT: Style = AnsiColor::Green.on_default();
const FAULT: Style = AnsiColor::Red.on_default();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();
const MINOR: Style = Style::new().dimmed();

/// The layout of a trace.
#[derive(Clone, Debug)]
pub struct Layout {
    color: bool,
    /// True if repeated frames are printed.
    verbose: bool,
    /// The number of terminal columns, if known.
    columns: Option<usize>,
    /// True if space is reserved for 29-bit identifiers.
    extended: bool,
    /// The last printed frame for each sender and identifier.
    latest: HashMap<(Arc<str>, Id), Latest>,
}

/// A printed frame and its repetitions.
#[derive(Clone, Debug)]
struct Latest {
    frame: Frame,
    /// The time of the last repetition.
    at: Instant,
    /// The number of unreported repetitions; `told` is the time of the frame before the first of these repetitions.
    again: u32,
    told: Instant,
}

impl Layout {
    /// Creates a layout. `color` enables colours; `verbose` prints every frame instead of counting repetitions.
    #[must_use]
    pub fn new(color: bool, verbose: bool) -> Self {
        Self { color, verbose, columns: None, extended: false, latest: HashMap::new() }
    }

    /// Sets the number of terminal columns; `None` disables wrapping.
    pub fn fit(&mut self, columns: Option<usize>) {
        self.columns = columns;
    }

    /// Reserves space for 29-bit identifiers from the first line.
    pub fn expect_extended(&mut self) {
        self.extended = true;
    }

    /// Writes a frame, or counts it as a repetition. `from_device` selects the arrow of a device.
    pub fn frame(
        &mut self,
        out: &mut String,
        (at, who, frame): (Instant, &Arc<str>, &Frame),
        from_device: bool,
        meaning: impl FnOnce() -> (String, Mark),
    ) {
        if !self.verbose && self.repeats(out, at, who, frame) {
            return;
        }
        self.tell_ended(out, at);
        self.extended |= matches!(frame.id(), Id::Extended(_));
        let (text, mark) = meaning();
        let sender = if from_device { DEVICE } else { CLIENT };
        let style = match mark {
            Mark::Plain => Style::new(),
            Mark::Fault => FAULT,
            Mark::Impersonation => WARNING,
            Mark::Unknown => MINOR,
        };
        self.time(out, at);
        let arrow = if from_device { "<-" } else { "->" };
        self.styled(out, sender, &format!("{arrow}  {}  ", self.columns_of(frame)));
        self.text(out, style, self.after_frame(), &text);
    }

    /// Writes an error line.
    pub fn error(&mut self, out: &mut String, at: Instant, text: &str) {
        self.tell_ended(out, at);
        self.time(out, at);
        self.styled(out, FAULT, "!!  ");
        self.text(out, FAULT, MARGIN, text);
    }

    /// Reports all unreported repetitions.
    pub fn finish(&mut self, out: &mut String) {
        self.tell_repeats(out, |_| true);
    }

    /// Counts a frame that repeats the last printed frame of its sender and identifier. Returns whether the frame is
    /// such a repetition.
    fn repeats(&mut self, out: &mut String, at: Instant, who: &Arc<str>, frame: &Frame) -> bool {
        if !is_cyclic(frame) {
            return false;
        }
        let key = (Arc::clone(who), frame.id());
        if let Some(latest) = self.latest.get_mut(&key) {
            if latest.frame == *frame && since(at, latest.at) <= CYCLE {
                latest.at = at;
                latest.again += 1;
                if since(at, latest.told) >= REMINDER {
                    self.tell_repeats(out, |(other, _)| *other == key);
                }
                return true;
            }
            self.tell_repeats(out, |(other, _)| *other == key);
        }
        self.latest.insert(key, Latest { frame: *frame, at, again: 0, told: at });
        false
    }

    /// Reports the repetitions of cycles that have ended.
    fn tell_ended(&mut self, out: &mut String, now: Instant) {
        self.tell_repeats(out, |(_, latest)| since(now, latest.at).as_micros() > latest.period_us() + LATE.as_micros());
    }

    fn tell_repeats(&mut self, out: &mut String, which: impl Fn((&(Arc<str>, Id), &Latest)) -> bool) {
        let mut told: Vec<(Instant, Frame, String)> = Vec::new();
        for (key, latest) in &mut self.latest {
            if latest.again > 0 && which((key, latest)) {
                let times =
                    if latest.again == 1 { "once more".to_owned() } else { format!("{} more times", latest.again) };
                let period = (latest.period_us() + 500) / 1000;
                told.push((latest.at, latest.frame, format!("{times}, every {period} ms")));
                (latest.again, latest.told) = (0, latest.at);
            }
        }
        // The iteration order of the map is random.
        told.sort_by_key(|(at, frame, _)| (*at, frame.arbitration()));
        for (_, frame, text) in told {
            let blank = " ".repeat(MARGIN);
            self.styled(out, MINOR, &format!("{blank}{}  ", self.columns_of(&frame)));
            self.text(out, MINOR, self.after_frame(), &text);
        }
    }

    fn time(&self, out: &mut String, at: Instant) {
        let micros = since(at, Instant::from_ticks(0)).as_micros();
        let (millis, micros) = (micros / 1000, micros % 1000);
        let text = if millis < MINUTE {
            format!("{millis:>6}.{micros:03} ms")
        } else {
            let (seconds, millis) = (millis / 1000, millis % 1000);
            let clock = format!("{}:{:02}:{:02}.{millis:03}", seconds / 3600, seconds / 60 % 60, seconds % 60);
            format!("{clock:>13}")
        };
        self.styled(out, TIME, &text);
        out.push_str("  ");
    }

    /// Formats a frame, padded to the width of the widest frame.
    fn columns_of(&self, frame: &Frame) -> String {
        let mut text = frame.to_string();
        if !self.is_roomy() && !frame.is_remote() {
            text.truncate(text.find(':').map_or(text.len(), |colon| colon + 1));
            text.push(' ');
            write_hex(&mut text, frame.data());
        }
        format!("{text:<width$}", width = self.frame_width())
    }

    /// Returns the width of an eight-byte frame: identifier, colon, blank, bytes.
    fn frame_width(&self) -> usize {
        let bytes = if self.is_roomy() { 23 } else { 16 };
        let id = if self.extended { 8 } else { 3 };
        id + 2 + bytes
    }

    fn is_roomy(&self) -> bool {
        self.columns.is_none_or(|columns| columns >= ROOMY)
    }

    /// Returns the column behind a frame.
    fn after_frame(&self) -> usize {
        MARGIN + self.frame_width() + 2
    }

    /// Writes a text from column `indent` to the end of the line, and wraps a text that is too long.
    fn text(&self, out: &mut String, style: Style, indent: usize, text: &str) {
        let width = self.columns.map_or(usize::MAX, |columns| columns.saturating_sub(indent).max(NARROWEST));
        for (number, line) in broken(text, width).into_iter().enumerate() {
            if number > 0 {
                let _ = write!(out, "\n{:indent$}", "");
            }
            self.styled(out, style, &line);
        }
        out.push('\n');
    }

    fn styled(&self, out: &mut String, style: Style, text: &str) {
        // Writing to a string cannot fail.
        let _ = if self.color { write!(out, "{style}{text}{style:#}") } else { write!(out, "{text}") };
    }
}

impl Latest {
    /// Returns the mean interval between the unreported repetitions, in microseconds.
    fn period_us(&self) -> u64 {
        since(self.at, self.told).as_micros() / u64::from(self.again.max(1))
    }
}

/// Splits a text between words into lines of up to `width` characters.
fn broken(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
#[path = "layout_tests.rs"]
mod tests;
