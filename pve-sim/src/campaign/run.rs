//! Runs the rows of a plan, appends them to the results file, and reports them.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use hal_sim::campaign::{Campaign, Cell as Place, CellResult, Verdict};
use protocol_core::time::Instant;
use tokio::runtime::Builder;

use super::live::Live;
use super::manifest::Manifest;
use super::options::CampaignOptions;
use super::plan::{Prepared, prepare};
use super::process;
use super::progress::Progress;
use super::reports::report;
use super::results::{Cell, Reader, Row, Writer, worst};
use crate::cores::{Stopped, in_order, processors};
use crate::output::CommandError;
use crate::run::Signals;

/// The maximum number of lines of a trace in the results.
const TRACE: usize = 200;
/// The maximum number of lines of a trace before the fault.
const BEFORE: usize = 6;
/// The beginning of the note that marks the fault in a trace.
const FAULT: &str = "-- fault: ";

/// Runs a campaign, and writes its summary to `out`. Returns whether each cell passed. Errors of `out` are ignored.
///
/// # Errors
/// [`CommandError`]
pub(super) fn run_campaign(
    plan: &Path,
    results: &Path,
    options: &CampaignOptions,
    out: &mut dyn Write,
) -> Result<bool, CommandError> {
    let Prepared { campaign, manifest, live, .. } = prepare(plan, options.seed, !options.no_fork)?;
    let manifest = Manifest { shard: options.shard, ..manifest };
    // The file stays locked until it has been read for the report.
    let (mut writer, done) = match options.resume {
        true => Writer::resume(results, &manifest)?,
        false => (Writer::create(results, &manifest)?, BTreeSet::new()),
    };
    let is_own = |row: &usize| options.shard.is_none_or(|shard| shard.has(*row)) && !done.contains(row);
    let rows: Vec<usize> = (0..manifest.rows).filter(is_own).collect();
    let jobs = options.jobs.map_or_else(processors, usize::from);
    let kept = format!("the complete rows are in {}", results.display());
    run_rows(campaign, live, rows, jobs, &mut writer).map_err(|stopped| match stopped {
        Stopped::Failed(error) => error,
        Stopped::Interrupted => {
            CommandError::Failed(format!("interrupted; {kept}; the same command with --resume continues"))
        }
        Stopped::Panicked => CommandError::Failed(format!("defect of pve-sim: a row panicked; {kept}")),
    })?;
    report(&manifest, &options.reports, || Reader::open(results), out)
}

/// Runs rows on several threads, and appends them to the results file in order.
fn run_rows(
    campaign: Campaign<'static>,
    live: Option<Live>,
    rows: Vec<usize>,
    jobs: usize,
    writer: &mut Writer,
) -> Result<(), Stopped<CommandError>> {
    let cells = Arc::new(AtomicU64::new(0));
    let mut progress = Progress::new(rows.len());
    let work = {
        let cells = cells.clone();
        move |row| match &live {
            Some(live) => run_row_live(&campaign, live, row, &cells),
            None => Ok(run_row(&campaign, row, &cells)),
        }
    };
    let done = std::cell::Cell::new(0);
    let take = |row: io::Result<Row>| {
        let row = row.map_err(|error| CommandError::Failed(error.to_string()))?;
        done.update(|done| done + 1);
        writer.append(&row)
    };
    let ended = in_order(rows, jobs, work, &interruption(), take, || progress.tell(&cells, done.get()));
    progress.end();
    if ended.is_err() {
        process::end_all();
    }
    ended
}

fn run_row(campaign: &Campaign<'_>, row: usize, count: &AtomicU64) -> Row {
    let mut cells: Vec<Cell> = Vec::new();
    let mut each = |result: CellResult| {
        cells.push(Cell::of(&result));
        count.fetch_add(1, Ordering::Relaxed);
    };
    campaign.row(row, &mut each);
    let worst = worst(&cells).map(|place| &cells[place]).filter(|cell| cell.verdict != Verdict::NoEffect);
    let trace = worst.and_then(|cell| campaign.trace(Place { row, at: Instant::from_micros(cell.at_us) }));
    let trace = trace.map_or_else(String::new, |trace| shortened(&trace));
    of_row(campaign, row, cells, trace)
}

/// Runs the grid cells of a row with a program as the controller.
fn run_row_live(campaign: &Campaign<'_>, live: &Live, row: usize, count: &AtomicU64) -> io::Result<Row> {
    let (first, length) = campaign.rows().get(row).map_or((0, 0), |row| (row.first, row.cells));
    let (mut cells, mut worst_trace): (Vec<Cell>, String) = (Vec::new(), String::new());
    for number in first..first + length {
        let at_us = campaign.numbered(number).map_or(0, |cell| cell.at.as_micros());
        let (cell, trace) = live.run(number, at_us)?;
        cells.push(cell);
        if worst(&cells) == Some(cells.len() - 1) {
            worst_trace = trace;
        }
        count.fetch_add(1, Ordering::Relaxed);
    }
    Ok(of_row(campaign, row, cells, worst_trace))
}

fn of_row(campaign: &Campaign<'_>, row: usize, cells: Vec<Cell>, trace: String) -> Row {
    let about = &campaign.rows()[row];
    let (fault, reference) = (about.fault().to_owned(), about.reference().map(str::to_owned));
    Row { row, fault, reference, seed: about.seed, worst: worst(&cells).unwrap_or(0), trace, cells }
}

/// Returns at most [`TRACE`] lines of a trace, from shortly before the fault, and notes on the omitted lines.
fn shortened(trace: &str) -> String {
    let lines: Vec<&str> = trace.lines().collect();
    let fault = lines.iter().position(|line| line.starts_with(FAULT)).unwrap_or(0);
    let from = fault.saturating_sub(BEFORE);
    let to = lines.len().min(from + TRACE);
    let left_out = |lines: usize| if lines > 0 { format!("… {lines} more lines\n") } else { String::new() };
    format!("{}{}\n{}", left_out(from), lines[from..to].join("\n"), left_out(lines.len() - to)).trim_end().to_owned()
}

/// Runs a task; `None` if a signal ends it. The processes that it has started end, too.
pub(super) fn until_signal<R: Send + 'static>(work: impl Fn() -> R + Send + Sync + 'static) -> Option<R> {
    let mut result = None;
    let take = |done| {
        result = Some(done);
        Ok::<(), ()>(())
    };
    if in_order(vec![()], 1, move |()| work(), &interruption(), take, || {}).is_err() {
        process::end_all();
    }
    result
}

/// Returns a flag that becomes true when a signal requests the end of the process.
pub(super) fn interruption() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let interrupted = flag.clone();
    let listen = move || -> io::Result<()> {
        let runtime = Builder::new_current_thread().enable_io().build()?;
        runtime.block_on(async {
            Signals::install()?.wait().await;
            interrupted.store(true, Ordering::Relaxed);
            Ok(())
        })
    };
    // Without the thread, a signal ends the process; the complete rows are in the file.
    let _ = std::thread::Builder::new().name("signals".to_owned()).spawn(listen);
    flag
}
