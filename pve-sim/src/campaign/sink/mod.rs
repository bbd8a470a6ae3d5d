//! The reports of a campaign. Each report receives the rows one by one, so that no report holds all cells.

mod csv;
mod json;
mod junit;
mod page;
mod summary;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::manifest::Manifest;
use super::results::{ResultsError, Row};

use summary::Summary;
pub(super) use summary::reaction;

/// A report that receives the rows one by one.
pub(super) trait Sink {
    /// Adds the next row.
    fn row(&mut self, row: &Row) -> io::Result<()>;

    /// Completes the report.
    fn end(&mut self) -> io::Result<()>;
}

/// The files of the reports.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reports {
    /// The file of `--html`.
    pub html: Option<PathBuf>,
    /// The file of `--csv`.
    pub csv: Option<PathBuf>,
    /// The file of `--json`.
    pub json: Option<PathBuf>,
    /// The file of `--junit`.
    pub junit: Option<PathBuf>,
}

impl Reports {
    /// Returns each option that was given, with its file.
    pub fn files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let files = [("--html", &self.html), ("--csv", &self.csv), ("--json", &self.json), ("--junit", &self.junit)];
        files.into_iter().filter_map(|(option, file)| Some((option, file.as_deref()?)))
    }
}

/// An error while a report is written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A report cannot be written.
    #[error("{option} {}: {source}", path.display())]
    Write {
        /// The option that names the file.
        option: &'static str,
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The results cannot be read.
    #[error(transparent)]
    Results(#[from] ResultsError),
}

/// A report with its file.
struct Named {
    option: &'static str,
    path: PathBuf,
    sink: Box<dyn Sink>,
}

impl Named {
    fn error(&self, source: io::Error) -> ReportError {
        ReportError::Write { option: self.option, path: self.path.clone(), source }
    }
}

/// Writes the reports, and the summary to `out`. Returns whether each cell passed and no row is missing. Errors of
/// `out` are ignored.
pub(super) fn report(
    manifest: &Manifest,
    reports: &Reports,
    mut rows: impl FnMut() -> Result<Option<Row>, ResultsError>,
    out: &mut dyn Write,
) -> Result<bool, ReportError> {
    let mut summary = Summary::new(manifest);
    let mut sinks = Vec::new();
    for (option, path) in reports.files() {
        let open = || -> io::Result<Box<dyn Sink>> {
            let file = BufWriter::new(File::create(path)?);
            Ok(match option {
                "--html" => Box::new(page::Page::new(file, manifest)?),
                "--csv" => Box::new(csv::Csv::new(file, manifest)?),
                "--json" => Box::new(json::Json::new(file, manifest)?),
                _ => Box::new(junit::JUnit::new(file, manifest)),
            })
        };
        let path = path.to_owned();
        match open() {
            Ok(sink) => sinks.push(Named { option, path, sink }),
            Err(source) => return Err(ReportError::Write { option, path, source }),
        }
    }
    while let Some(row) = rows()? {
        for named in &mut sinks {
            named.sink.row(&row).map_err(|error| named.error(error))?;
        }
        let _ = summary.row(&row, out);
    }
    for named in &mut sinks {
        named.sink.end().map_err(|error| named.error(error))?;
    }
    let _ = summary.end(out).and_then(|()| out.flush());
    Ok(summary.passed())
}
