//! `campaign merge`: joins the results of shards.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;

use clap::{Args, ValueHint};

use super::manifest::Manifest;
use super::reports::{Reports, report};
use super::results::{Reader, Row, Writer};
use crate::output::CommandError;

/// The maximum number of missing rows in a message.
const NAMED: usize = 20;

/// The arguments of `campaign merge`.
#[derive(Args, Clone, Debug)]
pub(super) struct MergeOptions {
    /// The results files of the shards
    #[arg(value_name = "RESULTS", required = true, value_hint = ValueHint::FilePath)]
    pub(super) files: Vec<PathBuf>,

    /// Write the joined results to FILE
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub(super) results: Option<PathBuf>,

    /// The reports.
    #[command(flatten)]
    pub(super) reports: Reports,
}

/// Merges results and reports them. Returns whether no row is missing and each cell passed.
///
/// # Errors
/// [`CommandError`]
pub(super) fn merge(options: &MergeOptions, out: &mut dyn Write) -> Result<bool, CommandError> {
    let mut manifest: Option<Manifest> = None;
    for path in &options.files {
        let found = Reader::open(path)?.manifest;
        match &mut manifest {
            None => manifest = Some(found),
            Some(first) if !first.is_of_campaign_of(&found) => {
                let reason = format!(
                    "these results differ in plan, version, seed or --no-fork from {}",
                    options.files[0].display()
                );
                return Err(CommandError::of(path, reason));
            }
            Some(first) if !first.machine.split("; ").any(|machine| machine == found.machine) => {
                first.machine = format!("{}; {}", first.machine, found.machine);
            }
            Some(_) => {}
        }
    }
    let Some(manifest) = manifest else { return Ok(false) };
    let rows = || merged(&options.files);
    let present = rows()?.map(|row| Ok(row?.row)).collect::<Result<_, CommandError>>()?;
    let manifest = Manifest { shard: None, missing: missing(manifest.rows, &present), ..manifest };
    if let Some(path) = &options.results {
        let mut results = Writer::create(path, &manifest)?;
        rows()?.try_for_each(|row| results.append(&row?))?;
    }
    report(&manifest, &options.reports, rows, out)
}

/// Returns the rows of all files by number. A row in several files comes once.
fn merged(files: &[PathBuf]) -> Result<impl Iterator<Item = Result<Row, CommandError>>, CommandError> {
    let mut readers = Vec::new();
    for path in files {
        let mut reader = Reader::open(path)?;
        readers.push((reader.next().transpose()?, reader));
    }
    Ok(std::iter::from_fn(move || next(&mut readers).transpose()))
}

/// Returns the next row of all files by number.
fn next(files: &mut [(Option<Row>, Reader)]) -> Result<Option<Row>, CommandError> {
    let Some(lowest) = files.iter().filter_map(|(row, _)| Some(row.as_ref()?.row)).min() else { return Ok(None) };
    let mut found: Option<Row> = None;
    for (row, reader) in files.iter_mut().filter(|(row, _)| row.as_ref().is_some_and(|row| row.row == lowest)) {
        let following = reader.next().transpose()?;
        let row = std::mem::replace(row, following);
        if found.is_some() && found != row {
            return Err(CommandError::of(reader.path(), format!("row {lowest} is different in another file")));
        }
        found = row;
    }
    Ok(found)
}

/// Describes the rows missing from all files; `None` if no row is missing.
fn missing(rows: usize, present: &BTreeSet<usize>) -> Option<String> {
    let count = rows - present.len();
    let more = if count > NAMED { format!(" and {} more", count - NAMED) } else { String::new() };
    let missing = (0..rows).filter(|row| !present.contains(row)).map(|row| row.to_string());
    let named = missing.take(NAMED).collect::<Vec<_>>().join(", ");
    (count > 0).then(|| format!("{count} of {rows} rows, with all their cells: {named}{more}"))
}
