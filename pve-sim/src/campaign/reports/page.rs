//! Results as one self-contained HTML page. The folder `report/` has the layout, style and script.

use std::borrow::Cow;
use std::io::{self, Write};

use serde::Serialize;

use hal_sim::campaign::Verdict;

use crate::campaign::manifest::Manifest;
use crate::campaign::results::{Cell, Row};

/// The template of the page, with the placeholders `STYLE`, `DATA` and `SCRIPT`.
const PAGE: &str = include_str!("../../../report/page.html");
const STYLE: &str = include_str!("../../../report/page.css");
const SCRIPT: &str = include_str!("../../../report/page.js");

/// The space for all traces together, in bytes. This limit keeps a page of 10,000 cells below 1 MB.
const TRACES: usize = 200_000;

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
    trace: Cow<'a, str>,
}

/// The letter for each verdict in the data of the page, from the best to the worst.
const LETTERS: [char; Verdict::ALL.len()] = ['n', 's', 'l', 'd', 'u', 'x', 'h', 'i'];

fn letter(verdict: Verdict) -> char {
    LETTERS[verdict as usize]
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

pub(super) fn write(out: &mut dyn Write, manifest: &Manifest, rows: &mut dyn Iterator<Item = Row>) -> io::Result<()> {
    let (before, after) = PAGE.split_once("DATA").unwrap_or_default();
    write!(out, "{}", before.replacen("STYLE", STYLE.trim_end(), 1))?;
    let (head, limits) = (embedded(manifest)?, embedded(&manifest.limits)?);
    write!(out, "{{\"manifest\":{head},\"limits\":{limits},\"rows\":[")?;
    for (place, row) in rows.enumerate() {
        let comma = if place > 0 { "," } else { "" };
        write!(out, "{comma}\n{}", embedded(&data(&row, TRACES / manifest.rows.max(1)))?)?;
    }
    write!(out, "]}}{}", after.replacen("SCRIPT", SCRIPT.trim_end(), 1))
}

/// Returns the data of a row, with at most `space` bytes of its trace.
fn data(row: &Row, space: usize) -> Data<'_> {
    let (grid, refined): (Vec<&Cell>, Vec<&Cell>) = row.cells.iter().partition(|cell| cell.number.is_some());
    let instants: Vec<u64> = grid.iter().map(|cell| cell.at_us).collect();
    let distance = |pair: &[u64]| pair[1].abs_diff(pair[0]);
    let step = instants.get(..2).map_or(0, distance);
    let is_even = instants.is_sorted() && instants.windows(2).all(|pair| distance(pair) == step);
    Data {
        row: row.row,
        fault: &row.fault,
        reference: row.reference.as_deref(),
        seed: row.seed,
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
        worst_us: row.worst().at_us,
        worst_number: row.worst().number,
        trace: beginning(&row.trace, space),
    }
}
