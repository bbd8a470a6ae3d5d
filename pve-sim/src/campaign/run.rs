//! Runs the rows of a plan, appends them to the results file, and reports them.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hal_sim::campaign::{Campaign, Cell as Place, CellResult, Verdict};
use protocol_core::time::Instant;
use tokio::runtime::Builder;

use super::CampaignError;
use super::cores::{Message, Stopped, in_order, messages};
use super::live::Live;
use super::manifest::{Manifest, Shard};
use super::plan::{Prepared, prepare};
use super::process;
use super::progress::Progress;
use super::results::{Cell, Reader, Row, RowHead, Writer};
use super::sink::{Reports, report};
use crate::run::Signals;

/// The maximum number of lines of a trace in the results.
const TRACE: usize = 200;
/// The maximum number of lines of a trace before the fault.
const BEFORE: usize = 6;
/// The beginning of the note that marks the fault in a trace.
const FAULT: &str = "-- fault: ";

/// The options of `campaign`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunOptions {
    /// The plan.
    pub plan: PathBuf,
    /// The seed that replaces the seeds of the plan.
    pub seed: Option<u64>,
    /// The number of rows that run at once; by default the number of processors.
    pub jobs: Option<usize>,
    /// The part of the rows to run; by default all.
    pub shard: Option<Shard>,
    /// True to keep the complete rows in the results file.
    pub resume: bool,
    /// True to fork cells at the instant of the fault; otherwise each cell runs from 0 ms.
    pub forked: bool,
    /// The results file.
    pub results: PathBuf,
    /// The reports.
    pub reports: Reports,
}

/// Runs a campaign, and writes its summary to `out`. Returns whether each cell passed. Errors of `out` are ignored.
///
/// # Errors
/// [`CampaignError`]
pub fn run(options: &RunOptions, out: &mut dyn Write) -> Result<bool, CampaignError> {
    let Prepared { campaign, manifest, live, .. } = prepare(&options.plan, options.seed, options.forked)?;
    let manifest = Manifest { shard: options.shard, ..manifest };
    let path = &options.results;
    let (writer, done) = if options.resume && path.metadata().is_ok_and(|meta| meta.len() > 0) {
        Writer::resume(path, &manifest)?
    } else {
        (Writer::create(path, &manifest)?, BTreeSet::new())
    };
    let is_own = |row: &usize| options.shard.is_none_or(|shard| shard.has(*row)) && !done.contains(row);
    let rows: Vec<usize> = (0..manifest.rows).filter(is_own).collect();
    run_rows(campaign, live, rows, options, writer)?;
    let mut reader = Reader::open(path)?;
    Ok(report(&manifest, &options.reports, || reader.next_row(), out)?)
}

/// Runs rows on several threads, and appends them to the results file in order.
fn run_rows(
    campaign: Campaign<'static>,
    live: Option<Live>,
    rows: Vec<usize>,
    options: &RunOptions,
    mut writer: Writer,
) -> Result<(), CampaignError> {
    let jobs = options.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let cells = Arc::new(AtomicU64::new(0));
    let (mut progress, mut taken) = (Progress::new(rows.len()), 0);
    let work = {
        let cells = cells.clone();
        move |row: &usize| match &live {
            Some(live) => run_row_live(&campaign, live, *row, &cells),
            None => Ok(run_row(&campaign, *row, &cells)),
        }
    };
    let taken_so_far = std::cell::Cell::new(0);
    let take = |row: io::Result<Row>| {
        let row = row.map_err(|error| CampaignError::Program(error.to_string()))?;
        taken += 1;
        taken_so_far.set(taken);
        Ok(writer.append(&row)?)
    };
    let channel = messages();
    let sender = channel.0.clone();
    on_signal(move || drop(sender.send(Message::Interrupted)));
    let ended = in_order(rows, jobs, work, channel, take, || progress.tell(&cells, taken_so_far.get()));
    progress.end();
    if ended.is_err() {
        process::end_all();
    }
    let path = || options.results.clone();
    ended.map_err(|stopped: Stopped<CampaignError>| match stopped {
        Stopped::Failed(error) => error,
        Stopped::Interrupted => CampaignError::Interrupted(path()),
        Stopped::Panicked => CampaignError::Panicked(path()),
    })
}

fn run_row(campaign: &Campaign<'_>, row: usize, count: &AtomicU64) -> Row {
    let mut cells: Vec<Cell> = Vec::new();
    let mut each = |result: CellResult| {
        cells.push(Cell::of(&result));
        count.fetch_add(1, Ordering::Relaxed);
    };
    campaign.row(row, &mut each);
    let worst = worst(&cells);
    let trace = cells.get(worst).filter(|cell| cell.verdict != Verdict::NoEffect);
    let trace = trace.and_then(|cell| campaign.trace(Place { row, at: Instant::from_micros(cell.at_us) }));
    let trace = trace.map_or_else(String::new, |trace| shortened(&trace));
    of_row(campaign, row, cells, worst, trace)
}

/// Runs the grid cells of a row with a program as the controller.
fn run_row_live(campaign: &Campaign<'_>, live: &Live, row: usize, count: &AtomicU64) -> io::Result<Row> {
    let (first, length) = campaign.rows().get(row).map_or((0, 0), |row| (row.first, row.cells));
    let (mut cells, mut traces): (Vec<Cell>, Vec<String>) = (Vec::new(), Vec::new());
    for number in first..first + length {
        let at_us = campaign.numbered(number).map_or(0, |cell| cell.at.as_micros());
        let (cell, trace) = live.run(number, at_us)?;
        cells.push(cell);
        traces.push(trace);
        // Only the trace of the worst cell is kept.
        let worst = worst(&cells);
        traces.iter_mut().enumerate().filter(|(place, _)| *place != worst).for_each(|(_, trace)| trace.clear());
        count.fetch_add(1, Ordering::Relaxed);
    }
    let worst = worst(&cells);
    let trace = traces.get(worst).cloned().unwrap_or_default();
    Ok(of_row(campaign, row, cells, worst, trace))
}

fn of_row(campaign: &Campaign<'_>, row: usize, cells: Vec<Cell>, worst: usize, trace: String) -> Row {
    let about = &campaign.rows()[row];
    let (fault, reference, seed) = (about.fault().to_owned(), about.reference().map(str::to_owned), about.seed);
    Row { head: RowHead { row, fault, reference, seed, cells: cells.len(), worst, trace }, cells }
}

/// Returns the index of the worst cell; of several, the first.
fn worst(cells: &[Cell]) -> usize {
    let severity = |place: &usize| (cells[*place].severity(), std::cmp::Reverse(*place));
    (0..cells.len()).max_by_key(severity).unwrap_or(0)
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
    let channel = messages();
    let sender = channel.0.clone();
    on_signal(move || drop(sender.send(Message::Interrupted)));
    let mut result = None;
    let take = |done| {
        result = Some(done);
        Ok::<(), ()>(())
    };
    if in_order(vec![()], 1, move |()| work(), channel, take, || {}).is_err() {
        process::end_all();
    }
    result
}

/// Calls `act` when a signal requests the end of the process.
pub(super) fn on_signal(act: impl FnOnce() + Send + 'static) {
    let listen = move || -> io::Result<()> {
        let runtime = Builder::new_current_thread().enable_io().build()?;
        runtime.block_on(async {
            Signals::install()?.wait().await;
            act();
            Ok(())
        })
    };
    // Without the thread, a signal ends the process; the complete rows are in the file.
    let _ = std::thread::Builder::new().name("signals".to_owned()).spawn(listen);
}
