//! Runs the cells of each row, as forks of one run if the controller can be cloned, otherwise each from the start.
//! Refines each interval in which the verdict changes, and the worst interval.

use protocol_core::time::{Duration, Instant};

use super::cell::{Cell, CellResult};
use super::controller::{Controller, InRust};
use super::fault::{PlanFault, communication};
use super::golden::{CampaignError, Golden};
use super::master::{Master, Scripted};
use super::observe::observe;
use super::plan::{Entry, Plan, refuse_more};
use super::rig::Rig;
use super::verdict::{Observed, Verdict};
use crate::scenario::Target as _;

/// The time step of the refinement.
const FINE: Duration = Duration::from_millis(1);

/// A campaign whose golden runs have passed. Rows are independent and can run in parallel.
#[derive(Debug)]
pub struct Campaign<'a, M = Scripted> {
    plan: &'a Plan,
    master: M,
    pub(super) goldens: Vec<Golden>,
    rows: Vec<Row>,
    forks: bool,
}

/// The cells of one fault and one seed, at all instants.
#[derive(Debug)]
pub struct Row {
    pub(super) fault: PlanFault,
    pub(super) golden: usize,
    /// The seed of the runs.
    pub seed: u64,
    /// The number of the first cell.
    pub first: u64,
    /// The number of grid cells.
    pub cells: u64,
}

impl Row {
    /// Returns the fault in words.
    #[must_use]
    pub fn fault(&self) -> &str {
        &self.fault.text
    }

    /// Returns the fault's reference for the reports.
    #[must_use]
    pub fn reference(&self) -> Option<&str> {
        self.fault.reference.as_deref()
    }
}

impl<'a> Campaign<'a> {
    /// Creates a campaign after one golden run for each seed. The steps of the scenario are the controller.
    ///
    /// # Errors
    /// [`CampaignError`]
    pub fn new(plan: &'a Plan) -> Result<Self, CampaignError> {
        Self::of(plan, Scripted)
    }
}

impl<'a, C: Controller, F: Fn() -> C> Campaign<'a, InRust<C, F>> {
    /// Creates a campaign after one golden run for each seed. `make` creates a controller, which acts in addition to
    /// the steps of the scenario. Each cell has a clone of this controller.
    ///
    /// # Errors
    /// [`CampaignError`]
    pub fn with_controller(plan: &'a Plan, make: F) -> Result<Self, CampaignError>
    where
        C: Clone,
    {
        Self::of(plan, InRust { make, fork: |controller| Some(controller.clone()) })
    }

    /// Creates a campaign as [`with_controller`](Campaign::with_controller) does, for a controller that cannot be
    /// cloned: each cell runs from the start.
    ///
    /// # Errors
    /// [`CampaignError`]
    pub fn with_fresh_controllers(plan: &'a Plan, make: F) -> Result<Self, CampaignError> {
        Self::of(plan, InRust { make, fork: |_| None })
    }
}

impl<'a, M: Master> Campaign<'a, M> {
    /// Creates a campaign after one golden run for each seed, with the controllers of `master`.
    ///
    /// # Errors
    /// [`CampaignError`]
    pub fn of(plan: &'a Plan, master: M) -> Result<Self, CampaignError> {
        let goldens: Vec<Golden> =
            plan.seeds.iter().map(|seed| Golden::run(plan, &master, *seed)).collect::<Result<_, _>>()?;
        let mut faults = Vec::new();
        for entry in &plan.faults {
            match entry {
                Entry::Own(own) => faults.extend(own.iter().cloned()),
                Entry::Communication => faults.extend(errors(&goldens)?),
            }
        }
        let (mut rows, mut first) = (Vec::new(), 0);
        for fault in &faults {
            for (golden, Golden { seed, instants, .. }) in goldens.iter().enumerate() {
                let cells = instants.len() as u64;
                rows.push(Row { fault: fault.clone(), golden, seed: *seed, first, cells });
                first += cells;
            }
        }
        refuse_more(first).map_err(CampaignError)?;
        Ok(Self { plan, master, goldens, rows, forks: true })
    }

    /// Makes each cell run from the start of the scenario, instead of from a fork at the instant of the fault.
    #[must_use]
    pub fn without_forks(self) -> Self {
        Self { forks: false, ..self }
    }

    /// Returns the rows, in the order of the plan.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Returns the number of grid cells.
    #[must_use]
    pub fn cells(&self) -> u64 {
        self.rows.last().map_or(0, |row| row.first + row.cells)
    }

    /// Returns the grid cell with this number.
    #[must_use]
    pub fn numbered(&self, number: u64) -> Option<Cell> {
        let place = self.rows.partition_point(|row| row.first <= number).checked_sub(1)?;
        let row = self.rows.get(place)?;
        let index = usize::try_from(number - row.first).ok()?;
        let at = *self.goldens.get(row.golden)?.instants.get(index)?;
        Some(Cell { row: place, at })
    }

    /// Returns the cell of a row at an instant; `None` for an unknown row, and for an instant before the first or after
    /// the last grid instant.
    #[must_use]
    pub fn at(&self, row: usize, at: Instant) -> Option<Cell> {
        let instants = &self.goldens.get(self.rows.get(row)?.golden)?.instants;
        (*instants.first()?..=*instants.last()?).contains(&at).then_some(Cell { row, at })
    }

    /// Runs a row and passes each result to `each`. The grid cells come in order. After each change of the verdict come
    /// the cells that locate the change to 1 ms. The worst interval, in steps of 1 ms, comes last, unless both its
    /// verdicts are [`NoEffect`](Verdict::NoEffect). An unknown row has no cells.
    pub fn row(&self, row: usize, each: &mut dyn FnMut(CellResult)) {
        let Some(golden) = self.rows.get(row).and_then(|row| self.goldens.get(row.golden)) else { return };
        let mut base = self.base(row);
        let mut before: Option<CellResult> = None;
        let mut worst: Option<Interval> = None;
        for at in &golden.instants {
            let Some(result) = self.forked(&mut base, Cell { row, at: *at }) else { continue };
            each(result.clone());
            if let Some(left) = before.replace(result.clone()) {
                let refined = self.bisect(&left, &result);
                refined.iter().cloned().for_each(&mut *each);
                let known = refined.into_iter().map(|cell| cell.at_us).collect();
                let interval =
                    Interval { left: left.at_us, right: result.at_us, severity: severity(&left, &result), known };
                if worst.as_ref().is_none_or(|worst| interval.severity > worst.severity) {
                    worst = Some(interval);
                }
            }
        }
        if let Some(worst) = worst.filter(|worst| worst.severity.0.0 != Verdict::NoEffect) {
            self.scan(row, &worst, each);
        }
    }

    /// Runs one cell alone. `None` for an unknown row.
    #[must_use]
    pub fn cell(&self, cell: Cell) -> Option<CellResult> {
        self.forked(&mut None, cell)
    }

    /// Runs one cell, and returns its explained trace with notes at the fault and at the end. `None` for an unknown
    /// row.
    #[must_use]
    pub fn trace(&self, cell: Cell) -> Option<String> {
        let row = self.rows.get(cell.row)?;
        let mut rig = Rig::new(self.plan, &self.master, row.seed, true);
        rig.pass(cell.at, &mut ());
        rig.run.note(&format!("fault: {}", row.fault()));
        let (rig, result) = self.observe(rig, cell)?;
        let mut run = rig.run;
        let ms = |time: Option<u64>| {
            time.map_or("never".to_owned(), |us| format!("after {}.{:03} ms", us / 1000, us % 1000))
        };
        if self.plan.detected.is_some() {
            run.note(&format!("detected: {}", ms(result.detected_us)));
        }
        if self.plan.safe.is_some() {
            run.note(&format!("safe: {}", ms(result.safe_us)));
        }
        run.note(&format!("verdict: {}", result.verdict));
        Some(run.outcome(rig.target.simulation()).trace().to_owned())
    }

    /// Creates the run of a row from which cells are forked; `None` without forks.
    fn base(&self, row: usize) -> Option<Rig<'a, M::Target>> {
        let row = self.rows.get(row).filter(|_| self.forks)?;
        Some(Rig::new(self.plan, &self.master, row.seed, false))
    }

    /// Runs a cell in a fork of `base`, which advances to the cell's instant. Without `base` or forks, the cell runs from
    /// the start.
    fn forked(&self, base: &mut Option<Rig<'a, M::Target>>, cell: Cell) -> Option<CellResult> {
        if let Some(base) = base {
            base.pass(cell.at, &mut ());
        }
        let fork = base.as_ref().and_then(|base| base.fork(&self.master));
        let rig = match fork {
            Some(rig) => rig,
            None => {
                *base = None;
                let mut rig = Rig::new(self.plan, &self.master, self.rows.get(cell.row)?.seed, false);
                rig.pass(cell.at, &mut ());
                rig
            }
        };
        self.observe(rig, cell).map(|(_, result)| result)
    }

    /// Locates the change of the verdict between two cells to 1 ms, and returns the cells of the search. Without a
    /// change, there are none.
    fn bisect(&self, left: &CellResult, right: &CellResult) -> Vec<CellResult> {
        let (row, fine, mut refined) = (left.row, FINE.as_micros(), Vec::new());
        if left.verdict == right.verdict {
            return refined;
        }
        let mut base = self.base(row);
        if let Some(base) = &mut base {
            base.pass(Instant::from_micros(left.at_us), &mut ());
        }
        let (first, mut left, mut right) = (left.verdict, left.at_us, right.at_us);
        while right - left > fine {
            // A multiple of 1 ms from the left end.
            let half = ((right - left) / fine).div_ceil(2).max(1) * fine;
            let at_us = left + half.min(right - left - 1);
            let mut fork = base.as_ref().and_then(|base| base.fork(&self.master));
            let Some(result) = self.forked(&mut fork, Cell { row, at: Instant::from_micros(at_us) }) else { break };
            if result.verdict == first {
                left = at_us;
            } else {
                right = at_us;
            }
            refined.push(result);
        }
        refined
    }

    /// Runs the cells of an interval in steps of 1 ms, except those with a known result.
    fn scan(&self, row: usize, interval: &Interval, each: &mut dyn FnMut(CellResult)) {
        let mut base = self.base(row);
        let instants = (interval.left..interval.right).step_by(FINE.as_micros() as usize).skip(1);
        for at_us in instants.filter(|at| !interval.known.contains(at)) {
            self.forked(&mut base, Cell { row, at: Instant::from_micros(at_us) }).into_iter().for_each(&mut *each);
        }
    }

    /// Injects the fault of a cell into a run at the cell's instant. Returns the run and the result.
    fn observe(&self, rig: Rig<'a, M::Target>, cell: Cell) -> Option<(Rig<'a, M::Target>, CellResult)> {
        let (row, golden) = self.place(cell)?;
        let (rig, observed) = observe(self.plan, golden, rig, vec![(cell.at, Some(&row.fault))], &mut ());
        let result = self.result(cell, row, golden, &observed);
        Some((rig, result))
    }

    pub(super) const fn plan(&self) -> &'a Plan {
        self.plan
    }

    /// Returns the row and the golden run of a cell; `None` for an unknown row.
    pub(super) fn place(&self, cell: Cell) -> Option<(&Row, &Golden)> {
        let row = self.rows.get(cell.row)?;
        Some((row, self.goldens.get(row.golden)?))
    }

    /// Returns the result of a cell from its observations.
    pub(super) fn result(&self, cell: Cell, row: &Row, golden: &Golden, observed: &Observed) -> CellResult {
        let index = golden.instants.binary_search(&cell.at).ok();
        CellResult {
            number: index.map(|index| row.first + index as u64),
            row: cell.row,
            fault: row.fault.text.clone(),
            seed: row.seed,
            at_us: cell.at.as_micros(),
            refined: index.is_none(),
            verdict: Verdict::of(observed, &self.plan.limits),
            detected_us: observed.detected.map(|time| time.as_micros()),
            safe_us: observed.safe.map(|time| time.as_micros()),
            struck: observed.struck,
        }
    }
}

/// The interval between two neighbouring grid cells.
struct Interval {
    left: u64,
    right: u64,
    severity: (Severity, Severity),
    /// The instants inside the interval that have a result, in microseconds.
    known: Vec<u64>,
}

type Severity = (Verdict, bool, u64);

/// Returns the severities of both ends of an interval, the worse first.
fn severity(left: &CellResult, right: &CellResult) -> (Severity, Severity) {
    let (left, right) = (left.severity(), right.severity());
    (left.max(right), left.min(right))
}

/// Returns the communication errors on the identifiers that are sent throughout all golden runs.
fn errors(goldens: &[Golden]) -> Result<Vec<PlanFault>, CampaignError> {
    let frames = goldens.iter().take(1).flat_map(|golden| &golden.identifiers);
    let common = frames.filter(|(key, _)| goldens.iter().all(|golden| golden.identifiers.contains_key(key)));
    let faults: Vec<PlanFault> = common.flat_map(|(_, frame)| communication(frame)).collect();
    if faults.is_empty() {
        let reason = "'communication': no identifier is sent in every observation period; increase observe_ms";
        return Err(CampaignError(reason.to_owned()));
    }
    Ok(faults)
}
