//! `campaign --cell` runs one cell alone, and `campaign --list` lists the cells.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use hal_sim::campaign::{Campaign, Cell as Place, Judge};
use hal_sim::simulation::Simulation;
use protocol_core::time::Instant;
use serde::Serialize;

use super::CampaignError;
use super::plan::{Prepared, prepare};
use super::results::Cell;
use super::run::until_signal;
use super::sink::reaction;
use crate::control::Speed;

/// The options of `campaign --cell`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellOptions {
    /// The plan.
    pub plan: PathBuf,
    /// The seed that replaces the seeds of the plan.
    pub seed: Option<u64>,
    /// The cell.
    pub which: Which,
}

/// A cell on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// A cell of the grid by its number, as in `17`.
    Number(u64),
    /// A row and an instant in microseconds, as in `3@1234000`.
    At(usize, u64),
}

impl Which {
    /// Returns the cell; `None` if the campaign has no such cell.
    pub(super) fn of(self, campaign: &Campaign<'_>) -> Option<Place> {
        match self {
            Self::Number(number) => campaign.numbered(number),
            Self::At(row, at_us) => campaign.at(row, Instant::from_micros(at_us)),
        }
    }
}

impl FromStr for Which {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let which = match text.split_once('@') {
            None => text.parse().ok().map(Self::Number),
            Some((row, at)) => row.parse().ok().zip(at.parse().ok()).map(|(row, at)| Self::At(row, at)),
        };
        which.ok_or_else(|| "must be the number of a cell, as in 17, or ROW@MICROSECONDS, as in 3@1234000".to_owned())
    }
}

/// Runs a cell, and writes its trace and verdict to `out`. Returns whether the cell passed. Errors of `out` are
/// ignored.
///
/// # Errors
/// [`CampaignError`]
pub fn run_cell(options: &CellOptions, out: &mut dyn Write) -> Result<bool, CampaignError> {
    let Prepared { campaign, manifest, live, .. } = prepare(&options.plan, options.seed, true)?;
    let place = options.which.of(&campaign).ok_or_else(|| unknown(&campaign))?;
    let row = &campaign.rows()[place.row];
    let (cell, trace) = match (live, options.which) {
        (Some(live), Which::Number(number)) => {
            let ended = until_signal(move || live.run(number, place.at.as_micros()));
            let ran = ended.ok_or_else(|| CampaignError::Program("interrupted".to_owned()))?;
            ran.map_err(|error| CampaignError::Program(error.to_string()))?
        }
        (Some(_), Which::At(..)) => {
            return Err(CampaignError::Refused(
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
/// [`CampaignError`]
pub fn judged(options: &CellOptions, speed: Speed) -> Result<(Simulation, Judge), CampaignError> {
    let Prepared { campaign, plan, .. } = prepare(&options.plan, options.seed, true)?;
    let campaign: &'static Campaign<'_> = Box::leak(Box::new(campaign));
    let cell = options.which.of(campaign);
    let seed = cell.and_then(|cell| campaign.rows().get(cell.row)).map_or(0, |row| row.seed);
    let simulation = plan.simulation(seed);
    let judge = cell.and_then(|cell| Judge::new(campaign, cell, speed == Speed::STEP, &simulation));
    Ok((simulation, judge.ok_or_else(|| unknown(campaign))?))
}

fn unknown(campaign: &Campaign<'_>) -> CampaignError {
    let (rows, cells) = (campaign.rows().len(), campaign.cells());
    CampaignError::Refused(format!(
        "--cell: no such cell; the plan has {rows} rows and {cells} cells, numbered from 0; an instant is one from the \
         first to the last of the plan"
    ))
}

/// A cell in the output of `--list`.
#[derive(Serialize)]
struct Listed<'a> {
    number: u64,
    row: usize,
    fault: &'a str,
    reference: Option<&'a str>,
    seed: u64,
    at_us: u64,
}

/// Writes the grid cells of a plan to `out`, one JSON value per line. Errors of `out` are ignored.
///
/// # Errors
/// [`CampaignError`]
pub fn list(plan: &Path, seed: Option<u64>, out: &mut dyn Write) -> Result<bool, CampaignError> {
    let Prepared { campaign, .. } = prepare(plan, seed, true)?;
    for number in 0..campaign.cells() {
        let Some(cell) = campaign.numbered(number) else { continue };
        let row = &campaign.rows()[cell.row];
        let (fault, reference, seed) = (row.fault(), row.reference(), row.seed);
        let listed = Listed { number, row: cell.row, fault, reference, seed, at_us: cell.at.as_micros() };
        let _ = writeln!(out, "{}", serde_json::to_string(&listed).unwrap_or_default());
    }
    Ok(true)
}
