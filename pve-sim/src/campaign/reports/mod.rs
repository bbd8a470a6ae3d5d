//! The reports of a campaign. Each report receives the rows one by one, so that no report holds all cells.

mod csv;
mod json;
mod junit;
mod page;
mod summary;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};

use super::manifest::Manifest;
use super::results::Row;
use crate::output::CommandError;

use summary::Summary;
pub(super) use summary::reaction;

/// The files of the reports.
#[derive(Args, Clone, Debug, Default)]
pub(super) struct Reports {
    /// Write an HTML page with the matrix, reaction times and traces to FILE
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    pub(super) html: Option<PathBuf>,

    /// Write the results to FILE as CSV, a line for each cell
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    pub(super) csv: Option<PathBuf>,

    /// Write all results to FILE as one JSON document
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    pub(super) json: Option<PathBuf>,

    /// Write the results to FILE as JUnit XML, a test case for each fault
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Reports")]
    pub(super) junit: Option<PathBuf>,
}

impl Reports {
    /// Returns each option that was given, with its file.
    pub(super) fn files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let files = [("--html", &self.html), ("--csv", &self.csv), ("--json", &self.json), ("--junit", &self.junit)];
        files.into_iter().filter_map(|(option, file)| Some((option, file.as_deref()?)))
    }
}

/// Writes the reports, and the summary to `out`. Each of them reads the rows once more. Returns whether each cell passed
/// and no row is missing. Errors of `out` are ignored.
pub(super) fn report<R: Iterator<Item = Result<Row, CommandError>>>(
    manifest: &Manifest,
    reports: &Reports,
    rows: impl Fn() -> Result<R, CommandError>,
    out: &mut dyn Write,
) -> Result<bool, CommandError> {
    for (option, path) in reports.files() {
        let mut read = Ok(());
        let mut rows = rows()?.map_while(|row| row.map_err(|error| read = Err(error)).ok());
        let written = write(option, path, manifest, &mut rows);
        read?;
        written.map_err(|error| CommandError::unwritten(option, path, &error))?;
    }
    let mut summary = Summary::new(manifest);
    for row in rows()? {
        let _ = summary.row(&row?, out);
    }
    let _ = summary.end(out).and_then(|()| out.flush());
    Ok(summary.passed())
}

/// Writes the report of an option.
fn write(option: &str, path: &Path, manifest: &Manifest, rows: &mut dyn Iterator<Item = Row>) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    match option {
        "--html" => page::write(&mut file, manifest, rows),
        "--csv" => csv::write(&mut file, manifest, rows),
        "--json" => json::write(&mut file, manifest, rows),
        _ => junit::write(&mut file, manifest, rows),
    }?;
    file.flush()
}
