//! Draws pairs: new ones, and variations of those that reached a new state.

use fastrand::Rng;
use protocol_core::time::Duration;
use toml::{Table, Value};

use super::pair::{Pair, Timed};
use crate::campaign::fault::PlanFault;
use crate::campaign::plan::Plan;
use crate::campaign::run::Campaign;
use crate::simulation::Simulation;

/// The maximum number of draws for one pair.
const ATTEMPTS: usize = 1000;

/// A generator of pairs.
pub(super) struct Source<'a> {
    plan: &'a Plan,
    /// Each fault of the plan, once.
    faults: Vec<PlanFault>,
    goldens: u32,
    rng: Rng,
    trial: Simulation,
}

impl<'a> Source<'a> {
    pub(super) fn new(campaign: &Campaign<'a>, seed: u64) -> Self {
        let plan = campaign.plan();
        let rows = campaign.rows().iter().filter(|row| row.golden == 0);
        let goldens = u32::try_from(campaign.goldens.len()).unwrap_or(u32::MAX);
        let faults = rows.map(|row| row.fault.clone()).collect();
        Self { plan, faults, goldens, rng: Rng::with_seed(seed), trial: plan.scenario.trial() }
    }

    /// Draws a pair, mostly a variation of a pair in `corpus`. `None` if [`ATTEMPTS`] draws give no pair of faults that
    /// can act together.
    pub(super) fn pair(&mut self, corpus: &[Pair]) -> Option<Pair> {
        let draw = || match self.rng.choice(corpus) {
            Some(pair) if self.rng.u8(0..4) > 0 => self.variation(pair.clone()),
            _ => self.new_pair(),
        };
        let mut pairs = std::iter::repeat_with(draw).take(ATTEMPTS);
        pairs.find(Pair::acts_together).map(Pair::sorted)
    }

    fn new_pair(&mut self) -> Pair {
        let at_ms = self.instant();
        let longest = u32::try_from(self.plan.observe.as_millis()).unwrap_or(u32::MAX);
        let gap = match self.rng.u8(0..4) {
            0 => 0,
            1 => self.rng.u32(0..=20),
            2 => self.rng.u32(0..=200),
            _ => self.rng.u32(0..=longest),
        };
        let later = at_ms.saturating_add(gap).min(self.plan.instants.to_ms);
        let golden = self.rng.u32(0..self.goldens) as usize;
        Pair { golden, faults: [at_ms, later].map(|at_ms| Timed { fault: self.fault(), at_ms }) }
    }

    fn variation(&mut self, mut pair: Pair) -> Pair {
        let place = self.rng.usize(0..2);
        let (act, at_ms) = (self.rng.u8(0..4), self.instant());
        let other = pair.faults[1 - place].at_ms;
        let timed = &mut pair.faults[place];
        match act {
            0 => timed.fault = self.fault(),
            1 => timed.fault = self.varied(&timed.fault.clone()),
            2 => timed.at_ms = at_ms,
            _ => timed.at_ms = (other + self.rng.u32(0..=100)).min(self.plan.instants.to_ms),
        }
        pair
    }

    fn instant(&mut self) -> u32 {
        self.rng.u32(self.plan.instants.from_ms..=self.plan.instants.to_ms)
    }

    /// Draws a fault of the plan, and varies one fault in four.
    fn fault(&mut self) -> PlanFault {
        // A campaign has at least one fault.
        let fault = self.faults[self.rng.usize(0..self.faults.len())].clone();
        if self.rng.u8(0..4) == 0 { self.varied(&fault) } else { fault }
    }

    /// Returns the fault with one number changed or with a duration added, or unchanged if the result is invalid.
    fn varied(&mut self, fault: &PlanFault) -> PlanFault {
        let mut entry = fault.entry.clone();
        let longest = i64::try_from(self.plan.observe.as_millis()).unwrap_or(i64::MAX);
        let count = numbers(&mut entry).len();
        let place = self.rng.usize(0..=count);
        match numbers(&mut entry).into_iter().nth(place) {
            Some((_, number)) => {
                *number = match self.rng.u8(0..4) {
                    0 => *number / 2,
                    1 => number.saturating_mul(2),
                    2 => number.saturating_add(self.rng.i64(-10..=10)),
                    _ => self.rng.i64(0..=number.saturating_abs().saturating_mul(2)),
                };
            }
            None => drop(entry.insert("for_ms".to_owned(), self.rng.i64(1..=longest.max(1)).into())),
        }
        checked(entry, self.plan, &self.trial).unwrap_or_else(|| fault.clone())
    }
}

/// Returns the fault with these keys; `None` if they are invalid, or if `for_ms` is not 1 ms to one day.
pub(super) fn checked(entry: Table, plan: &Plan, trial: &Simulation) -> Option<PlanFault> {
    let is_short = entry.get("for_ms").and_then(Value::as_integer).is_none_or(|ms| (1..=DAY_MS).contains(&ms));
    PlanFault::check(entry, plan.scenario.devices(), trial).ok().filter(|_| is_short)
}

const DAY_MS: i64 = Duration::from_secs(24 * 60 * 60).as_millis() as i64;

/// Returns the integers in a table with their keys, including the integers in inner tables and lists.
pub(super) fn numbers(table: &mut Table) -> Vec<(String, &mut i64)> {
    fn of<'v>(key: &str, value: &'v mut Value) -> Vec<(String, &'v mut i64)> {
        match value {
            Value::Integer(number) => vec![(key.to_owned(), number)],
            Value::Table(table) => numbers(table),
            Value::Array(items) => items.iter_mut().flat_map(|item| of(key, item)).collect(),
            _ => Vec::new(),
        }
    }
    table.iter_mut().flat_map(|(key, value)| of(key, value)).collect()
}
