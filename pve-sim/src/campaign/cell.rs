//! `campaign --cell` runs one cell alone, and `campaign --list` lists the cells.

use std::io::Write;
use std::path::{Path, PathBuf};

use hal_sim::campaign::{Campaign, Judge};
use hal_sim::simulation::Simulation;
use serde_json::json;

use super::options::Which;
use super::plan::{Prepared, prepare};
use super::reports::reaction;
use super::results::Cell;
use super::run::until_signal;
use crate::control::Speed;
use crate::output::CommandError;

/// A cell of a plan.
#[derive(Clone, Debug)]
pub struct CellOptions {
    /// The plan.
    pub plan: PathBuf,
    /// The seed that replaces the seeds of the plan.
    pub seed: Option<u64>,
    /// The cell.
    pub which: Which,
}

/// Runs a cell, and writes its trace and verdict to `out`. Returns whether the cell passed. Errors of `out` are
/// ignored.
///
/// # Errors
/// [`CommandError`]
pub(super) fn run_cell(options: &CellOptions, out: &mut dyn Write) -> Result<bool, CommandError> {
    let Prepared { campaign, manifest, live, .. } = prepare(&options.plan, options.seed, true)?;
    let place = options.which.of(&campaign).ok_or_else(|| unknown(&campaign))?;
    let row = &campaign.rows()[place.row];
    let (cell, trace) = match (live, options.which) {
        (Some(live), Which::Number(number)) => {
            let ended = until_signal(move || live.run(number, place.at.as_micros()));
            let ran = ended.ok_or_else(|| CommandError::Failed("interrupted".to_owned()))?;
            ran.map_err(|error| CommandError::Failed(error.to_string()))?
        }
        (Some(_), Which::At(..)) => {
            return Err(CommandError::Refused(
                "--cell: a plan with a controller accepts only the number of a cell, as in 17, not ROW@MICROSECONDS"
                    .to_owned(),
            ));
        }
        (None, _) => {
            let run = campaign.cell(place).zip(campaign.trace(place));
            let (result, trace) = run.ok_or_else(|| unknown(&campaign))?;
            (Cell::of(&result), trace)
        }
    };
    let word = if cell.verdict.passed() { "ok   " } else { "FAIL " };
    let _ = writeln!(
        out,
        "{}\n{word}{} (seed {}): {}",
        trace.trim_end(),
        row.fault(),
        row.seed,
        reaction(&cell, &manifest.limits)
    );
    Ok(cell.verdict.passed())
}

/// Returns the unpowered devices of a plan and the judge of a cell, for a run whose controller is a client of the bus.
///
/// # Errors
/// [`CommandError`]
pub fn judged(options: &CellOptions, speed: Speed) -> Result<(Simulation, Judge), CommandError> {
    let Prepared { campaign, .. } = prepare(&options.plan, options.seed, true)?;
    let campaign: &'static Campaign<'_> = Box::leak(Box::new(campaign));
    let cell = options.which.of(campaign);
    let judged = cell.and_then(|cell| Judge::new(campaign, cell, speed == Speed::STEP));
    judged.ok_or_else(|| unknown(campaign))
}

fn unknown(campaign: &Campaign<'_>) -> CommandError {
    let (rows, cells) = (campaign.rows().len(), campaign.cells());
    CommandError::Refused(format!(
        "--cell: no such cell; the plan has {rows} rows and {cells} cells, numbered from 0; an instant is one from the \
         first to the last of the plan"
    ))
}

/// Writes the grid cells of a plan to `out`, one JSON value per line. Errors of `out` are ignored.
///
/// # Errors
/// [`CommandError`]
pub(super) fn list(plan: &Path, seed: Option<u64>, out: &mut dyn Write) -> Result<bool, CommandError> {
    let Prepared { campaign, .. } = prepare(plan, seed, true)?;
    for number in 0..campaign.cells() {
        let Some(cell) = campaign.numbered(number) else { continue };
        let row = &campaign.rows()[cell.row];
        let (fault, reference, at_us) = (row.fault(), row.reference(), cell.at.as_micros());
        let listed = json!({ "number": number, "row": cell.row, "fault": fault, "reference": reference, "seed": row.seed, "at_us": at_us });
        let _ = writeln!(out, "{listed}");
    }
    Ok(true)
}
