//! Results files: JSON lines. The manifest comes first, then each row with its cells, in the order of the rows.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, BufWriter, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use hal_sim::campaign::{CellResult, Verdict};
use serde::{Deserialize, Serialize};

use super::manifest::{FORMAT, Manifest};

/// A line of a results file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Line {
    Manifest(Manifest),
    Row(RowHead),
    Cell(Cell),
}

/// The head of a row: one fault with one seed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RowHead {
    /// The number of the row, from 0.
    pub(super) row: usize,
    /// The fault in words.
    pub(super) fault: String,
    /// The reference of the fault in the plan.
    pub(super) reference: Option<String>,
    /// The seed of the run.
    pub(super) seed: u64,
    /// The number of cells of the row.
    pub(super) cells: usize,
    /// The index of the worst cell.
    pub(super) worst: usize,
    /// The explained trace of the worst cell.
    pub(super) trace: String,
}

/// A cell of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Cell {
    /// The number of a grid cell; `None` for a cell of the refinement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) number: Option<u64>,
    /// The instant of the fault.
    pub(super) at_us: u64,
    pub(super) verdict: Verdict,
    /// The time from the fault to its detection.
    pub(super) detected_us: Option<u64>,
    /// The time from the fault to the safe state.
    pub(super) safe_us: Option<u64>,
    /// The number of frames that a communication fault affected; 1 for any other fault that acted.
    pub(super) struck: u64,
}

impl Cell {
    pub(super) fn of(result: &CellResult) -> Self {
        let CellResult { number, at_us, verdict, detected_us, safe_us, struck, .. } = *result;
        Self { number, at_us, verdict, detected_us, safe_us, struck }
    }

    /// Returns the same key as [`CellResult::severity`].
    pub(super) fn severity(&self) -> (Verdict, bool, u64) {
        let reaction = self.detected_us.max(self.safe_us);
        (self.verdict, reaction.is_none() && self.verdict != Verdict::NoEffect, reaction.unwrap_or(0))
    }

    /// Returns the argument of `--cell`.
    pub(super) fn argument(&self, row: usize) -> String {
        self.number.map_or_else(|| format!("{row}@{}", self.at_us), |number| number.to_string())
    }
}

/// A row with its cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Row {
    pub(super) head: RowHead,
    pub(super) cells: Vec<Cell>,
}

impl Row {
    /// Returns the worst cell.
    pub(super) fn worst(&self) -> Option<&Cell> {
        self.cells.get(self.head.worst)
    }

    /// Returns the number of cells with each verdict, from the worst to the best.
    pub(super) fn counts(&self) -> Vec<(Verdict, usize)> {
        let of = |verdict: Verdict| (verdict, self.cells.iter().filter(|cell| cell.verdict == verdict).count());
        Verdict::ALL.into_iter().rev().map(of).filter(|(_, count)| *count > 0).collect()
    }

    /// Returns the command line that runs a cell alone.
    pub(super) fn command(&self, manifest: &Manifest, cell: &Cell) -> String {
        let seed = manifest.seed.map_or_else(String::new, |seed| format!(" --seed {seed}"));
        format!("pve-sim campaign {}{seed} --cell {}", quoted(&manifest.plan), cell.argument(self.head.row))
    }
}

/// Quotes a word for a shell where it needs quotes.
pub(super) fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "_@%+=:,./-".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// The error of a results file.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct ResultsError {
    path: PathBuf,
    reason: String,
}

impl ResultsError {
    pub(super) fn new(path: &Path, reason: impl ToString) -> Self {
        Self { path: path.to_owned(), reason: reason.to_string() }
    }
}

/// A writer that appends rows to a results file.
#[derive(Debug)]
pub(super) struct Writer {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Writer {
    /// Creates a results file, or replaces an earlier one. Refuses to replace any other file with contents.
    pub(super) fn create(path: &Path, manifest: &Manifest) -> Result<Self, ResultsError> {
        let is_replaceable = match path.metadata() {
            Err(_) => true,
            Ok(meta) => !meta.is_file() || meta.len() == 0 || Reader::open(path).is_ok(),
        };
        if !is_replaceable {
            return Err(ResultsError::new(path, "not a results file, so it is not replaced; use another --results"));
        }
        let file = File::create(path).map_err(|error| ResultsError::new(path, error))?;
        let mut writer = Self { path: path.to_owned(), file: BufWriter::new(file) };
        writer.write([Line::Manifest(manifest.clone())])?;
        Ok(writer)
    }

    /// Opens the results of an interrupted campaign for appending after the last complete row. Returns the numbers of
    /// the complete rows.
    pub(super) fn resume(path: &Path, manifest: &Manifest) -> Result<(Self, BTreeSet<usize>), ResultsError> {
        let mut reader = Reader::open(path)?;
        let found = &reader.manifest;
        if !found.is_of_campaign_of(manifest) || found.shard != manifest.shard {
            let reason = "these results differ in plan, version, seed, shard or --no-fork; \
                          omit --resume to replace them";
            return Err(ResultsError::new(path, reason));
        }
        let mut rows = BTreeSet::new();
        while let Some(row) = reader.next_row()? {
            rows.insert(row.head.row);
        }
        let of = |error: io::Error| ResultsError::new(path, error);
        let mut file = OpenOptions::new().write(true).open(path).map_err(of)?;
        file.set_len(reader.complete).map_err(of)?;
        file.seek(SeekFrom::End(0)).map_err(of)?;
        Ok((Self { path: path.to_owned(), file: BufWriter::new(file) }, rows))
    }

    /// Appends a row, and flushes the file to the operating system.
    pub(super) fn append(&mut self, row: &Row) -> Result<(), ResultsError> {
        let cells = row.cells.iter().map(|cell| Line::Cell(*cell));
        self.write([Line::Row(row.head.clone())].into_iter().chain(cells))
    }

    fn write(&mut self, lines: impl IntoIterator<Item = Line>) -> Result<(), ResultsError> {
        let write = || {
            for line in lines {
                serde_json::to_writer(&mut self.file, &line)?;
                self.file.write_all(b"\n")?;
            }
            self.file.flush()
        };
        write().map_err(|error| ResultsError::new(&self.path, error))
    }
}

/// A reader of a results file, row by row.
#[derive(Debug)]
pub(super) struct Reader {
    path: PathBuf,
    file: BufReader<File>,
    pub(super) manifest: Manifest,
    /// The number of the last line that was read.
    line: u64,
    /// The lowest possible number of the next row.
    lowest: usize,
    read: u64,
    /// The length of the manifest and the complete rows so far, in bytes.
    complete: u64,
    text: String,
}

impl Reader {
    pub(super) fn open(path: &Path) -> Result<Self, ResultsError> {
        let file = File::open(path).map_err(|error| ResultsError::new(path, error))?;
        let mut file = BufReader::new(file);
        // Any other file may be one endless line.
        let mut text = Vec::new();
        let first = io::Read::take(&mut file, 1 << 20).read_until(b'\n', &mut text);
        let read = first.map_err(|error| ResultsError::new(path, error))? as u64;
        match serde_json::from_slice(&text) {
            Ok(Line::Manifest(manifest)) if manifest.format == FORMAT && text.ends_with(b"\n") => {
                let path = path.to_owned();
                Ok(Self { path, file, manifest, line: 1, lowest: 0, read, complete: read, text: String::new() })
            }
            _ => Err(ResultsError::new(path, "not a results file in the format of this version")),
        }
    }

    /// Returns the next row; `None` at the end, or if the rest is incomplete.
    pub(super) fn next_row(&mut self) -> Result<Option<Row>, ResultsError> {
        let head = match self.next_line()? {
            None => return Ok(None),
            Some(Line::Row(head)) => head,
            Some(_) => return Err(self.refuse("a row was expected")),
        };
        let Manifest { rows, shard, .. } = self.manifest;
        if head.row < self.lowest || head.row >= rows || shard.is_some_and(|shard| !shard.has(head.row)) {
            return Err(self.refuse(&format!("row {} does not belong here", head.row)));
        }
        self.lowest = head.row + 1;
        let mut cells = Vec::new();
        while cells.len() < head.cells {
            match self.next_line()? {
                None => return Ok(None),
                Some(Line::Cell(cell)) => cells.push(cell),
                Some(_) => return Err(self.refuse("a cell was expected")),
            }
        }
        if head.worst >= cells.len() {
            return Err(self.refuse("the index of the worst cell is beyond the cells of the row"));
        }
        self.complete = self.read;
        Ok(Some(Row { head, cells }))
    }

    /// Returns the next line; `None` at the end, or if the last line is incomplete.
    fn next_line(&mut self) -> Result<Option<Line>, ResultsError> {
        self.text.clear();
        let read = self.file.read_line(&mut self.text).map_err(|error| ResultsError::new(&self.path, error))?;
        if !self.text.ends_with('\n') {
            return Ok(None);
        }
        self.line += 1;
        self.read += read as u64;
        serde_json::from_str(&self.text).map(Some).map_err(|error| self.refuse(&error.to_string()))
    }

    fn refuse(&self, reason: &str) -> ResultsError {
        ResultsError::new(&self.path, format!("line {}: {reason}", self.line))
    }

    /// Returns the path of the file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}
