//! Results files: JSON lines. The manifest comes first, then each row, in the order of the rows.

use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, BufWriter, Read as _, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use hal_sim::campaign::{CellResult, Verdict};
use serde::{Deserialize, Serialize};

use super::manifest::{FORMAT, Manifest};
use crate::output::CommandError;
use crate::run::open_exclusively;

/// A line of a results file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Line<'a> {
    Manifest(Cow<'a, Manifest>),
    Row(Cow<'a, Row>),
}

/// A row: one fault with one seed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Row {
    /// The number of the row, from 0.
    pub(super) row: usize,
    /// The fault in words.
    pub(super) fault: String,
    /// The reference of the fault in the plan.
    pub(super) reference: Option<String>,
    /// The seed of the run.
    pub(super) seed: u64,
    /// The index of the worst cell; of several, the first.
    pub(super) worst: usize,
    /// The explained trace of the worst cell.
    pub(super) trace: String,
    /// The cells, at least one.
    pub(super) cells: Vec<Cell>,
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
        self.verdict.severity(self.detected_us.max(self.safe_us))
    }

    /// Returns the argument of `--cell`.
    pub(super) fn argument(&self, row: usize) -> String {
        self.number.map_or_else(|| format!("{row}@{}", self.at_us), |number| number.to_string())
    }
}

/// Returns the index of the worst cell; of several, the first. `None` without cells.
pub(super) fn worst(cells: &[Cell]) -> Option<usize> {
    (0..cells.len()).max_by_key(|place| (cells[*place].severity(), Reverse(*place)))
}

impl Row {
    /// Returns the worst cell.
    pub(super) fn worst(&self) -> &Cell {
        &self.cells[self.worst]
    }

    /// Returns the number of cells with each verdict, from the worst to the best.
    pub(super) fn counts(&self) -> Vec<(Verdict, usize)> {
        let of = |verdict: Verdict| (verdict, self.cells.iter().filter(|cell| cell.verdict == verdict).count());
        Verdict::ALL.into_iter().rev().map(of).filter(|(_, count)| *count > 0).collect()
    }

    /// Returns the command line that runs a cell alone.
    pub(super) fn command(&self, manifest: &Manifest, cell: &Cell) -> String {
        let seed = manifest.seed.map_or_else(String::new, |seed| format!(" --seed {seed}"));
        format!("pve-sim campaign {}{seed} --cell {}", quoted(&manifest.plan), cell.argument(self.row))
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

/// A writer that appends rows to a results file. The file is locked against other writers until this value is dropped.
#[derive(Debug)]
pub(super) struct Writer {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Writer {
    /// Creates a results file, or replaces an earlier one. Refuses to replace any other file with contents.
    pub(super) fn create(path: &Path, manifest: &Manifest) -> Result<Self, CommandError> {
        let file = open(path)?;
        if !has_no_results(path, &file)? && Reader::open(path).is_err() {
            return Err(CommandError::of(path, "not a results file, so it is not replaced; use another --results"));
        }
        Self::begin(path, file, manifest)
    }

    /// Opens the results of an interrupted campaign for appending after the last complete row; creates a missing file.
    /// Returns the numbers of the complete rows.
    pub(super) fn resume(path: &Path, manifest: &Manifest) -> Result<(Self, BTreeSet<usize>), CommandError> {
        let mut file = open(path)?;
        if has_no_results(path, &file)? {
            return Ok((Self::begin(path, file, manifest)?, BTreeSet::new()));
        }
        let mut reader = Reader::open(path)?;
        let found = &reader.manifest;
        if !found.is_of_campaign_of(manifest) || found.shard != manifest.shard {
            let reason = "these results differ in plan, version, seed, shard or --no-fork; \
                          omit --resume to replace them";
            return Err(CommandError::of(path, reason));
        }
        let rows = reader.by_ref().map(|row| Ok(row?.row)).collect::<Result<_, CommandError>>()?;
        let of = |error: io::Error| CommandError::of(path, error);
        file.set_len(reader.complete).map_err(of)?;
        file.seek(SeekFrom::End(0)).map_err(of)?;
        Ok((Self { path: path.to_owned(), file: BufWriter::new(file) }, rows))
    }

    /// Replaces the contents of the file by a manifest.
    fn begin(path: &Path, file: File, manifest: &Manifest) -> Result<Self, CommandError> {
        let of = |error: io::Error| CommandError::of(path, error);
        // A file that is not a regular one cannot be truncated.
        if file.metadata().map_err(of)?.len() > 0 {
            file.set_len(0).map_err(of)?;
        }
        let mut writer = Self { path: path.to_owned(), file: BufWriter::new(file) };
        writer.write(&Line::Manifest(Cow::Borrowed(manifest)))?;
        Ok(writer)
    }

    /// Appends a row, and flushes the file to the operating system.
    pub(super) fn append(&mut self, row: &Row) -> Result<(), CommandError> {
        self.write(&Line::Row(Cow::Borrowed(row)))
    }

    fn write(&mut self, line: &Line<'_>) -> Result<(), CommandError> {
        let mut write = || {
            serde_json::to_writer(&mut self.file, line)?;
            self.file.write_all(b"\n")?;
            self.file.flush()
        };
        write().map_err(|error| CommandError::of(&self.path, error))
    }
}

/// Opens or creates a file for writing, with a lock against other writers. Keeps its contents.
fn open(path: &Path) -> Result<File, CommandError> {
    let file = open_exclusively(OpenOptions::new().write(true).create(true).truncate(false), path);
    let file = file.map_err(|error| CommandError::of(path, error))?;
    file.ok_or_else(|| CommandError::of(path, "another pve-sim is writing to this file; use another --results"))
}

/// Returns whether a file is not regular, is empty, or ends within its manifest, as after a full disk.
fn has_no_results(path: &Path, file: &File) -> Result<bool, CommandError> {
    let of = |error: io::Error| CommandError::of(path, error);
    let found = file.metadata().map_err(of)?;
    if !found.is_file() || found.len() == 0 {
        return Ok(true);
    }
    let text = first_line(&mut BufReader::new(File::open(path).map_err(of)?)).map_err(of)?;
    Ok(text.starts_with(b"{\"manifest\":") && !text.ends_with(b"\n") && found.len() == text.len() as u64)
}

/// Reads a line of up to 1 MiB, because a file of another kind may be one endless line.
fn first_line(file: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut text = Vec::new();
    file.take(1 << 20).read_until(b'\n', &mut text)?;
    Ok(text)
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
    /// The length of the manifest and the complete rows so far, in bytes.
    complete: u64,
}

impl Reader {
    pub(super) fn open(path: &Path) -> Result<Self, CommandError> {
        let file = File::open(path).map_err(|error| CommandError::of(path, error))?;
        let mut file = BufReader::new(file);
        let text = first_line(&mut file).map_err(|error| CommandError::of(path, error))?;
        match serde_json::from_slice(&text) {
            Ok(Line::Manifest(manifest)) if manifest.format == FORMAT && text.ends_with(b"\n") => {
                let (path, manifest) = (path.to_owned(), manifest.into_owned());
                Ok(Self { path, file, manifest, line: 1, lowest: 0, complete: text.len() as u64 })
            }
            _ => Err(CommandError::of(path, "not a results file in the format of this version")),
        }
    }

    /// Returns the next row; `None` at the end, or if the last line is incomplete.
    fn row(&mut self) -> Result<Option<Row>, CommandError> {
        let mut text = String::new();
        let read = self.file.read_line(&mut text).map_err(|error| CommandError::of(&self.path, error))?;
        if !text.ends_with('\n') {
            return Ok(None);
        }
        self.line += 1;
        let row = match serde_json::from_str(&text) {
            Ok(Line::Row(row)) => row.into_owned(),
            Ok(Line::Manifest(_)) => return Err(self.refuse("a row was expected")),
            Err(error) => return Err(self.refuse(&error.to_string())),
        };
        let Manifest { rows, shard, .. } = self.manifest;
        if row.row < self.lowest || row.row >= rows || shard.is_some_and(|shard| !shard.has(row.row)) {
            return Err(self.refuse(&format!("row {} does not belong here", row.row)));
        }
        if worst(&row.cells) != Some(row.worst) {
            return Err(self.refuse(&format!("cell {} is not the worst cell of row {}", row.worst, row.row)));
        }
        self.lowest = row.row + 1;
        self.complete += read as u64;
        Ok(Some(row))
    }

    fn refuse(&self, reason: &str) -> CommandError {
        CommandError::of(&self.path, format!("line {}: {reason}", self.line))
    }

    /// Returns the path of the file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

/// The rows up to the end, an incomplete last line, or an error.
impl Iterator for Reader {
    type Item = Result<Row, CommandError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.row().transpose()
    }
}
