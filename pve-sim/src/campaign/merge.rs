//! `campaign merge`: joins the results of shards.

use std::io::Write;
use std::path::PathBuf;

use super::manifest::Manifest;
use super::results::{Reader, ResultsError, Row, Writer};
use super::sink::{ReportError, Reports, report};

/// The maximum number of missing rows in a message.
const NAMED: usize = 20;

/// The options of `campaign merge`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MergeOptions {
    /// The results files.
    pub files: Vec<PathBuf>,
    /// The merged results file, if any.
    pub results: Option<PathBuf>,
    /// The reports.
    pub reports: Reports,
}

/// Merges results and reports them. Returns whether no row is missing and each cell passed.
///
/// # Errors
/// [`ReportError`]
pub fn merge(options: &MergeOptions, out: &mut dyn Write) -> Result<bool, ReportError> {
    let mut has = Vec::new();
    let mut manifest: Option<Manifest> = None;
    for path in &options.files {
        let mut reader = Reader::open(path)?;
        let found = &reader.manifest;
        match &mut manifest {
            None => manifest = Some(found.clone()),
            Some(first) if !first.is_of_campaign_of(found) => {
                let reason = format!(
                    "these results differ in plan, version, seed or --no-fork from {}",
                    options.files[0].display()
                );
                return Err(ResultsError::new(path, reason).into());
            }
            Some(first) if !first.machine.split("; ").any(|machine| machine == found.machine) => {
                first.machine = format!("{}; {}", first.machine, found.machine);
            }
            Some(_) => {}
        }
        has.resize(has.len().max(reader.manifest.rows), false);
        while let Some(row) = reader.next_row()? {
            if let Some(has) = has.get_mut(row.head.row) {
                *has = true;
            }
        }
    }
    let Some(manifest) = manifest else { return Ok(false) };
    let manifest = Manifest { shard: None, missing: missing(&has), ..manifest };

    let mut files = Vec::new();
    for path in &options.files {
        let mut reader = Reader::open(path)?;
        files.push((reader.next_row()?, reader));
    }
    let mut results = options.results.as_deref().map(|path| Writer::create(path, &manifest)).transpose()?;
    let next = || {
        let row = next(&mut files)?;
        if let (Some(results), Some(row)) = (&mut results, &row) {
            results.append(row)?;
        }
        Ok(row)
    };
    report(&manifest, &options.reports, next, out)
}

/// Returns the next row by number. A row in several files is returned once.
fn next(files: &mut [(Option<Row>, Reader)]) -> Result<Option<Row>, ResultsError> {
    let lowest = files.iter().filter_map(|(row, _)| Some(row.as_ref()?.head.row)).min();
    let mut found: Option<Row> = None;
    for (row, reader) in files.iter_mut().filter(|(row, _)| row.as_ref().map(|row| row.head.row) == lowest) {
        if row.is_none() {
            continue;
        }
        let following = reader.next_row()?;
        let row = std::mem::replace(row, following);
        if found.is_some() && found != row {
            let number = lowest.unwrap_or(0);
            return Err(ResultsError::new(reader.path(), format!("row {number} is different in another file")));
        }
        found = row;
    }
    Ok(found)
}

/// Describes the rows missing from all files; `None` if no row is missing.
fn missing(has: &[bool]) -> Option<String> {
    let rows: Vec<String> = has.iter().enumerate().filter(|(_, has)| !**has).map(|(row, _)| row.to_string()).collect();
    let more = if rows.len() > NAMED { format!(" and {} more", rows.len() - NAMED) } else { String::new() };
    let named = rows.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    (!rows.is_empty()).then(|| format!("{} of {} rows, with all their cells: {named}{more}", rows.len(), has.len()))
}
