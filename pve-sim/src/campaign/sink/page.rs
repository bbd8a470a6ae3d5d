//! Results as one self-contained HTML page. The folder `report/` has the layout, style and script.

use std::borrow::Cow;
use std::io::{self, Write};

use serde::Serialize;

use hal_sim::campaign::Verdict;

use super::Sink;
use crate::campaign::manifest::Manifest;
use crate::campaign::results::{Cell, Row};

/// The template of the page, with the placeholders `STYLE`, `DATA` and `SCRIPT`.
const PAGE: &str = include_str!("../../../report/page.html");
const STYLE: &str = include_str!("../../../report/page.css");
const SCRIPT: &str = include_str!("../../../report/page.js");

/// The space for all traces together, in bytes. This limit keeps a page of 10,000 cells below 1 MB.
const TRACES: usize = 200_000;

pub(super) struct Page<W> {
    out: W,
    is_first: bool,
    /// The space for each trace, in bytes.
    trace: usize,
}

/// A row in the data of the page. Times are in microseconds.
#[derive(Serialize)]
struct Data<'a> {
    row: usize,
    fault: &'a str,
    reference: Option<&'a str>,
    seed: u64,
    /// The number of the first cell of the grid.
    first: u64,
    /// The first instant of an even grid, the step, and the number of instants; `None` for an uneven grid.
    grid: Option<(u64, u64, usize)>,
    /// The instants of an uneven grid; empty for an even grid.
    at: Vec<u64>,
    /// The letters of the verdicts of the grid cells.
    verdicts: String,
    detected: Vec<Option<u64>>,
    safe: Vec<Option<u64>>,
    /// The cells of the refinement: instant, letter of the verdict, detection time, and time to the safe state.
    refined: Vec<(u64, char, Option<u64>, Option<u64>)>,
    worst_us: u64,
    worst_number: Option<u64>,
    trace: &'a str,
}

/// Returns the letter for a verdict in the data of the page.
const fn letter(verdict: Verdict) -> char {
    match verdict {
        Verdict::NoEffect => 'n',
        Verdict::Safe => 's',
        Verdict::Late => 'l',
        Verdict::SafeUndetected => 'd',
        Verdict::NotSafe => 'u',
        Verdict::Undetected => 'x',
        Verdict::Hung => 'h',
        Verdict::NotInjected => 'i',
    }
}

/// Returns JSON without `<`, so that the JSON cannot end the script element around it.
fn embedded(value: &impl Serialize) -> io::Result<String> {
    Ok(serde_json::to_string(value)?.replace('<', "\\u003c"))
}

/// Returns the first lines of a trace that fit, and a note with the number of omitted lines, if any.
fn beginning(trace: &str, space: usize) -> Cow<'_, str> {
    if trace.len() <= space {
        return trace.into();
    }
    let end = trace[..trace.floor_char_boundary(space)].rfind('\n').unwrap_or(0);
    let (shown, hidden) = trace.split_at(end);
    format!("{shown}\n… {} more lines; the command prints them", hidden.trim().lines().count()).into()
}

impl<W: Write> Page<W> {
    pub(super) fn new(mut out: W, manifest: &Manifest) -> io::Result<Self> {
        let (before, _) = PAGE.split_once("DATA").unwrap_or_default();
        write!(out, "{}", before.replacen("STYLE", STYLE.trim_end(), 1))?;
        let (head, limits) = (embedded(manifest)?, embedded(&manifest.limits)?);
        write!(out, "{{\"manifest\":{head},\"limits\":{limits},\"rows\":[")?;
        Ok(Self { out, is_first: true, trace: TRACES / manifest.rows.max(1) })
    }
}

impl<W: Write> Sink for Page<W> {
    fn row(&mut self, row: &Row) -> io::Result<()> {
        let (grid, refined): (Vec<&Cell>, Vec<&Cell>) = row.cells.iter().partition(|cell| cell.number.is_some());
        let instants: Vec<u64> = grid.iter().map(|cell| cell.at_us).collect();
        let distance = |pair: &[u64]| pair[1].abs_diff(pair[0]);
        let step = instants.get(..2).map_or(0, distance);
        let is_even = instants.is_sorted() && instants.windows(2).all(|pair| distance(pair) == step);
        let data = Data {
            row: row.head.row,
            fault: &row.head.fault,
            reference: row.head.reference.as_deref(),
            seed: row.head.seed,
            first: grid.first().and_then(|cell| cell.number).unwrap_or(0),
            grid: is_even.then(|| (instants.first().copied().unwrap_or(0), step, instants.len())),
            at: if is_even { Vec::new() } else { instants },
            verdicts: grid.iter().map(|cell| letter(cell.verdict)).collect(),
            detected: grid.iter().map(|cell| cell.detected_us).collect(),
            safe: grid.iter().map(|cell| cell.safe_us).collect(),
            refined: refined
                .iter()
                .map(|cell| (cell.at_us, letter(cell.verdict), cell.detected_us, cell.safe_us))
                .collect(),
            worst_us: row.worst().map_or(0, |cell| cell.at_us),
            worst_number: row.worst().and_then(|cell| cell.number),
            trace: &beginning(&row.head.trace, self.trace),
        };
        let comma = if std::mem::take(&mut self.is_first) { "" } else { "," };
        write!(self.out, "{comma}\n{}", embedded(&data)?)
    }

    fn end(&mut self) -> io::Result<()> {
        let (_, after) = PAGE.split_once("DATA").unwrap_or_default();
        write!(self.out, "]}}{}", after.replacen("SCRIPT", SCRIPT.trim_end(), 1))?;
        self.out.flush()
    }
}
