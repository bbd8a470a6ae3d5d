//! The outcome of a scenario: each failure with the expectation, the observation, and the preceding frames.

use std::fmt::{self, Write as _};

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, since};
use serde_json::{Value, json};

use super::file::NONE;
use super::frames::Frames;
use super::step::{Step, Wanted};
use super::strict::Deviation;
use crate::simulation::{Command, Happened, Heard, History, Refusal};
use crate::state::{DeviceState, Pattern, StateCondition};
use crate::text::in_one_line;
use crate::trace::Layout;

/// The outcome of a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    pub(super) title: String,
    pub(super) steps: usize,
    /// The virtual time at the end.
    pub(super) end: Instant,
    pub(super) failures: Vec<Failure>,
    /// The trace of the bus with the notes of the steps; empty if no trace was requested.
    pub(super) trace: String,
}

/// A failure of a step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Failure {
    /// The line of the step.
    pub(super) line: usize,
    pub(super) note: Option<String>,
    /// The failed expectation, in one line.
    pub(super) headline: String,
    /// The lines that describe the expectation and the observation.
    pub(super) details: Vec<String>,
    /// The exclusive upper bound of the event numbers to show with the failure; `None` for no bound.
    pub(super) until: Option<u64>,
    pub(super) at: Instant,
    /// The trace lines of the last events before the failure.
    pub(super) excerpt: Vec<String>,
    /// True if a device is at a bit rate different from the bus. The bus errors then replace the excerpt.
    pub(super) is_not_heard: bool,
}

impl Outcome {
    /// Returns whether the scenario passed.
    #[must_use]
    pub const fn is_success(&self) -> bool {
        self.failures.is_empty()
    }

    /// Returns the step's line number for each failure.
    #[cfg(feature = "campaign")]
    pub(crate) fn lines(&self) -> impl Iterator<Item = usize> {
        self.failures.iter().map(|failure| failure.line)
    }

    /// Returns the trace of the bus with the notes of the steps; empty if the run was not traced.
    #[must_use]
    pub fn trace(&self) -> &str {
        &self.trace
    }

    /// Returns the headline of each failure. `file` is the name of the scenario file.
    pub fn headlines(&self, file: &str) -> impl Iterator<Item = String> {
        self.failures.iter().map(move |failure| format!("{file}:{}: {}", failure.line, failure.headline))
    }

    /// Returns the failure report in indented lines; empty if the scenario passed. `file` is the name of the scenario
    /// file.
    #[must_use]
    pub fn failures(&self, file: &str) -> String {
        let mut text = String::new();
        for (place, failure) in self.failures.iter().enumerate() {
            let is_first = self.failures.iter().take(place).all(|earlier| earlier.is_not_heard);
            failure.write(&mut text, file, is_first);
        }
        text
    }
}

/// The trace of a run, written while the scenario runs.
#[derive(Clone)]
pub(super) struct Trace {
    layout: Layout,
    text: String,
}

impl Default for Trace {
    fn default() -> Self {
        Self { layout: Layout::new(false, false), text: String::new() }
    }
}

impl Trace {
    pub(super) fn add(&mut self, happened: &Happened, history: &History) {
        happened.lay_out(&mut self.text, &mut self.layout, history.explainer());
    }

    pub(super) fn note(&mut self, note: &str) {
        self.layout.finish(&mut self.text);
        for line in note.lines() {
            let _ = writeln!(self.text, "-- {}", in_one_line(line));
        }
    }

    pub(super) fn finish(mut self) -> String {
        self.layout.finish(&mut self.text);
        self.text
    }
}

impl Failure {
    fn new(step: &Step, headline: String, details: Vec<String>) -> Self {
        Self { note: step.note.clone(), ..Self::in_line(step.line, headline, details) }
    }

    fn in_line(line: usize, headline: String, details: Vec<String>) -> Self {
        let (at, excerpt) = (Instant::from_ticks(0), Vec::new());
        Self { line, note: None, headline, details, until: None, at, excerpt, is_not_heard: false }
    }

    /// Creates the failure for a device at a bit rate different from the bus.
    pub(super) fn not_heard(line: usize, reason: String) -> Self {
        let accept = "if this is intended, declare the device as { device = \"…\", heard = false }".to_owned();
        Self { is_not_heard: true, ..Self::in_line(line, reason, vec![accept]) }
    }

    /// Replaces the excerpt of a bit rate failure with the bus errors.
    pub(super) fn show_errors(&mut self, errors: &[String]) {
        if self.is_not_heard {
            self.excerpt = errors.to_vec();
        }
    }

    /// Creates the failure for a step that begins late because the previous steps took too long.
    pub(super) fn late(step: &Step, begin: Instant) -> Self {
        let details = vec![format!("the previous steps were still running at {}", time(begin))];
        Self::new(step, format!("at_ms = {}", begin.as_millis()), details)
    }

    /// Creates the failure for a step whose command was refused.
    pub(super) fn refused(step: &Step, (key, command): &(&str, Command), refusal: &Refusal) -> Self {
        let what = match command {
            Command::Send(frame, _) => format!("{key} {frame}"),
            Command::Fault(fault) => format!("{key} {fault}"),
            _ => (*key).to_owned(),
        };
        Self::undone(step, &what, &refusal.to_string())
    }

    /// Creates the failure for a step that could not be executed or tested nothing. `what` names the step or its part.
    pub(super) fn undone(step: &Step, what: &str, reason: &str) -> Self {
        Self::new(step, what.to_owned(), vec![reason.to_owned()])
    }

    /// Creates the failure for missing frames. `from` is the number of the first event of the step.
    pub(super) fn frames(step: &Step, frames: &Frames<'_>, from: u64, history: &History) -> Self {
        let mut details = Vec::new();
        for (pattern, frame) in &frames.wanted {
            let label = if frame.is_some() { "received" } else { "expected" };
            details.push(format!("{label:<10}{pattern}{}", meaning(pattern, history)));
        }
        let missing = || frames.wanted.iter().filter(|(_, frame)| frame.is_none());
        if let Some((first, _)) = missing().next() {
            details.extend(seen(first, (from, frames.mark), history));
        }
        let wanted = match frames.wanted.as_slice() {
            [(pattern, _)] => pattern.to_string(),
            all => format!("{} frames ({} received)", all.len(), all.len() - missing().count()),
        };
        Self::new(step, format!("expect {wanted}{}", within(step)), details)
    }

    /// Adds the deviation from a strict scenario to a failure for missing frames.
    pub(super) fn because(mut self, deviation: &Deviation, history: &History) -> Self {
        // Omits a deviation whose frame is already listed as an observation.
        let is_told = |heard: &Heard| {
            let seen = format!("seen      {}  at {}", heard.frame, time(heard.at));
            self.details.iter().any(|line| line.starts_with(&seen))
        };
        if !matches!(deviation, Deviation::Unclaimed(heard) if is_told(heard)) {
            self.details.push(format!("strict    {}", deviation.reason(history)));
        }
        self
    }

    /// Creates the failure for a deviation from a strict scenario.
    pub(super) fn deviation(step: &Step, deviation: &Deviation, history: &History) -> Self {
        Self::new(step, "strict".to_owned(), vec![format!("strict    {}", deviation.reason(history))])
    }

    /// Creates the failure for an expected state that was not reached.
    pub(super) fn state(step: &Step, wanted: &Wanted, state: &DeviceState) -> Self {
        let differs = |(key, value): &(String, Value)| {
            let alone = serde_json::from_value::<StateCondition>(json!({ key: value }));
            alone.is_ok_and(|alone| !alone.holds(state))
        };
        let keys = wanted.condition.keys().into_iter().filter(differs);
        let text = |(key, value): (String, Value)| {
            format!("{key:<10}expected {}, seen {}", written(&value), seen_value(&key, state))
        };
        let mut details: Vec<String> = keys.map(text).collect();
        if details.is_empty() {
            details.push("each key had its expected value, but never all at the same time".to_owned());
        }
        Self::new(step, format!("expect state of {}{}", state.name, within(step)), details)
    }

    /// Creates the failure for a forbidden frame.
    pub(super) fn came(step: &Step, pattern: &Pattern, heard: &Heard, history: &History) -> Self {
        let Heard { number, at, frame } = heard;
        let details = vec![format!("seen      {frame}  at {}  {}", time(*at), history.explain(frame))];
        let failure = Self::new(step, format!("never {pattern}{}", during(step)), details);
        Self { until: Some(number + 1), ..failure }
    }

    /// Creates the failure for a forbidden state.
    pub(super) fn held(step: &Step, wanted: &Wanted, state: &DeviceState) -> Self {
        let seen = |(key, _): (String, Value)| format!("seen      {key} = {}", seen_value(&key, state));
        let details = wanted.condition.keys().into_iter().map(seen).collect();
        Self::new(step, format!("never state of {}{}", state.name, during(step)), details)
    }

    /// Writes the failure in indented lines; `file` is the name of the scenario file. The first failure shows the
    /// latest events before it; each later failure shows the events since the previous failure.
    fn write(&self, out: &mut String, file: &str, is_first: bool) {
        let Self { line, note, headline, details, at, excerpt, .. } = self;
        // Writing to a string cannot fail.
        let _ = writeln!(out, "  {file}:{line}: {headline}: failed at {}", time(*at));
        for line in note.iter().flat_map(|note| note.lines()) {
            let _ = writeln!(out, "    -- {}", in_one_line(line));
        }
        for line in details {
            let _ = writeln!(out, "    {line}");
        }
        let (nothing, since) = match is_first {
            _ if self.is_not_heard => ("no error frames on the bus", "bus errors:"),
            true => ("no bus traffic", "bus traffic before the failure:"),
            false => ("no bus traffic since the previous failure", "bus traffic since the previous failure:"),
        };
        let _ = writeln!(out, "    {}", if excerpt.is_empty() { nothing } else { since });
        for line in excerpt {
            let _ = writeln!(out, "    {line}");
        }
    }
}

impl Deviation {
    /// Describes the deviation in one line.
    fn reason(&self, history: &History) -> String {
        let came = |Heard { at, frame, .. }: &Heard| format!("{frame}  at {}  {}", time(*at), history.explain(frame));
        match self {
            Self::Unclaimed(heard) => format!("no step expects  {}", came(heard)),
            Self::Early(heard, pause) => format!("repeated after only {}  {}", span(*pause), came(heard)),
            Self::Missing { pattern, period, last } => {
                format!("not received since {}, expected every {} ms: {pattern}", time(*last), period.as_millis())
            }
        }
    }
}

/// Explains the frame that a pattern matches, if the pattern matches a single frame.
fn meaning(pattern: &Pattern, history: &History) -> String {
    pattern.frame().map_or_else(String::new, |frame| format!("  {}", history.explain(&frame)))
}

/// Describes the most similar frame among the events from `mark` onwards, and the last matching frame before the step.
/// `from` is the number of the first event of the step.
fn seen(wanted: &Pattern, (from, mark): (u64, u64), history: &History) -> Vec<String> {
    let mut lines = Vec::new();
    let distance = |frame: &Frame| wanted.differences(frame).map_or(usize::MAX, |bytes| bytes.len());
    let of_id = || history.heard_since(mark).filter(|heard| wanted.has_id_of(&heard.frame));
    match of_id().min_by_key(|heard| distance(&heard.frame)) {
        Some(Heard { at, frame, .. }) => {
            lines.push(format!("seen      {frame}  at {}  {}", time(at), history.explain(&frame)));
            if let Some(bytes) = wanted.differences(&frame) {
                lines.push(format!("          {}", carets(&frame, &bytes)));
            }
            lines.extend(wanted.difference_in_length(&frame).map(|length| format!("          {length}")));
            let more = of_id().count() - 1;
            if more > 0 {
                lines.push(format!("          and {more} more with that identifier"));
            }
        }
        None => {
            let others = history.heard_since(mark).count();
            let others = match others {
                0 => "no device frame".to_owned(),
                1 => "1 device frame, with another identifier".to_owned(),
                _ => format!("{others} device frames, with other identifiers"),
            };
            lines.push(format!("seen      {others}"));
        }
    }
    let earlier = history.heard_since(0).take_while(|heard| heard.number < from);
    if let Some(heard) = earlier.filter(|heard| wanted.matches(&heard.frame)).last() {
        lines.push(format!("          a matching frame was received before the step, at {}", time(heard.at)));
    }
    lines
}

/// Returns a line of carets that mark bytes in a printed frame.
fn carets(frame: &Frame, bytes: &[usize]) -> String {
    let head = frame.to_string().find(':').map_or(0, |colon| colon + 2);
    let mut line = " ".repeat(head);
    for place in 0..=bytes.last().copied().unwrap_or(0) {
        line.push_str(if bytes.contains(&place) { "^^ " } else { "   " });
    }
    line.trim_end().to_owned()
}

fn within(step: &Step) -> String {
    let Some(expect) = &step.expect else { return String::new() };
    format!("{} within {} ms", counted(expect.since), expect.within.as_millis())
}

fn during(step: &Step) -> String {
    let Some(never) = &step.never else { return String::new() };
    let span = never.span.map_or_else(String::new, |span| format!(" for {} ms", span.as_millis()));
    format!("{}{span}", counted(never.since))
}

fn counted(since: Option<Instant>) -> String {
    since.map_or_else(String::new, |since| format!(" since {} ms", since.as_millis()))
}

/// Formats the value of a state key in scenario syntax. Of the faults, only the active ones are shown.
fn seen_value(key: &str, state: &DeviceState) -> String {
    let active = state.faults.iter().filter(|fault| fault.active).map(|fault| fault.fault);
    written(&if key == "faults" { active.collect() } else { json!(state)[key].take() })
}

/// Formats a value in scenario syntax.
fn written(value: &Value) -> String {
    match value {
        Value::Null => NONE.to_owned(),
        Value::Array(items) => format!("[{}]", items.iter().map(written).collect::<Vec<_>>().join(", ")),
        Value::Object(members) => {
            let members = members.iter().map(|(key, value)| format!("{key} = {}", written(value)));
            format!("{{ {} }}", members.collect::<Vec<_>>().join(", "))
        }
        value => value.to_string(),
    }
}

/// Formats a time in milliseconds since the start.
pub(super) fn time(at: Instant) -> String {
    span(since(at, Instant::from_ticks(0)))
}

fn span(span: Duration) -> String {
    let micros = span.as_micros();
    format!("{}.{:03} ms", micros / 1000, micros % 1000)
}

/// Writes a one-line summary with counts and duration.
impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.title.is_empty() {
            write!(f, "{}; ", in_one_line(&self.title))?;
        }
        let steps = if self.steps == 1 { "step" } else { "steps" };
        write!(f, "{} {steps} in {}", self.steps, time(self.end))
    }
}
