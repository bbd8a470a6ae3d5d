//! The summary on stdout: the verdicts and the worst cell of each row, the last output of a controller that hung,
//! and the command that reproduces a failure.

use std::io::{self, Write};

use hal_sim::campaign::Verdict;
use hal_sim::text::in_one_line;

use crate::campaign::live::OUTPUT;
use crate::campaign::manifest::{LimitsUs, Manifest};
use crate::campaign::results::{Cell, Row};

pub(super) struct Summary<'a> {
    manifest: &'a Manifest,
    cells: usize,
    failed: usize,
    /// The number of grid cells whose fault was injected.
    injected: usize,
    /// The number of injected faults that were detected.
    detected: usize,
    not_injected: usize,
}

impl<'a> Summary<'a> {
    pub(super) const fn new(manifest: &'a Manifest) -> Self {
        Self { manifest, cells: 0, failed: 0, injected: 0, detected: 0, not_injected: 0 }
    }

    /// Writes the lines of a row.
    pub(super) fn row(&mut self, row: &Row, out: &mut dyn Write) -> io::Result<()> {
        let failed = failed(row);
        self.cells += row.cells.len();
        self.failed += failed;
        let grid = row.cells.iter().filter(|cell| cell.number.is_some());
        let (not_injected, injected): (Vec<&Cell>, Vec<&Cell>) =
            grid.partition(|cell| cell.verdict == Verdict::NotInjected);
        self.not_injected += not_injected.len();
        self.injected += injected.len();
        self.detected += injected.iter().filter(|cell| cell.detected_us.is_some()).count();
        let word = if failed == 0 { "ok   " } else { "FAIL " };
        let seed = if self.manifest.seeds.len() > 1 { format!(" (seed {})", row.seed) } else { String::new() };
        writeln!(out, "{word}{}{seed}: {}", row.fault, counts(row))?;
        let worst = row.worst();
        if worst.verdict != Verdict::NoEffect {
            writeln!(out, "       worst: {}", reaction(worst, &self.manifest.limits))?;
            let output = row.trace.rsplit_once(OUTPUT).filter(|_| worst.verdict == Verdict::Hung);
            if let Some(line) = output.and_then(|(_, output)| output.lines().last()) {
                writeln!(out, "       controller: {}", in_one_line(line))?;
            }
            if failed > 0 {
                writeln!(out, "       {}", row.command(self.manifest, worst))?;
            }
        }
        Ok(())
    }

    /// Writes the totals.
    pub(super) fn end(&self, out: &mut dyn Write) -> io::Result<()> {
        if self.manifest.limits.detected_us.is_some() {
            writeln!(out, "{} of {} injected faults detected", self.detected, self.injected)?;
        }
        match self.not_injected {
            0 => {}
            1 => writeln!(out, "1 cell proves nothing: its fault was not injected")?,
            cells => writeln!(out, "{cells} cells prove nothing: their faults were not injected")?,
        }
        if let Some(missing) = &self.manifest.missing {
            writeln!(out, "missing: {missing}")?;
        }
        if self.cells == 0 && self.manifest.missing.is_none() {
            let part = self.manifest.shard.map_or_else(String::new, |shard| format!("part {shard} of "));
            writeln!(out, "nothing was run: {part}the {} rows is empty", self.manifest.rows)?;
        }
        writeln!(out, "{} passed, {} failed", self.cells - self.failed, self.failed)
    }

    /// Returns whether the campaign passed: at least one cell, no failed cell, no missing row.
    pub(super) const fn passed(&self) -> bool {
        self.failed == 0 && self.cells > 0 && self.manifest.missing.is_none()
    }
}

/// Returns the number of cells of a row that did not pass.
pub(super) fn failed(row: &Row) -> usize {
    row.cells.iter().filter(|cell| !cell.verdict.passed()).count()
}

/// Describes the number of cells of a row, in total and by verdict, the worst verdict first.
pub(super) fn counts(row: &Row) -> String {
    let counts = row.counts().into_iter().map(|(verdict, count)| format!("{count} {verdict}"));
    let cells = if row.cells.len() == 1 { "1 cell".to_owned() } else { format!("{} cells", row.cells.len()) };
    format!("{cells}: {}", counts.collect::<Vec<_>>().join(", "))
}

/// Describes the verdict, the instant and the reaction times of a cell.
pub(in crate::campaign) fn reaction(cell: &Cell, limits: &LimitsUs) -> String {
    let after = |word: &str, time: Option<u64>| match time {
        Some(us) => format!(", {word} after {}", milliseconds(us)),
        None => format!(", not {word}"),
    };
    let detected = limits.detected_us.map(|_| after("detected", cell.detected_us));
    let safe = limits.safe_us.map(|_| after("safe", cell.safe_us));
    format!(
        "{} at {}{}{}",
        cell.verdict,
        milliseconds(cell.at_us),
        detected.unwrap_or_default(),
        safe.unwrap_or_default()
    )
}

fn milliseconds(us: u64) -> String {
    format!("{}.{:03} ms", us / 1000, us % 1000)
}
