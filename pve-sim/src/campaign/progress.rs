//! The progress line on a terminal: cells, rate, and the time left.

use std::io::{IsTerminal as _, Write as _, stderr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The time between two progress lines.
const PERIOD: Duration = Duration::from_millis(500);

#[derive(Debug)]
pub(super) struct Progress {
    is_shown: bool,
    began: Instant,
    told: Option<Instant>,
    rows: usize,
}

impl Progress {
    /// Creates the progress of a run of `rows` rows.
    pub(super) fn new(rows: usize) -> Self {
        Self { is_shown: stderr().is_terminal(), began: Instant::now(), told: None, rows }
    }

    /// Writes the progress line at most once per [`PERIOD`]. `cells` is the number of cells so far, `done` the number
    /// of complete rows.
    pub(super) fn tell(&mut self, cells: &AtomicU64, done: usize) {
        if self.is_shown && self.told.is_none_or(|told| told.elapsed() >= PERIOD) {
            self.told = Some(Instant::now());
            let line = line(cells.load(Ordering::Relaxed), (done, self.rows), self.began.elapsed());
            let _ = write!(stderr(), "\r{line}\x1b[K");
        }
    }

    /// Clears the progress line.
    pub(super) fn end(&self) {
        if self.told.is_some() {
            let _ = write!(stderr(), "\r\x1b[K");
        }
    }
}

fn line(cells: u64, (done, rows): (usize, usize), passed: Duration) -> String {
    let rate = cells as f64 / passed.as_secs_f64().max(1e-3);
    let left = (done > 0).then(|| passed.mul_f64((rows - done) as f64 / done as f64));
    let left = left.map_or_else(String::new, |left| format!(", {} left", clock(left)));
    format!("{done} of {rows} rows, {cells} cells, {rate:.0} cells/s{left}")
}

fn clock(time: Duration) -> String {
    let seconds = time.as_secs();
    format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_the_rows_left() {
        assert_eq!(line(0, (0, 4), Duration::ZERO), "0 of 4 rows, 0 cells, 0 cells/s");
        let told = line(1000, (1, 4), Duration::from_secs(1300));
        assert_eq!(told, "1 of 4 rows, 1000 cells, 1 cells/s, 1:05:00 left");
    }
}
