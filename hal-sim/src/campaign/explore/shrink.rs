//! Reduces a find to its shortest form: fewer steps, values from the plan or round values, short durations, and round
//! instants.

use std::ops::Range;

use toml::{Table, Value};

use super::draw::{checked, numbers};
use super::pair::{self, Failing, Outcome, Pair, Tried, kind};
use super::{Find, write};
use crate::campaign::fault::PlanFault;
use crate::campaign::plan::Plan;
use crate::campaign::run::Campaign;
use crate::simulation::{Command, Simulation};

/// The maximum number of passes over the parts of a pair.
const ROUNDS: usize = 3;

/// The multiples to which instants are rounded, in milliseconds.
const ROUND_MS: [u32; 7] = [1000, 500, 200, 100, 50, 20, 10];

/// A pair that fails, and its scenario, if one reproduces the pair.
struct Case {
    pair: Pair,
    failing: Failing,
    scenario: Option<String>,
}

/// Returns the shortest form of a pair that fails.
pub(super) fn shrink(campaign: &Campaign<'_>, pair: &Pair, failing: Failing) -> Find {
    let (plan, seed) = (campaign.plan(), campaign.goldens[pair.golden].seed);
    let scenario = write::scenario(plan, seed, pair, &failing);
    let mut case = Case { pair: Pair { golden: 0, ..pair.clone() }, failing, scenario };
    let mut document: Table = toml::from_str(&plan.texts.1).unwrap_or_default();
    for steps in case.steps(&document) {
        let mut shorter = document.clone();
        if drop_steps(&mut shorter, steps)
            && let Some(next) = with_scenario(plan, &shorter, seed, |campaign| case.with(campaign, case.pair.clone()))
        {
            (case, document) = (next, shorter);
        }
    }
    let simple = with_scenario(plan, &document, seed, |campaign| case.simplified(campaign));
    let Case { pair, failing, scenario } = simple.unwrap_or(case);
    Find { verdict: failing.verdict, faults: pair.text(), seed, scenario }
}

/// Replaces the scenario of a plan, and calls `then` with the campaign of the new plan.
fn with_scenario<R>(
    plan: &Plan,
    scenario: &Table,
    seed: u64,
    then: impl FnOnce(&Campaign<'_>) -> Option<R>,
) -> Option<R> {
    let plan = Plan::parse(&plan.texts.0, |_| Ok(scenario.to_string())).ok()?.with_seed(seed);
    then(&Campaign::new(&plan).ok()?)
}

/// Removes steps from a scenario, unless no step would remain. Returns whether steps were removed.
fn drop_steps(scenario: &mut Table, which: Range<usize>) -> bool {
    let Some(Value::Array(steps)) = scenario.get_mut("steps") else { return false };
    let are_there = !which.is_empty() && which.end <= steps.len() && which.len() < steps.len();
    if are_there {
        steps.drain(which);
    }
    are_there
}

impl Case {
    /// Returns the ranges of steps to drop, in order: all steps after the faults, then each step that is not over at
    /// the first fault, from the last step on.
    fn steps(&self, scenario: &Table) -> Vec<Range<usize>> {
        let count = scenario.get("steps").and_then(Value::as_array).map_or(0, Vec::len);
        let [_, second] = &self.pair.faults;
        let after = self.failing.acted.partition_point(|at| *at <= second.at());
        let each = (self.failing.completed..count).rev().map(|step| step..step + 1);
        std::iter::once(after..count).chain(each).collect()
    }

    /// Runs `pair` in a campaign. Returns the new case; `None` if the verdict differs, if a fault fails alone, or if
    /// only the old case has a scenario.
    fn with(&self, campaign: &Campaign<'_>, pair: Pair) -> Option<Self> {
        let (plan, golden) = (campaign.plan(), campaign.goldens.first()?);
        let mut base = pair::golden(plan, golden);
        let Outcome::Fails(failing) = Tried::of(campaign, golden, &mut base, &pair).outcome else { return None };
        if failing.verdict != self.failing.verdict {
            return None;
        }
        let scenario = write::scenario(plan, golden.seed, &pair, &failing);
        (scenario.is_some() || self.scenario.is_none()).then_some(Self { pair, failing, scenario })
    }

    /// Returns the case with simpler faults and instants; `None` if no simpler pair fails in the same way.
    fn simplified(&self, campaign: &Campaign<'_>) -> Option<Self> {
        let trial = campaign.plan().scenario.trial();
        let mut best: Option<Self> = None;
        for _ in 0..ROUNDS {
            let before = best.as_ref().unwrap_or(self).pair.text();
            for part in 0.. {
                let case = best.as_ref().unwrap_or(self);
                let Some(pairs) = simpler(campaign, &case.pair, part, &trial) else { break };
                best = pairs.into_iter().find_map(|pair| case.with(campaign, pair)).or(best);
            }
            if best.as_ref().unwrap_or(self).pair.text() == before {
                break;
            }
        }
        best
    }
}

/// Returns the pairs in which the given part is simpler, the simplest first; `None` if the pair has no such part.
fn simpler(campaign: &Campaign<'_>, pair: &Pair, part: usize, trial: &Simulation) -> Option<Vec<Pair>> {
    let (place, part) = (part % 2, part / 2);
    let timed = &pair.faults[place];
    let count = numbers(&mut timed.fault.entry.clone()).len();
    let longest = pair.faults.iter().map(|it| numbers(&mut it.fault.entry.clone()).len()).max()?;
    let with = |change: &dyn Fn(&mut Pair)| {
        let mut pair = pair.clone();
        change(&mut pair);
        pair
    };
    Some(match part {
        0 => instants(campaign.plan(), pair, place)
            .into_iter()
            .map(|instants| with(&|pair| pair.faults.iter_mut().zip(instants).for_each(|(it, at)| it.at_ms = at)))
            .collect(),
        1 => {
            let of_plan = campaign.rows().iter().map(|row| &row.fault).filter(|it| kind(it) == kind(&timed.fault));
            let before = of_plan.take_while(|it| it.entry != timed.fault.entry);
            before.map(|fault| with(&|it| it.faults[place].fault = fault.clone())).collect()
        }
        part if part - 2 < count => {
            let entries = smaller(campaign, &timed.fault, part - 2);
            let faults = entries.into_iter().filter_map(|entry| checked(entry, campaign.plan(), trial));
            faults.map(|fault| with(&|it| it.faults[place].fault = fault.clone())).collect()
        }
        part if part - 2 < longest => Vec::new(),
        _ => return None,
    })
}

/// Returns rounder instants for the pair. The first fault is moved with the second fault, then alone; the second fault
/// is moved to the first, then alone.
fn instants(plan: &Plan, pair: &Pair, place: usize) -> Vec<[u32; 2]> {
    let [first, second] = pair.faults.each_ref().map(|fault| fault.at_ms);
    let at = [first, second][place];
    let round = ROUND_MS.into_iter().take_while(|step| at % step != 0);
    let round: Vec<u32> = round.flat_map(|step| [at - at % step, at - at % step + step]).collect();
    let alone = |at: &u32| if place == 0 { [*at, second] } else { [first, *at] };
    let together: Vec<[u32; 2]> = match place {
        0 => round.iter().map(|at| [*at, at + (second - first)]).collect(),
        _ if first != second => vec![[first, first]],
        _ => Vec::new(),
    };
    let grid = plan.instants.from_ms..=plan.instants.to_ms;
    let are_valid = |at: &[u32; 2]| at[0] <= at[1] && at.iter().all(|at| grid.contains(at));
    together.into_iter().chain(round.iter().map(alone)).filter(are_valid).collect()
}

/// Returns variants of a fault in which one number is simpler. A plant value is rounded unless the value is in the
/// plan; any other number is a duration or a count, and becomes smaller.
fn smaller(campaign: &Campaign<'_>, fault: &PlanFault, place: usize) -> Vec<Table> {
    let mut entry = fault.entry.clone();
    let Some((key, number)) = numbers(&mut entry).into_iter().nth(place).map(|(key, number)| (key, *number)) else {
        return Vec::new();
    };
    let is_of_plan = || {
        let of_kind = campaign.rows().iter().filter(|row| kind(&row.fault) == kind(fault));
        of_kind.into_iter().any(|row| {
            numbers(&mut row.fault.entry.clone()).into_iter().any(|(known, value)| known == key && *value == number)
        })
    };
    let powers = (0..18).map(|power| 10_i64.pow(power));
    let small =
        powers.clone().flat_map(|power| [1, 2, 5].map(|digit| digit * power)).take_while(|value| *value < number);
    let round = powers.rev().map(|power| number / power * power).filter(|value| *value != 0);
    let round = round.take_while(|value| *value != number);
    let values: Vec<i64> = match fault.command {
        Command::Plant(..) if key != "for_ms" && is_of_plan() => Vec::new(),
        Command::Plant(..) if key != "for_ms" => round.collect(),
        _ => small.chain(round).collect(),
    };
    let with = |value| {
        let mut entry = fault.entry.clone();
        numbers(&mut entry).into_iter().nth(place).into_iter().for_each(|(_, number)| *number = value);
        entry
    };
    values.into_iter().map(with).collect()
}
